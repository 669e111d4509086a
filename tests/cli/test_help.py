"""Help pages: on a screen, with what is used most; all of it with ``--help-all``."""

import json
from pathlib import Path

import pytest

from tests.cli.calls import said

COMMANDS = sorted(json.loads(Path(__file__).with_name("frozen.json").read_text())["options"])
SCREEN = 42


@pytest.mark.parametrize("command", COMMANDS)
def test_help_fits_a_screen(command, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    lines = said(capsys, *command.split(), "--help").splitlines()
    assert lines[0].startswith(f"Usage: tmca {command}".rstrip())
    assert len(lines) <= SCREEN
    assert max(map(len, lines)) <= 80


def test_all_of_the_help_explains_what_the_short_one_only_names(capsys):
    short, whole = (said(capsys, "compare", "spectral", option) for option in ("--help", "--help-all"))
    assert len(short.splitlines()) < len(whole.splitlines())
    assert "--help-all" in short
