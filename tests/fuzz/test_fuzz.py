"""Damaged files are read or refused in one line: a short campaign, and every failure of the past.

``make fuzz`` runs the long one. A failure is saved under ``build/fuzz/failures``; once mended it joins
``tests/fuzz/regressions/KIND/WHAT.zip``.
"""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow


def _fuzz(*arguments):
    done = subprocess.run([sys.executable, "-m", "tests.fuzz", *arguments], capture_output=True, text=True, timeout=300)
    return done.returncode, done.stdout + done.stderr


def test_a_short_campaign_ends_well(tmp_path):
    code, said = _fuzz("--mutations", "100", "--jobs", "1", "--folder", str(tmp_path))
    assert code == 0, said
    assert "100 mutations" in said


def test_failures_of_the_past_stay_mended():
    code, said = _fuzz("--regressions")
    assert code == 0, said
