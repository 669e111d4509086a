"""Captures that leave more than good ones do: a quality above 1 and a warning, or a fit that fails."""

import numpy as np
import pytest

from tests.lab.calibration.rays import pictures
from tests.lab.calibration.test_sensor import frames as sensor_frames
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.steps import measure
from tmca.lab.quality import Doubtful, quality_of


def test_quality_is_the_residual_over_what_is_usual():
    assert quality_of("file", "what is left", 0.25, 0.5) == 0.5
    assert quality_of("file", "what is left", float("nan"), 0.5) == 0
    with pytest.warns(Doubtful, match="file: what is left 1, usually 0.5 at most"):
        assert quality_of("file", "what is left", 1.0, 0.5) == 2


SQUARES = np.kron(np.random.default_rng(0).integers(2, size=(10, 11)), np.ones((4, 4)))[:37, :42]
CHANGING = {
    "dark": sensor_frames(0.0, 8) + 12000 * np.random.default_rng(0).integers(2, size=(8, 37, 42)),
    "flat": np.concatenate([sensor_frames(20000 * one, 4) for one in (SQUARES, 1 - SQUARES)]),
}


@pytest.mark.parametrize("step", CHANGING)
def test_light_that_changes_is_doubted_and_kept(tmp_path, step):
    start = Calibration.empty()
    if step == "flat":
        start = measure("dark", start, pictures(tmp_path / "dark", dict(enumerate(sensor_frames(0.0, 8)))))
        assert start.about["steps"]["dark"]["residuals"]["quality"] < 1
    with pytest.warns(Doubtful, match="noise of"):
        found = measure(step, start, pictures(tmp_path / "c", dict(enumerate(CHANGING[step]))))
    assert found.about["steps"][step]["residuals"]["quality"] > 1
