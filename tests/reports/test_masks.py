"""Phase masks for a sensor from Python: what is written and what it says."""

import json

import pytest
import torch

from tests.operators.test_window_moments import prior_of
from tmca.cameras import SpectralDepthCamera
from tmca.cameras.phase_codes import read_phase_codes
from tmca.design import MaskEffort, SensorSheet
from tmca.errors import OutputError, SettingError
from tmca.operators.window_moments import needed_block
from tmca.reports.mask_page import design_files
from tmca.reports.masks import _counts, design_spectral_depth

TINY = {"bench": {"window": (5, 7), "mask_pixels": 24, "diameter": 1e-3}, "camera": {"planes": 3}, "bands": 2}

KINDS = (("codes", "nc"), ("masks", "png"), ("psf", "png"))
BURST = {"masks_burst.png", "psf_burst.png"}


def design(out, buckets=1, **how):
    prior = prior_of(needed_block(3, (5, 7)))
    own = {**TINY, "prior": prior, "window": 3, "effort": MaskEffort(1, 1), "slots": [1], **how}
    return design_spectral_depth(SensorSheet(read_noise=0.01, buckets=buckets), out, **own)


def test_one_slot_is_a_static_mask(tmp_path):
    told = []
    advice, found = design(tmp_path / "d", progress=lambda share, step: told.append(share))
    assert told == sorted(told)
    assert not found["multiplex"]
    assert "static mask" in found["advice"]
    written = json.loads((tmp_path / "d" / "design.json").read_text())
    assert written["effort"] == {"starts": 1, "steps": 1, "rate": 0.003}
    assert read_phase_codes(tmp_path / "d" / "codes.nc")["slots"] == 1
    assert advice.best.camera.bench.mask_pixels == 24
    with pytest.raises(OutputError, match="earlier"):
        design(tmp_path / "d")


@pytest.mark.slow
def test_two_buckets_have_rows_and_files_of_their_own(tmp_path):
    advice, found = design(tmp_path / "d", buckets=2, slots=[3])
    named = {"static": "codes_k1.nc", "K = 3": "codes_k3.nc", "K = 3, two buckets": "codes_k3_two_buckets.nc"}
    assert {row["masks"]: row["codes"] for row in found["designs"]} == named | {"burst of two frames": "burst.nc"}
    assert [row["buckets"] for row in found["designs"]] == [1, 1, 2, 2]
    assert found["buckets"] == advice.best.buckets
    assert {file.name for file in (tmp_path / "d").iterdir()} == set(design_files([1, 3], 2))
    for own, row in zip(advice.finals, found["designs"], strict=True):
        codes = read_phase_codes(tmp_path / "d" / row["codes"])
        again = SpectralDepthCamera(**{**codes, "bands": own.camera.wavelengths, "size": own.camera.size})
        torch.testing.assert_close(again.tile()[1], own.camera.tile()[1])
    page = (tmp_path / "d" / "design.html").read_text()
    assert page.count(";base64,") == 2 + 2 * 4
    assert "readings of a pixel" in page
    with pytest.raises(OutputError, match="earlier"):
        design(tmp_path / "d", buckets=2, slots=[3])


def test_files_of_two_buckets_are_beside_those_of_one():
    more = {*design_files([1, 2], 2)} - {*design_files([1, 2])}
    assert more == {f"{kind}_k2_two_buckets.{end}" for kind, end in KINDS} | {"burst.nc", *BURST}
    assert design_files([1], 2) == design_files([1])


def test_slots_that_do_not_fit_the_exposure_are_left_out_or_refused(tmp_path):
    sheet = SensorSheet(exposure=0.01, pattern_rate=300)
    assert _counts(sheet, None) == [1, 2]
    with pytest.raises(SettingError, match="at most 3"):
        _counts(sheet, [4])
    with pytest.raises(SettingError, match="learnable"):
        design(tmp_path / "d", learn=("shutter",))
    assert not (tmp_path / "d").exists()
