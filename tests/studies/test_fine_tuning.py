"""The page on fine-tuning, and the parts of scenes that are captured."""

import json
import re
from itertools import combinations
from pathlib import Path

import pytest

from studies.fine_tuning import TuningProof, _parts_of, page
from tmca.errors import SettingError

RESULTS = Path(__file__).parents[2] / "docs" / "results"


def test_the_page_is_made_from_its_results():
    stored, text = json.loads((RESULTS / "fine-tuning.json").read_text()), (RESULTS / "fine-tuning.md").read_text()
    command, commit = re.search(r"Command: `(.*)` at commit `(.*)`", text).groups()
    assert page(stored, command, commit) == text


def test_parts_of_a_scene_do_not_overlap():
    parts = _parts_of("coffee", [450e-9, 550e-9, 650e-9], (64, 80))
    assert [part.shape for part in parts] == [(3, 64, 80)] * 4
    assert not any((one.values == other.values).all() for one, other in combinations(parts, 2))
    with pytest.raises(SettingError):
        _parts_of("coffee", [450e-9, 550e-9, 650e-9], (4000, 80))


def test_too_few_scenes_are_refused_before_anything_is_made(tmp_path):
    with pytest.raises(SettingError):
        TuningProof(tmp_path / "work", ["coffee"], ["rocket"], counts=(12,)).run()
    assert not list(tmp_path.iterdir())
