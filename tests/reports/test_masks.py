"""Phase masks for a sensor from Python: what is written and what it says."""

import json

import pytest

from tests.operators.test_window_moments import prior_of
from tmca.cameras.phase_codes import read_phase_codes
from tmca.design import MaskEffort, SensorSheet
from tmca.errors import OutputError, SettingError
from tmca.operators.window_moments import needed_block
from tmca.reports.masks import _counts, design_spectral_depth

TINY = {"bench": {"window": (5, 7), "mask_pixels": 24, "diameter": 1e-3}, "camera": {"planes": 3}, "bands": 2}


def design(out, **how):
    prior = prior_of(needed_block(3, (5, 7)))
    own = {**TINY, "prior": prior, "window": 3, "effort": MaskEffort(1, 1), "slots": [1], **how}
    return design_spectral_depth(SensorSheet(read_noise=0.01), out, **own)


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


def test_slots_that_do_not_fit_the_exposure_are_left_out_or_refused(tmp_path):
    sheet = SensorSheet(exposure=0.01, pattern_rate=300)
    assert _counts(sheet, None) == [1, 2]
    with pytest.raises(SettingError, match="at most 3"):
        _counts(sheet, [4])
    with pytest.raises(SettingError, match="learnable"):
        design(tmp_path / "d", learn=("shutter",))
    assert not (tmp_path / "d").exists()
