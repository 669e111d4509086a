"""Dispersion, shear and wavefronts, found again from captures that plain physics made of hidden numbers."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from studies.ray_physics import point_of, seen_by_rays
from tests.lab.calibration.rays import affine, noisy
from tmca.errors import DataError, SettingError, ShapeError
from tmca.lab.calibration.captures import calibration_patterns
from tmca.lab.calibration.displacement import displacement_of, measure_dispersion, measure_shear
from tmca.lab.calibration.pattern_image import moved
from tmca.lab.calibration.psf import MODES, fit_zernike_psf, measure_psf, wavefront_rms
from tmca.lab.calibration.registration import Registration
from tmca.optics import PhaseMaskBench
from tmca.optics.zernike import zernike_modes

CODES, SENSOR = (25, 32), (29, 51)
PATTERN = calibration_patterns(CODES)[3]
REGISTERED = Registration(affine(CODES, SENSOR, 0.5, 1.01), np.zeros((2, 3)), 0.0, 0.0, CODES, SENSOR, 550e-9)
NM = np.array([450.0, 500.0, 550.0, 600.0, 650.0])


def glass(nm):
    """(n, 2) displacement of a prism by a curve that is no polynomial of low order in anything."""
    wave = nm * 1e-3
    index = np.sqrt(1 + 1.04 * wave**2 / (wave**2 - 0.006) + 0.23 * wave**2 / (wave**2 - 0.02))
    middle = np.sqrt(1 + 1.04 * 0.55**2 / (0.55**2 - 0.006) + 0.23 * 0.55**2 / (0.55**2 - 0.02))
    return np.stack([0.02 * (nm - 550) / 100, -400 * (index - middle)], axis=1)


def displaced(shifts, light=1000.0, snr=40.0, seed=0):
    return np.stack(
        [
            noisy(level * seen_by_rays(PATTERN[None], moved(REGISTERED.matrix, shift), SENSOR), snr, seed + i)[0]
            for i, (shift, level) in enumerate(zip(shifts, np.broadcast_to(light, len(shifts)), strict=True))
        ]
    )


@cache
def through_glass():
    return displaced(glass(NM))


@cache
def dispersed(curve):
    return measure_dispersion(through_glass()[::-1], NM[::-1] * 1e-9, PATTERN, REGISTERED, curve=curve)


@pytest.mark.parametrize("curve", ["cauchy", "polynomial"])
def test_the_dispersion_of_glass_is_found_again_to_a_tenth_of_a_pixel(curve):
    found = dispersed(curve)
    between = np.linspace(450, 650, 9)
    assert np.abs(found.at(between * 1e-9) - glass(between)).max() < 0.1
    assert np.abs(found.shifts - glass(NM)).max() < 0.03
    bands = found.dispersion((NM * 1e-9).tolist(), start=3.0)
    assert np.abs(np.array(bands.displacement) - 3 - glass(NM)[:, 1]).max() < 0.1


def test_response_is_light_over_the_power_of_the_source():
    response, power = np.array([0.6, 1.1, 1.4, 1.2, 0.7]), np.array([2.0, 3.0, 5.0, 4.0, 1.0])
    found = measure_dispersion(
        displaced(glass(NM), 300 * response * power), NM * 1e-9, PATTERN, REGISTERED, power=power
    )
    assert np.abs(found.response / (response / response.mean()) - 1).max() < 0.01
    assert found.response_at([475e-9])[0] == pytest.approx((0.6 + 1.1) / 2 / response.mean(), rel=0.01)


def test_dispersion_refuses_what_cannot_be():
    frames = through_glass()
    with pytest.raises(DataError, match="smooth curve leaves"):
        measure_dispersion(frames[[0, 4, 2]], NM[[0, 2, 4]] * 1e-9, PATTERN, REGISTERED, order=1)
    dark = frames * (NM != 500)[:, None, None]
    with pytest.raises(DataError, match=r"dispersion \(500 nm\): found a frame without light"):
        measure_dispersion(dark, NM * 1e-9, PATTERN, REGISTERED)
    with pytest.raises(DataError, match=r"dispersion \(500 nm\): found a pattern that is not seen"):
        measure_dispersion(noisy(dark + 1, 20), NM * 1e-9, PATTERN, REGISTERED)
    with pytest.raises(SettingError, match="a number above 0 for each"):
        measure_dispersion(frames, NM * 1e-9, PATTERN, REGISTERED, power=[1, 1, 0, 1, 1])
    with pytest.raises(SettingError, match="metres"):
        measure_dispersion(frames, NM, PATTERN, REGISTERED)
    with pytest.raises(SettingError, match="one less than the captures"):
        measure_dispersion(frames, NM * 1e-9, PATTERN, REGISTERED, order=5)
    with pytest.raises(ShapeError, match="as registered"):
        measure_dispersion(frames, NM * 1e-9, PATTERN[1:], REGISTERED)
    with pytest.raises(SettingError, match="measure the dispersion over all bands"):
        dispersed("cauchy").at([400e-9])


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_few_wavelengths_need_no_curve(count):
    frames = through_glass()[:count]
    found = measure_dispersion(frames, NM[:count] * 1e-9, PATTERN, REGISTERED, curve="measured")
    assert np.abs(found.at(NM[:count] * 1e-9) - glass(NM[:count])).max() < 0.02


@pytest.mark.slow
def test_a_curve_through_every_wavelength_leaves_nothing_that_is_known():
    frames = displaced(glass(NM))
    found = [measure_dispersion(frames, NM * 1e-9, PATTERN, REGISTERED, order=order) for order in (3, 4)]
    assert [bool(np.isfinite(one.residual).all()) for one in found] == [True, False]


@pytest.mark.parametrize("share", [(0.7, 0.0), (0.5, 0.3), (0.3, 0.1)])
def test_a_shift_shared_out_between_pixels_is_found_by_its_centre(share):
    """As a simulated bench displaces: first the mask, which is registered, then the light, each between two pixels."""
    first, second = share
    seen = seen_by_rays(PATTERN[None], moved(REGISTERED.matrix, (0.0, 1.0)), SENSOR)[0]
    mask = (1 - first) * seen + first * np.roll(seen, 1, axis=1)
    known = replace(REGISTERED, matrix=moved(REGISTERED.matrix, (0.0, 1.0 + first)), blur=np.sqrt(first * (1 - first)))
    light = (1 - second) * mask + second * np.roll(mask, 1, axis=1)
    found = displacement_of(1000 * light, PATTERN, known)
    assert np.abs(found.shift - (0, second)).max() < 0.035


def test_light_that_ends_before_the_mask_displaces_nothing():
    frame = 1000 * seen_by_rays(PATTERN[None], REGISTERED.matrix, SENSOR)[0]
    left = int(np.flatnonzero(frame.sum(axis=0) > 0)[0])
    frame[:, left : left + 2] = 0
    assert np.abs(displacement_of(frame, PATTERN, REGISTERED).shift).max() < 5e-3


@pytest.mark.slow
def test_the_deviation_of_a_shift_is_that_of_many_captures():
    clean = displaced([(0.3, 1.2)], snr=300)[0]
    noise = 20 * np.random.default_rng(0).standard_normal((12, *SENSOR))
    found = [displacement_of(clean + one, PATTERN, REGISTERED) for one in noise]
    spread = np.std([one.shift for one in found], axis=0, ddof=1)
    assert np.mean([one.std for one in found], axis=0) == pytest.approx(spread, rel=0.6)


VIEWS = [(v, u) for v in (-1, 0, 1) for u in (-2, 0, 2)]


@pytest.mark.slow
@pytest.mark.parametrize("step", [(1.0, 1.0), (0.87, 1.13), (-0.4, 0.55)])
def test_shear_is_found_again_to_a_fiftieth_of_a_pixel_per_view(step):
    shifts = [(0.1 - step[0] * v, -0.2 - step[1] * u) for v, u in VIEWS]
    share = np.array([1 - 0.05 * (v * v + u * u) for v, u in VIEWS])
    found = measure_shear(displaced(shifts, 800 * share), VIEWS, PATTERN, REGISTERED)
    assert np.abs(found.step - step).max() < 0.02
    assert np.abs(found.cross).max() < 0.02
    assert np.abs(found.light - share).max() < 0.01
    lit = found.vignetting((3, 5))
    assert lit[0, 1] == 1
    assert lit[0, 0] == pytest.approx(0.75, abs=0.01)


@pytest.mark.slow
def test_shear_does_not_depend_on_where_the_mask_was_registered():
    frames = displaced([(-0.9 * v, -1.1 * u) for v, u in VIEWS])
    elsewhere = replace(REGISTERED, matrix=moved(REGISTERED.matrix, (0.6, -0.8)), wavelength=620e-9)
    own, other = (measure_shear(frames, VIEWS, PATTERN, known).step for known in (REGISTERED, elsewhere))
    assert np.abs(own - other).max() < 5e-3


def test_shear_refuses_views_that_are_mixed_up():
    frames = displaced([(-v, -u) for v, u in VIEWS])
    with pytest.raises(DataError, match="which view"):
        measure_shear(frames[np.random.default_rng(0).permutation(9)], VIEWS, PATTERN, REGISTERED)
    with pytest.raises(SettingError, match="two or more along each axis"):
        measure_shear(frames[:3], VIEWS[:3], PATTERN, REGISTERED)


BENCH = PhaseMaskBench(diameter=1.5e-3, mask_pixels=32, window=(21, 21))
DEPTHS, WAVES = (0.5, 0.62, 0.85), (470e-9, 600e-9)


def mirror(seed, rms):
    values = np.random.default_rng(seed).standard_normal(len(MODES))
    return values * rms / np.linalg.norm(values)


def points(coefficients, bench=BENCH, size=(34, 37), snr=40.0, seed=0, depths=DEPTHS):
    """Frames of a source that is elsewhere at each depth, through a mask sampled twice as finely as the model's."""
    fine = 2 * bench.mask_pixels
    heights = np.tensordot(coefficients, zernike_modes(MODES, (fine, fine)).numpy(), 1)
    moves = np.random.default_rng(seed).uniform(-1.5, 1.5, (len(depths), 2))
    frames = [
        [point_of(bench, heights, z, wave, size, move) for wave in WAVES] for z, move in zip(depths, moves, strict=True)
    ]
    values = np.array(frames)
    return noisy(values / values.sum(axis=(2, 3), keepdims=True), snr, seed)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_wavefront_is_found_again_to_a_fiftieth_of_a_wave(seed):
    truth = mirror(seed, 0.08e-6)
    found = fit_zernike_psf(measure_psf(points(truth, seed=seed), DEPTHS, WAVES, BENCH.window), BENCH)
    assert wavefront_rms(truth, BENCH, 550e-9) > 0.25
    assert wavefront_rms(found.coefficients - truth, BENCH, 550e-9) < 1 / 50
    assert found.residual < 0.05


def test_modes_are_added_to_the_heights_that_were_asked_for():
    truth, known = mirror(3, 0.1e-6), mirror(4, 0.1e-6)
    nominal = np.tensordot(known, zernike_modes(MODES, BENCH.mask_size).numpy(), 1)
    stack = measure_psf(points(known + 0.2 * truth), DEPTHS, WAVES, BENCH.window)
    found = fit_zernike_psf(stack, BENCH, nominal=nominal)
    assert found.starts == 1
    assert wavefront_rms(found.coefficients - 0.2 * truth, BENCH, 550e-9) < 1 / 50


def test_the_jacobian_is_the_derivative_where_the_fit_is_good():
    from tmca.lab.calibration.psf import _Model

    truth = mirror(5, 0.05e-6)
    stack = measure_psf(points(truth, snr=80, depths=DEPTHS[:2]), DEPTHS[:2], WAVES, BENCH.window)
    model = _Model(stack, BENCH, MODES, None)
    place = np.concatenate([truth * 1e6, np.zeros(4)])
    place = model.fitted(place[: len(MODES)]).x
    own, step = model.jacobian(place), 1e-5
    for index in (0, 3, len(MODES), len(MODES) + 3):
        moved_there = np.eye(len(place))[index] * step
        slope = (model.residuals(place + moved_there) - model.residuals(place - moved_there)) / (2 * step)
        assert np.abs(own[:, index] - slope).max() < 0.05 * np.abs(slope).max()


def test_points_are_cut_out_with_unit_energy_and_their_noise():
    frames = points(mirror(0, 0.05e-6), snr=30) * 5000 + 77
    stack = measure_psf(frames, DEPTHS, WAVES, (21, 21))
    assert np.allclose(stack.values.sum(axis=(2, 3)), 1)
    assert np.abs(stack.centres - (16.5, 18)).max() < 3
    own = np.sqrt((points(mirror(0, 0.05e-6), snr=300) ** 2).mean()) / 10**1.5
    assert stack.noise.mean() == pytest.approx(own, rel=0.15)


@pytest.mark.slow
def test_points_that_are_not_there_are_refused():
    frames = points(mirror(0, 0.05e-6))
    with pytest.raises(DataError, match="no point"):
        measure_psf(noisy(np.ones(frames.shape)), DEPTHS, WAVES, (21, 21))
    with pytest.raises(DataError, match="from the border"):
        measure_psf(np.roll(frames, 12, axis=3), DEPTHS, WAVES, (21, 21))
    with pytest.raises(SettingError, match="odd sides"):
        measure_psf(frames, DEPTHS, WAVES, (20, 21))
    stack = measure_psf(frames, DEPTHS, WAVES, (21, 21))
    with pytest.raises(ShapeError, match="the bench's"):
        fit_zernike_psf(stack, PhaseMaskBench())
    with pytest.raises(SettingError, match="twin"):
        fit_zernike_psf(measure_psf(frames[:1], DEPTHS[:1], WAVES, (21, 21)), BENCH)
    with pytest.raises(SettingError, match="order 2 or more"):
        fit_zernike_psf(stack, BENCH, modes=((1, 1),))
    with pytest.raises(DataError, match="best fit leaves"):
        fit_zernike_psf(measure_psf(frames, (1.4, 0.31, 0.4), WAVES, (21, 21)), BENCH, modes=MODES[:2])
