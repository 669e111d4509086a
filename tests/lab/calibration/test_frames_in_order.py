"""Captures under each other's names: what the light in them tells, and what it cannot."""

from itertools import combinations, permutations

import numpy as np
import pytest

from tests.lab.calibration.rays import affine, noisy
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
from tests.lab.calibration.test_sensor import frames as sensor_frames
from tmca.errors import DataError
from tmca.lab.calibration.measurements.dark_flat import measure_dark
from tmca.lab.calibration.measurements.dispersion import measure_dispersion
from tmca.lab.calibration.measurements.linearity import measure_linearity
from tmca.lab.calibration.measurements.psf import measure_psf
from tmca.lab.calibration.measurements.registration import register
from tmca.lab.calibration.measurements.shear import measure_shear
from tmca.lab.calibration.measurements.timing import measure_timing, pair_light, slot_overlap
from tmca.lab.calibration.measurements.zernike_fit import fit_zernike_psf
from tmca.lab.calibration.patterns import calibration_patterns
from tmca.lab.calibration.rendered.physics import seen_by_rays


@pytest.mark.parametrize(("codes", "sensor", "snr"), [((33, 41), (35, 52), 40.0), ((40, 48), (40, 56), 20.0)])
def test_of_all_orders_of_the_patterns_one_is_registered(codes, sensor, snr):
    patterns, truth = calibration_patterns(codes), affine(codes, sensor, turn=0.4, shift=(0.3, -0.6))
    shown = noisy(900 * seen_by_rays(0.003 + 0.997 * patterns, truth, sensor, blur=0.3) + 40, snr)
    assert register(shown, patterns).offset(truth) < 0.05
    for order in list(permutations(range(4)))[1:]:
        with pytest.raises(DataError, match=r"order of the (patterns|frames)"):
            register(shown[list(order)], patterns)


def test_the_frame_that_shows_another_pattern_is_named():
    patterns = calibration_patterns((24, 28))
    shown = noisy(900 * seen_by_rays(patterns, affine((24, 28), (24, 32)), (24, 32)))[[2, 1, 0, 3]]
    with pytest.raises(DataError, match="frame c brighter than the open pattern's on 4"):
        register(shown, patterns, names=list("abcd"))


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
    with pytest.raises(DataError, match=r"found 1\.06 sensor pixels per mask pixel, expected 0\.99, to 6%"):
        register(shown, patterns, scale=0.99)


def test_a_map_that_the_frames_do_not_tell_is_refused():
    codes, sensor = (16, 16), (24, 24)
    patterns, truth = calibration_patterns(codes, 1), affine(codes, sensor)
    shown = noisy(900 * seen_by_rays(patterns, truth, sensor, blur=1.6), 20)
    with pytest.raises(DataError, match=r"corners uncertain by \d\.\d+ pixels, expected 0\.25 at most"):
        register(shown, patterns, start=truth)


TIMES = np.array([1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 35.0]) * 1e-3


@pytest.mark.parametrize("pair", list(combinations(range(7), 2)))
def test_two_exposures_under_each_others_names_are_refused(pair):
    top = 20000
    shown = np.stack([sensor_frames(1.9e6 * time, 2, seed, top) for seed, time in enumerate(TIMES)])
    dark, (one, other) = measure_dark(sensor_frames(0.0, 16, 99)), pair
    assert measure_linearity(TIMES, shown, dark, shown >= top).largest_deviation < 0.01
    half = shown.copy()
    half[[one, other], 0] = half[[other, one], 0]
    with pytest.raises(DataError, match=r"in frames of one exposure, \d+ ms"):
        measure_linearity(TIMES, half, dark, half >= top)
    shown[[one, other]] = shown[[other, one]]
    with pytest.raises(DataError, match="do not grow"):
        measure_linearity(TIMES, shown, dark, shown >= top)


def test_frames_of_one_exposure_are_held_to_their_mean():
    shown = np.stack([sensor_frames(1.9e6 * time, 2, seed, 20000) for seed, time in enumerate(TIMES)])
    dark = measure_dark(sensor_frames(0.0, 16, 99))
    offset = dark.mean.mean()
    for apart in (0.08, 0.12):
        away = np.array([1 - apart / 2, 1 + apart / 2])[:, None, None]
        seen = shown.copy()
        seen[3] = offset + (shown[3] - offset) * away
        if apart < 0.1:
            assert measure_linearity(TIMES, seen, dark, shown >= 20000).largest_deviation < 0.01
            continue
        with pytest.raises(DataError, match="one exposure, 10 ms, expected each within 5% of their mean"):
            measure_linearity(TIMES, seen, dark, shown >= 20000)


@pytest.mark.parametrize(("slots", "delay", "tried"), [(3, 0.2, 20), (4, 0.157, 8)])
def test_two_pairs_of_slots_under_each_others_names_are_refused_or_alike(slots, delay, tried):
    rng = np.random.default_rng(0)
    levels = pair_light(slot_overlap(slots, delay, 0.98), 0.003, 0.011) + 1e-4 * rng.standard_normal((slots, slots))
    pairs, named = list(combinations(np.ndindex(slots, slots), 2)), 0
    for one, other in (pairs[n] for n in rng.permutation(len(pairs))[:tried]):
        changed = levels.copy()
        changed[one], changed[other] = levels[other], levels[one]
        if abs(levels[one] - levels[other]) > 2e-3:
            with pytest.raises(DataError, match="which slots each capture had open") as refused:
                measure_timing(changed, aperture_leakage=0.003)
            if "exchanged" in (said := str(refused.value)):
                own = [f"aperture_{i}_shutter_{j}" for i, j in (one, other)]
                assert f"only with {own[0]} and {own[1]} exchanged" in said
                named += 1
            else:
                assert "a fit leaves" in said
        else:
            assert measure_timing(changed, aperture_leakage=0.003).delay == pytest.approx(delay, abs=2e-3)
    assert named >= 2


@pytest.mark.parametrize("seed", range(3))
def test_lamps_that_flicker_exchange_nothing(seed):
    flicker = 1 + 0.02 * np.random.default_rng(seed).standard_normal((4, 4))
    assert measure_timing(pair_light(slot_overlap(4, 0.157, 0.98), 0.003, 0.011) * flicker).residual > 2e-3


def test_of_three_slots_lamps_that_flicker_exchange_nothing():
    for seed in range(40):
        rng = np.random.default_rng(seed)
        levels = pair_light(slot_overlap(3, delay := rng.uniform(-0.4, 0.4), 0.98), 0.003, 0.011)
        found = measure_timing(levels * (1 + 0.03 * rng.standard_normal((3, 3))))
        assert found.delay == pytest.approx(delay, abs=0.1)


@pytest.mark.parametrize(
    ("curve", "order"),
    [("cauchy", [0, 1, 2, 4, 3]), ("measured", [0, 1, 2, 4, 3]), ("cauchy", [4, 3, 2, 1, 0])],
)
def test_wavelengths_in_another_order_are_refused(curve, order):
    shown = displaced(1.5 * glass(NM))
    assert measure_dispersion(shown, NM * 1e-9, PATTERN, REGISTERED, curve=curve).shifts.shape == (5, 2)
    with pytest.raises(DataError, match="check the wavelengths"):
        measure_dispersion(shown[order], NM * 1e-9, PATTERN, REGISTERED, curve=curve)


def test_without_a_curve_red_light_may_be_spread_wider():
    """By whole pixels, which lie on no smooth curve; a reader is told."""
    shown, waves = displaced(np.stack([0 * NM, [0, 1, 2, 6, 11]], axis=1)), NM * 1e-9
    found = measure_dispersion(shown, waves, PATTERN, REGISTERED, curve="measured")
    assert found.red_and_blue() == pytest.approx((9, 2), abs=0.1)
    assert measure_dispersion(displaced(glass(NM)), waves, PATTERN, REGISTERED).red_and_blue() is None
    with pytest.raises(DataError, match=r"as by glass or gratings.*--curve polynomial or measured"):
        measure_dispersion(shown, waves, PATTERN, REGISTERED)
    assert measure_dispersion(shown, waves, PATTERN, REGISTERED, red_wider=True).shifts.shape == (5, 2)


def test_a_grating_displaces_blue_and_red_alike():
    even = np.stack([0 * NM, (NM - 550) / 25], axis=1)
    for shifts in (even, -even):
        found = measure_dispersion(displaced(shifts), NM * 1e-9, PATTERN, REGISTERED)
        assert np.abs(found.shifts - shifts).max() < 0.05


def test_rows_and_columns_of_views_in_each_others_place_are_refused():
    views = [(v, u) for v in (-1, 0, 1) for u in (-1, 0, 1)]
    shown = displaced([(-0.9 * v, -1.1 * u) for v, u in views])
    assert measure_shear(shown, views, PATTERN, REGISTERED).residual < 0.05
    with pytest.raises(DataError, match=r"1\.1\d pixels per view along the other axis"):
        measure_shear(shown, [(u, v) for v, u in views], PATTERN, REGISTERED)


def test_every_two_views_under_each_others_names_are_refused():
    shown = displaced([(-0.9 * v, -1.1 * u) for v, u in VIEWS])
    for one, other in list(combinations(range(9), 2))[::5]:
        order = np.arange(9)
        order[[one, other]] = other, one
        with pytest.raises(DataError, match="which view"):
            measure_shear(shown[order], VIEWS, PATTERN, REGISTERED)


@pytest.mark.parametrize("depth", [0, 2])
def test_two_wavelengths_of_a_point_under_each_others_names_are_refused(depth):
    shown = points(mirror(1, 0.08e-6), seed=1)
    fit_zernike_psf(measure_psf(shown, DEPTHS, WAVES, BENCH.window), BENCH)
    shown[depth] = shown[depth, ::-1]
    with pytest.raises(DataError, match=r"of which the (best )?fit leaves"):
        fit_zernike_psf(measure_psf(shown, DEPTHS, WAVES, BENCH.window), BENCH)
