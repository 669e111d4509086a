"""Captures that leave more than good ones do: a quality above 1 and a warning, or a fit that fails."""

import numpy as np
import pytest

from studies.ray_physics import seen_by_rays
from tests.lab.calibration.rays import affine, noisy, pictures
from tests.lab.calibration.test_sensor import frames as sensor_frames
from tmca.errors import DataError
from tmca.lab.calibration.captures import calibration_patterns
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.registration import register
from tmca.lab.calibration.steps import measure
from tmca.lab.calibration.timing import measure_timing, pair_light, slot_overlap
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


@pytest.mark.parametrize(
    ("codes", "sensor", "scale", "shift"),
    [((16, 16), (64, 70), 1.0, (9, -12)), ((40, 48), (40, 48), 0.5, (0, 0)), ((40, 48), (40, 48), 1.0, (14, 3))],
)
def test_a_small_image_of_the_mask_and_one_half_beside_the_sensor_are_registered(codes, sensor, scale, shift):
    patterns = calibration_patterns(codes)
    truth = affine(codes, sensor, turn=0.3, scale=scale, shift=shift)
    light = 1 - 0.5 * np.hypot(*np.meshgrid(*(np.linspace(-0.7, 0.7, n) for n in sensor), indexing="ij"))
    shown = noisy(900 * light * seen_by_rays(patterns, truth, sensor, blur=0.2), 30)
    assert register(shown, patterns, scale=scale).offset(truth) < 0.1


def test_a_map_that_the_frames_do_not_tell_is_refused():
    codes, sensor = (16, 16), (24, 24)
    patterns, truth = calibration_patterns(codes, 1), affine(codes, sensor)
    shown = noisy(900 * seen_by_rays(patterns, truth, sensor, blur=1.6), 20)
    with pytest.raises(DataError, match=r"of doubt about the mask's corners, expected 0\.25 at most"):
        register(shown, patterns, start=truth)


@pytest.mark.parametrize("seed", range(3))
def test_lamps_that_flicker_are_measured(seed):
    flicker = 1 + 0.02 * np.random.default_rng(seed).standard_normal((4, 4))
    found = measure_timing(pair_light(slot_overlap(4, 0.157, 0.98), 0.003, 0.011) * flicker)
    assert found.delay == pytest.approx(0.157, abs=0.1)
