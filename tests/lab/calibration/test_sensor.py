"""Dark, flat, linearity and timing, of sensors and slots whose true numbers are known."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tmca.codes import slot_overlap as repeated_overlap
from tmca.errors import DataError, SettingError
from tmca.lab.calibration.figures import part_figure
from tmca.lab.calibration.sensor import DEAD, HOT, measure_dark, measure_flat, measure_linearity
from tmca.lab.calibration.timing import Timing, measure_timing, pair_light, slot_overlap
from tmca.lab.quality import Doubtful

SIZE = (37, 42)
GAIN, READ, OFFSET = 2.5, 4.0, 300.0
"""Electrons per digital number, digital numbers of read noise, and of offset."""


def frames(light, count, seed=0, top=65535):
    """Digital numbers of a sensor under light in electrons (H, W)."""
    rng = np.random.default_rng(seed)
    electrons = rng.poisson(np.broadcast_to(light, (count, *SIZE)))
    return np.clip(np.round(OFFSET + electrons / GAIN + READ * rng.standard_normal(electrons.shape)), 0, top)


def test_offset_and_read_noise_are_those_of_the_sensor():
    dark = measure_dark(frames(0.0, 64))
    assert np.abs(dark.mean - OFFSET).mean() < READ / np.sqrt(64)
    assert dark.noise == pytest.approx(np.hypot(READ, np.sqrt(1 / 12)), rel=0.02)
    assert not dark.defects.any()
    assert dark.mean.shape == SIZE


@pytest.mark.parametrize("count", [4, 16])
def test_hot_noisy_and_dead_pixels_are_found_and_no_others(count):
    rng = np.random.default_rng(1)
    black, light = frames(0.0, count), frames(20000.0, count, 2)
    black[:, 3, 5] += 500
    black[:, 30, 8] += 400 * rng.standard_normal(count)
    light[:, 3, 5] += 500
    light[:, 11, 40] = OFFSET + 100
    dark = measure_dark(black)
    flat = measure_flat(light, dark)
    assert set(zip(*np.nonzero(dark.defects == HOT), strict=True)) == {(3, 5), (30, 8)}
    assert set(zip(*np.nonzero(flat.defects == DEAD), strict=True)) == {(11, 40)}


def test_the_flat_field_is_response_times_light():
    rng = np.random.default_rng(3)
    response = 1 + 0.01 * rng.standard_normal(SIZE)
    shade = 1 - 0.2 * np.linspace(-1, 1, SIZE[1]) ** 2
    flat = measure_flat(frames(40000 * response * shade, 32), measure_dark(frames(0.0, 32, 1)))
    truth = response * shade / (response * shade).mean()
    assert np.sqrt(((flat.gain - truth) ** 2).mean()) == pytest.approx(flat.std, rel=0.15)
    assert flat.level == pytest.approx(40000 / GAIN * (response * shade).mean(), rel=1e-3)
    assert flat.nonuniformity == pytest.approx(0.01, rel=0.15)


def test_dark_and_flat_refuse_what_they_are_not():
    dark = measure_dark(frames(0.0, 8))
    with pytest.raises(DataError, match="two or more"):
        measure_dark(frames(0.0, 1))
    with pytest.raises(DataError, match="ten times its noise"):
        measure_flat(frames(20.0, 8), dark)
    with pytest.raises(DataError, match="36×42 pixels, expected 37×42"):
        measure_flat(frames(20.0, 8)[:, 1:], dark)
    mixed = frames(0.0, 8)
    mixed[:, :, ::7] += 4000
    with pytest.raises(DataError, match="cover the lens"):
        measure_dark(mixed)


def series(times, bend=0.0, top=65535, count=2):
    """(E, N, H, W) at 30000 electrons a second; ``bend`` of the signal is lost at 2 s."""
    clean = [30000 * t * (1 - bend * t / 2) for t in times]
    return np.stack([frames(light, count, 10 + i, top) for i, light in enumerate(clean)])


def test_electrons_and_saturation_are_those_of_the_sensor():
    times, top = np.array([0.05, 0.1, 0.2, 0.4, 0.8, 1.2, 1.6, 2.4, 3.0]), 20000
    seen = series(times, top=top)
    found = measure_linearity(times[::-1], seen[::-1], measure_dark(frames(0.0, 32)), seen[::-1] >= top)
    assert found.gain == pytest.approx(GAIN, rel=0.03)
    assert abs(found.gain - GAIN) < 5 * found.gain_std
    assert found.slope == pytest.approx(30000 / GAIN, rel=2e-3)
    assert found.largest_deviation < 5e-3
    assert found.saturation == pytest.approx(top - OFFSET, rel=0.01)
    assert found.full_well == pytest.approx(GAIN * (top - OFFSET), rel=0.04)
    said = found.electrons("series")
    std = said["read_noise_electrons_std"]
    assert abs(said["read_noise_electrons"] - GAIN * np.hypot(READ, np.sqrt(1 / 12))) < 5 * std < 0.5 * GAIN * READ
    assert np.isnan(found.deviations[-2:]).all()


def test_electrons_that_are_less_sure_than_large_are_not_known():
    times = np.linspace(0.2, 2.0, 8)
    found = measure_linearity(times, series(times), measure_dark(frames(0.0, 32)))
    assert found.electrons("series")["electrons_per_dn"] == found.gain
    lost = replace(found, gain=56493.0, gain_std=76510.0)
    with pytest.warns(Doubtful, match=r"series: 5\.65e\+04 ± 7\.65e\+04 electrons per digital number: not known"):
        assert all(np.isnan(value) for value in lost.electrons("series").values())


def test_a_bent_response_is_measured_and_a_strongly_bent_one_refused():
    times, dark = np.linspace(0.2, 2.0, 8), measure_dark(frames(0.0, 32))
    bent = measure_linearity(times, series(times, bend=0.04), dark)
    line = np.polynomial.polynomial.polyfit(times, times * (1 - 0.02 * times), 1, w=1 / times)
    wanted = times * (1 - 0.02 * times) / (line[0] + line[1] * times) - 1
    assert bent.largest_deviation == pytest.approx(np.abs(wanted).max(), rel=0.3)
    with pytest.raises(DataError, match="gamma"):
        measure_linearity(times, series(times, bend=0.4), dark)
    with pytest.raises(DataError, match="three or more"):
        measure_linearity(times[:2], series(times[:2]), dark)
    with pytest.raises(DataError, match="do not grow"):
        measure_linearity(times, series(times)[[0, 2, 1, 3, 4, 5, 6, 7]], dark)


@pytest.mark.parametrize(("slots", "delay"), [(4, 0.25), (5, -0.3), (9, 0.4)])
def test_an_exposure_that_repeats_is_told_from_one_alone(slots, delay):
    starts = delay + torch.arange(slots, dtype=torch.float64)
    levels = 800 * repeated_overlap(slots, starts, starts + 1).T.numpy()
    found = measure_timing(levels + np.random.default_rng(1).standard_normal(levels.shape))
    assert found.repeats
    assert found.delay == pytest.approx(delay, abs=0.01)
    assert np.abs(found.overlap() - levels / 800).max() < 0.01
    assert not measure_timing(800 * slot_overlap(slots, delay)).repeats


def followed(slots, delay, ratio, aperture, shutter, repeats):
    """Light of every pair of slots, instant by instant over the exposure."""
    time = (np.arange(slots * 4000) + 0.5) / 4000
    on = np.floor((time - delay) / ratio)
    if repeats:
        on = np.floor((time - delay) % slots / ratio)
    masks = [np.where(np.floor(time) == i, 1.0, aperture) for i in range(slots)]
    shutters = [np.where(on == j, 1.0, shutter) for j in range(slots)]
    return np.array([[(one * other).sum() / 4000 for other in shutters] for one in masks])


@settings(max_examples=30, deadline=None)
@given(
    slots=st.integers(2, 7), delay=st.floats(-1.5, 1.5), ratio=st.floats(0.6, 1.3), aperture=st.floats(0, 0.1),
    shutter=st.floats(0, 0.3), repeats=st.booleans(),
)  # fmt: skip
def test_light_of_pairs_is_that_of_instants(slots, delay, ratio, aperture, shutter, repeats):
    ratio = 1.0 if repeats else ratio
    found = pair_light(slot_overlap(slots, delay, ratio, repeats), aperture, shutter)
    assert np.abs(found - followed(slots, delay, ratio, aperture, shutter, repeats)).max() < 3e-3


@pytest.mark.parametrize("slots", [3, *(pytest.param(slots, marks=pytest.mark.slow) for slots in (4, 7))])
@pytest.mark.parametrize("repeats", [False, True])
@pytest.mark.parametrize(
    ("delay", "ratio", "aperture", "shutter"),
    [(0.0, 0.98, 0.02, 0.0), (0.21, 0.98, 0.0, 0.05), (-0.17, 0.98, 0.01, 0.15), (0.3, 0.98, 0.005, 0.004),
     (-0.32, 1.05, 0.0, 0.0), (1.21, 1.0, 0.0, 0.0)],
)  # fmt: skip
def test_leakage_is_found_again_beside_delay_and_ratio(slots, repeats, delay, ratio, aperture, shutter):
    ratio = 1.0 if repeats else ratio
    levels = 6000 * followed(slots, delay, ratio, aperture, shutter, repeats)
    levels += 3 * np.random.default_rng(slots).standard_normal(levels.shape)
    found = measure_timing(levels, aperture_leakage=aperture)
    assert found.leakage == pytest.approx(shutter, abs=0.0015)
    assert (found.delay, found.ratio) == pytest.approx((delay, ratio), abs=0.004)
    assert np.abs(found.overlap() - slot_overlap(slots, delay, ratio, repeats)).max() < 0.01
    assert found.light == pytest.approx(6000, rel=0.005)
    assert found.repeats == (repeats and delay != 0)
    if aperture:  # what the mask leaks is counted to the shutter where it is not known
        assert measure_timing(levels).leakage == pytest.approx(shutter + aperture, abs=0.004 + 6 * shutter * aperture)


@pytest.mark.slow
def test_the_deviation_of_a_leakage_is_that_of_many_captures():
    clean = 1000 * followed(4, 0.2, 1.0, 0.01, 0.02, False)
    noise = 2 * np.random.default_rng(0).standard_normal((40, 4, 4))
    found = [measure_timing(clean + one, aperture_leakage=0.01) for one in noise]
    spread = np.std([one.leakage for one in found], ddof=1)
    assert np.mean([one.leakage_std for one in found]) == pytest.approx(spread, rel=0.35)
    wide = measure_timing(clean, aperture_leakage=0.01, aperture_leakage_std=0.003)
    assert wide.leakage_std == pytest.approx(0.003, rel=0.01)


def test_without_pairs_that_never_meet_the_least_leakage_is_taken():
    levels = 1000 * followed(4, 0.2, 0.98, 0.01, 0.02, False)
    met = np.eye(4) + np.eye(4, k=-1) > 0
    found = measure_timing(np.where(met, levels, np.nan), aperture_leakage=0.01)
    assert found.leakage <= 0.02
    assert (found.delay, found.ratio) == pytest.approx((0.2, 0.98), abs=0.01)
    there = found.light * pair_light(found.overlap(), 0.01, found.leakage)
    assert np.abs(there - levels)[met].max() < 1


def test_two_slots_give_the_explanation_of_least_leakage():
    alone = measure_timing(500 * followed(2, 0.2, 1.0, 0.01, 0.02, False), aperture_leakage=0.01)
    assert (alone.repeats, alone.delay, alone.leakage) == pytest.approx((False, 0.2, 0.02), abs=2e-3)
    again = measure_timing(500 * followed(2, 0.2, 1.0, 0.0, 0.0, True))
    # late and early are the same where two slots repeat
    assert (again.repeats, abs(again.delay), again.leakage) == pytest.approx((True, 0.2, 0.0), abs=2e-3)
    assert np.isnan(alone.std).all()


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("slots", [2, 3, 4])
def test_a_shutter_that_never_closes_has_no_timing(slots, seed):
    levels = 8000 * (1 + 0.01 * np.random.default_rng(seed).standard_normal((slots, slots)))
    with pytest.raises(DataError, match="does the shutter close"):
        measure_timing(levels)


def test_as_many_levels_as_numbers_tell_nothing():
    levels = 8000 * followed(4, 0.1566, 1.0, 0.003, 0.011, False) + np.random.default_rng(0).standard_normal((4, 4))
    with pytest.raises(SettingError, match="4 levels that are known, expected 5 or more"):
        measure_timing(np.where(np.eye(4) > 0, levels, np.nan))
    near = np.where(np.abs(np.subtract.outer(range(4), range(4))) <= 1, levels, np.nan)
    found = measure_timing(near, aperture_leakage=0.003)
    assert (found.delay, found.leakage) == pytest.approx((0.1566, 0.011), abs=1e-3)


@pytest.mark.parametrize(
    ("levels", "error", "words"),
    [
        (np.ones((4, 4)) + np.eye(4) / 2, DataError, "of the light in closed slots, expected 50% at most"),
        (np.random.default_rng(0).uniform(0, 1, (4, 4)), DataError, "no delay explains"),
        (np.zeros((4, 4)), DataError, "no light"),
        (np.ones((1, 1)), SettingError, "two slots"),
    ],
)
def test_levels_that_no_delay_explains_are_refused(levels, error, words):
    with pytest.raises(error, match=words):
        measure_timing(levels)


@pytest.mark.parametrize("seed", range(3))
def test_lamps_that_flicker_are_measured(seed):
    flicker = 1 + 0.02 * np.random.default_rng(seed).standard_normal((4, 4))
    found = measure_timing(pair_light(slot_overlap(4, 0.157, 0.98), 0.003, 0.011) * flicker)
    assert found.delay == pytest.approx(0.157, abs=0.1)


def test_a_delay_that_rounds_to_zero_is_drawn_without_a_sign_of_its_own():
    part = Timing(-1e-6, 1.0, np.zeros(2), 1.0, 0.0, slots=2)
    assert part_figure({"timing": part}, "timing", "timing").axes[0].get_title().startswith("delay +0.0000 slots")
