"""Captures of real prototypes: decoders, what is stored of them, geometry, and the page of the results."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import torch

from studies.real.decoding import check_real_decoders, decode, stored_estimate
from studies.real.figures import upright, upright_place
from studies.real.geometry import light_by_offset, mask_evidence
from studies.real.page import page
from tests.lab.real_captures.bench import captured, mask_of, smooth_scene
from tests.studies.test_merit import taken
from tmca.cameras import Snapshot
from tmca.errors import SettingError

RESULTS = Path(__file__).parents[2] / "docs" / "results"


def test_the_page_is_made_from_its_results_with_pictures():
    text = page(json.loads((RESULTS / "real.json").read_text()), "real")
    assert text == (RESULTS / "real.md").read_text()
    for file in re.findall(r"\]\(([^)]*\.png)\)", text):
        assert (RESULTS / file).exists()


@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
def test_a_place_turns_with_its_picture(degrees):
    picture = np.arange(12).reshape(3, 4)
    row, column = upright_place((2, 1), (3, 4), degrees)
    assert upright(picture, degrees)[row, column] == picture[2, 1]


def test_captures_say_how_their_mask_lies_and_where_light_falls():
    mask = mask_of(160, 150)
    capture = captured(smooth_scene(4, 160, 150), mask)
    shares = mask_evidence([capture], mask, range(0, 8, 2), 0.0)
    assert shares["as it is"] > 0.8
    assert max(share for way, share in shares.items() if way != "as it is") < 0.3
    light = light_by_offset([capture], mask, [-4, -2, 0, 2, 4, 6, 8, 10], 0.0)
    assert min(light[2:6]) > 0.7
    assert max(abs(light[[0, 1, 6, 7]])) < 0.1


def test_decoders_are_known():
    with pytest.raises(SettingError, match="--decoders"):
        check_real_decoders(["magic"])


def test_an_estimate_is_computed_once_for_the_same_input_alone(tmp_path, monkeypatch):
    asked = []

    def counted(*given):
        asked.append(given)
        return decode(*given)

    monkeypatch.setattr("studies.real.decoding.decode", counted)
    snapshot, _ = taken((12, 10))
    dimmer = Snapshot(0.5 * snapshot.values, snapshot.camera)
    first, seconds = stored_estimate(tmp_path, "scene", snapshot, "admm-tv")
    again, told = stored_estimate(tmp_path, "scene", snapshot, "admm-tv")
    torch.testing.assert_close(again, first, rtol=0, atol=0)
    assert told == seconds
    assert len(asked) == 1
    other, _ = stored_estimate(tmp_path, "scene", dimmer, "admm-tv")
    assert len(asked) == 2
    assert float((other - first).abs().max()) > 1e-3


@pytest.mark.parametrize("left", [0, 100])
def test_a_stored_estimate_that_is_cut_short_is_computed_again(tmp_path, left):
    snapshot, _ = taken((12, 10))
    first, _ = stored_estimate(tmp_path, "scene", snapshot, "admm-tv")
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[:left])
    again, _ = stored_estimate(tmp_path, "scene", snapshot, "admm-tv")
    torch.testing.assert_close(again, first)
    assert len(file.read_bytes()) == len(whole)
