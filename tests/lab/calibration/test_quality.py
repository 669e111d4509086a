"""Captures in another order or of another kind: the fit fails, or residuals beyond their limits say so."""

from itertools import combinations, permutations

import numpy as np
import pytest
from PIL import Image

from tests.lab.calibration.rays import affine, noisy, or_refused
from tests.lab.calibration.test_optics import (
    BENCH,
    DEPTHS,
    NM,
    PATTERN,
    REGISTERED,
    VIEWS,
    WAVES,
    displaced,
    glass,
    mirror,
    points,
)
from tests.lab.calibration.test_sensor import READ
from tests.lab.calibration.test_sensor import frames as sensor_frames
from tmca.errors import DataError
from tmca.lab.calibration.bench_physics import seen_by_rays
from tmca.lab.calibration.captures import calibration_patterns
from tmca.lab.calibration.dispersion import measure_dispersion
from tmca.lab.calibration.displacement import measure_shear
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.fits import StepSettings
from tmca.lab.calibration.psf import fit_zernike_psf, measure_psf
from tmca.lab.calibration.registration import register
from tmca.lab.calibration.sensor import measure_dark, measure_linearity
from tmca.lab.calibration.steps import STEPS, measure
from tmca.lab.calibration.timing import measure_timing, pair_light, slot_overlap
from tmca.lab.quality import Doubtful, Limit, doubts, quality_of


def test_quality_is_the_largest_residual_over_its_limit():
    limits = {"one": Limit(0.5, "look"), "other": Limit(2.0, "there"), "missing": Limit(1.0, "")}
    residuals = {"one": -0.25, "other": 5.0, "free": 99.0}
    assert quality_of(residuals, limits) == 2.5
    assert doubts(residuals, limits) == ["other 5, usually 2 at most: there"]
    assert quality_of({"one": float("nan")}, limits) == 0


def pictures(folder, frames):
    folder.mkdir(parents=True)
    for name, frame in frames.items():
        Image.fromarray(np.asarray(np.round(frame), np.uint16)).save(folder / f"{name}.png")
    return folder


SQUARES = np.kron(np.random.default_rng(0).integers(2, size=(10, 11)), np.ones((4, 4)))[:37, :42]
DARK = dict(enumerate(sensor_frames(0.0, 8)))
BAD = {
    "light in the dark": ("dark", sensor_frames(50_000.0, 8), "level_of_saturation"),
    "changing light": (
        "dark",
        sensor_frames(0.0, 8) + 12000 * np.random.default_rng(0).integers(2, size=(8, 37, 42)),
        "noise_of_saturation",
    ),
    "a lamp that rises": ("dark", sensor_frames(0.0, 8) + np.linspace(0, 400, 8)[:, None, None], "drift_of_noise"),
    "uneven light": ("flat", sensor_frames(20000 * SQUARES, 8), "dead_share"),
    "two lights": (
        "flat",
        np.concatenate([sensor_frames(20000 * SQUARES, 4), sensor_frames(20000 * (1 - SQUARES), 4)]),
        "change_from_frame_to_frame",
    ),
}


@pytest.mark.parametrize(("step", "frames", "residual"), BAD.values(), ids=BAD)
def test_frames_of_another_light_are_doubted(tmp_path, step, frames, residual):
    start = Calibration.empty()
    if step != "dark":
        start = measure("dark", start, pictures(tmp_path / "dark", {f"d_{i}": one for i, one in DARK.items()}))
    with pytest.warns(Doubtful, match=residual.replace("_", " ")):
        found = measure(step, start, pictures(tmp_path / "c", {f"f_{i}": one for i, one in enumerate(frames)}))
    residuals = found.about["steps"][step]["residuals"]
    assert residuals["quality"] >= residuals[residual] / STEPS[step].limits[residual].most > 1


def test_a_sensor_that_warms_up_is_not_doubted():
    warm = measure_dark(sensor_frames(0.0, 8) + np.linspace(0, 4 * READ, 8)[:, None, None])
    assert warm.noise < 3 * READ
    assert warm.drift < STEPS["dark"].limits["drift_of_noise"].most


@pytest.mark.parametrize(("codes", "sensor", "snr"), [((33, 41), (35, 52), 40.0), ((40, 48), (40, 56), 20.0)])
def test_of_all_orders_of_the_patterns_one_is_registered(codes, sensor, snr):
    patterns, truth = calibration_patterns(codes), affine(codes, sensor, turn=0.4, shift=(0.3, -0.6))
    shown = noisy(900 * seen_by_rays(0.003 + 0.997 * patterns, truth, sensor, blur=0.3) + 40, snr)
    assert register(shown, patterns).offset(truth) < 0.05
    for order in list(permutations(range(4)))[1:]:
        with pytest.raises(DataError, match=r"order of the (patterns|frames)|one order"):
            register(shown[list(order)], patterns)


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


def test_another_scale_than_was_said_is_refused():
    codes, sensor = (40, 48), (56, 64)
    patterns, truth = calibration_patterns(codes), affine(codes, sensor, turn=0.4, scale=1.06)
    shown = noisy(900 * seen_by_rays(patterns, truth, sensor))
    assert register(shown, patterns).scale == pytest.approx(1.06, abs=2e-3)
    with pytest.raises(DataError, match=r"leaves 0\.071 between the scale and that which was said"):
        register(shown, patterns, scale=0.99)


def test_a_map_that_the_frames_do_not_tell_is_refused():
    codes, sensor = (16, 16), (24, 24)
    patterns, truth = calibration_patterns(codes, 1), affine(codes, sensor)
    shown = noisy(900 * seen_by_rays(patterns, truth, sensor, blur=1.6), 20)
    with pytest.raises(DataError, match=r"of doubt about the mask's corners, expected 0\.25 at most"):
        register(shown, patterns, start=truth)


TIMES = np.array([1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 35.0]) * 1e-3


@pytest.mark.parametrize("pair", [(0, 6), (2, 3), (4, 5)])
def test_two_exposures_under_each_others_names_are_doubted_or_refused(pair):
    top = 20000
    shown = np.stack([sensor_frames(1.9e6 * time, 2, seed, top) for seed, time in enumerate(TIMES)])
    dark, (one, other) = measure_dark(sensor_frames(0.0, 16, 99)), pair
    own = measure_linearity(TIMES, shown, dark, shown >= top)
    most = STEPS["linearity"].limits["frames_of_one_exposure"].most
    assert own.largest_deviation < 0.01
    assert own.unlike < most
    half = shown.copy()
    half[[one, other], 0] = half[[other, one], 0]
    words = r"off a line|do not grow"
    assert or_refused(lambda: measure_linearity(TIMES, half, dark, half >= top).unlike, words) > most
    shown[[one, other]] = shown[[other, one]]
    with pytest.raises(DataError, match=r"do not grow|off a line"):
        measure_linearity(TIMES, shown, dark, shown >= top)


@pytest.mark.parametrize(("slots", "delay"), [(3, 0.2), (4, 0.157)])
def test_two_pairs_of_slots_under_each_others_names_leave_a_residual(slots, delay):
    levels = pair_light(slot_overlap(slots, delay, 0.98), 0.003, 0.011)
    clean = measure_timing(levels, aperture_leakage=0.003).residual
    levels[0, 0], levels[0, 1] = levels[0, 1], levels[0, 0]
    left = or_refused(lambda: measure_timing(levels, aperture_leakage=0.003).residual, "no delay explains")
    assert left > 20 * clean + 0.01


@pytest.mark.parametrize("seed", range(3))
def test_lamps_that_flicker_are_measured(seed):
    flicker = 1 + 0.02 * np.random.default_rng(seed).standard_normal((4, 4))
    found = measure_timing(pair_light(slot_overlap(4, 0.157, 0.98), 0.003, 0.011) * flicker)
    assert found.delay == pytest.approx(0.157, abs=0.1)


@pytest.mark.parametrize("curve", ["cauchy", "measured"])
@pytest.mark.parametrize("order", [[0, 1, 2, 4, 3], [4, 3, 2, 1, 0]])
def test_wavelengths_in_another_order_are_refused_or_doubted(curve, order):
    shown = displaced(1.5 * glass(NM))
    own = measure_dispersion(shown, NM * 1e-9, PATTERN, REGISTERED, curve=curve)
    assert (own.turning_back(), own.red_beyond_blue()) == (0, 0)

    def over():
        other = measure_dispersion(shown[order], NM * 1e-9, PATTERN, REGISTERED, curve=curve)
        own = {"turning_back_pixels": other.turning_back(), "red_beyond_blue_pixels": other.red_beyond_blue()}
        return quality_of(own, STEPS["dispersion"].limits)

    assert or_refused(over, "check the wavelengths") > 1


def test_a_grating_displaces_blue_and_red_alike():
    even = np.stack([0 * NM, (NM - 550) / 25], axis=1)
    for shifts in (even, -even):
        found = measure_dispersion(displaced(shifts), NM * 1e-9, PATTERN, REGISTERED)
        assert np.abs(found.shifts - shifts).max() < 0.05
        assert found.red_beyond_blue() == 0


def test_rows_and_columns_of_views_in_each_others_place_are_doubted():
    views, most = [(v, u) for v in (-1, 0, 1) for u in (-1, 0, 1)], STEPS["shear"].limits["along_the_other_axis"].most
    shown = displaced([(-0.9 * v, -1.1 * u) for v, u in views])
    assert measure_shear(shown, views, PATTERN, REGISTERED).turned() < most
    assert measure_shear(shown, [(u, v) for v, u in views], PATTERN, REGISTERED).turned() > most


@pytest.mark.slow
def test_every_two_views_under_each_others_names_are_refused():
    shown = displaced([(-0.9 * v, -1.1 * u) for v, u in VIEWS])
    for one, other in list(combinations(range(9), 2))[::5]:
        order = np.arange(9)
        order[[one, other]] = other, one
        with pytest.raises(DataError, match="which view"):
            measure_shear(shown[order], VIEWS, PATTERN, REGISTERED)


@pytest.mark.slow
@pytest.mark.parametrize("depth", [0, 2])
def test_two_wavelengths_of_a_point_under_each_others_names_are_refused_or_doubted(depth):
    shown = points(mirror(1, 0.08e-6), seed=1)
    assert fit_zernike_psf(measure_psf(shown, DEPTHS, WAVES, BENCH.window), BENCH).worst < 1
    shown[depth] = shown[depth, ::-1]
    stack = measure_psf(shown, DEPTHS, WAVES, BENCH.window)
    assert or_refused(lambda: fit_zernike_psf(stack, BENCH).worst, "best fit leaves") > 1


def test_a_step_needs_those_before_it(tmp_path):
    with pytest.raises(DataError, match="found no dark, expected one, on which flat builds"):
        measure("flat", Calibration.empty(), tmp_path)
    with pytest.raises(DataError, match="found no registration, expected one, on which shear builds"):
        measure("shear", Calibration.empty(), tmp_path, StepSettings(tmp_path))
