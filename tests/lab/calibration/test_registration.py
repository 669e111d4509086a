"""Mask to sensor: what is seen of patterns, and the map found again from it."""

import numpy as np
import pytest

from studies.ray_physics import seen_by_rays
from tests.lab.calibration.rays import affine, noisy
from tmca.errors import DataError, SettingError
from tmca.lab.calibration.captures import calibration_patterns
from tmca.lab.calibration.displacement import displacement_of
from tmca.lab.calibration.pattern_image import inverse, mapped, moved, seen_patterns
from tmca.lab.calibration.registration import Registration, closed_light, nominal_matrix, register

ODD, EVEN = ((33, 41), (35, 52)), ((40, 48), (40, 56))
FEW = ((21, 25), (23, 34)), ((24, 28), (24, 36))
"""Fewer pixels, where a map is fitted."""


@pytest.mark.parametrize(("codes", "sensor"), [ODD, EVEN])
def test_a_mask_that_lies_on_the_sensor_is_seen_as_it_is(codes, sensor):
    patterns = calibration_patterns(codes)
    down = sensor[0] - codes[0]
    seen = seen_patterns(patterns, np.array([[1.0, 0, down], [0, 1.0, 4]]), sensor)
    assert np.abs(seen[:, down:, 4 : codes[1] + 4] - patterns).max() < 1e-12


@pytest.mark.parametrize(("codes", "sensor"), [ODD, EVEN])
@pytest.mark.parametrize("scale", [0.5, 1.0, 2.3])
def test_what_is_seen_is_what_many_rays_see(codes, sensor, scale):
    patterns = calibration_patterns(codes)
    matrix = affine(codes, sensor, turn=1.0, scale=scale, shear=0.01, shift=(0.3, -0.7))
    seen, rays = seen_patterns(patterns, matrix, sensor), seen_by_rays(patterns, matrix, sensor, rays=16)
    assert np.abs(seen - rays).max() < 0.08
    assert np.sqrt(((seen - rays) ** 2).mean()) < 0.01


def test_light_is_kept_and_blur_keeps_it():
    pattern = np.zeros((1, 20, 21))
    pattern[0, 8:12, 9:13] = 1
    matrix = affine((20, 21), (40, 43), turn=3.0, scale=1.1)
    for blur in (0.0, 0.7):
        light = seen_patterns(pattern, matrix, (40, 43), blur).sum()
        assert light == pytest.approx(16 * np.linalg.det(matrix[:, :2]), rel=2e-3)


def test_maps_go_there_and_back():
    matrix = affine((10, 12), (11, 13), turn=30, scale=1.3, shear=0.1, shift=(2, -1))
    there = mapped(moved(matrix, (1.0, 2.0)), 3.0, 4.0)
    assert np.allclose(mapped(inverse(moved(matrix, (1.0, 2.0))), *there), (3, 4))
    with pytest.raises(SettingError, match="invertible"):
        inverse(np.zeros((2, 3)))


@pytest.mark.parametrize(("codes", "sensor"), [((21, 25), (34, 34)), ((24, 28), (36, 36))])
@pytest.mark.parametrize("turn", [0.8, 89.2, 181.0])
def test_the_map_is_found_again_to_a_twentieth_of_a_pixel(codes, sensor, turn):
    patterns = calibration_patterns(codes)
    truth = affine(codes, sensor, turn=turn, scale=1.02, shear=0.008, shift=(1.3, -0.6))
    found = register(noisy(900 * seen_by_rays(patterns, truth, sensor, blur=0.4) + 40), patterns)
    assert found.offset(truth) < 0.05
    assert found.blur == pytest.approx(0.4, abs=0.05)
    assert found.offset(truth) < 6 * found.edge_std
    assert found.residual < 0.05


def test_a_mirror_image_is_told_from_a_turn():
    codes, sensor = FEW[0][0], (33, 36)
    patterns = calibration_patterns(codes)
    truth = affine(codes, sensor, turn=-0.5, shift=(0.4, 0.2))
    truth[:, 2] += truth[:, 1] * (codes[1] - 1)
    truth[:, 1] *= -1
    found = register(noisy(seen_by_rays(patterns, truth, sensor)), patterns)
    assert np.linalg.det(found.matrix[:, :2]) < 0
    assert found.offset(truth) < 0.05


@pytest.mark.parametrize(
    ("codes", "sensor", "scale", "shift"),
    [(*FEW[1], 1.0, (0.3, -0.4)), ((16, 16), (42, 46), 1.0, (6, -8)), ((30, 36), (30, 36), 0.5, (0, 0)),
     ((30, 36), (30, 36), 1.0, (10, 2))],
)  # fmt: skip
def test_uneven_light_a_small_image_and_one_half_beside_the_sensor_do_not_move_the_mask(codes, sensor, scale, shift):
    patterns, truth = calibration_patterns(codes), affine(codes, sensor, turn=0.3, scale=scale, shift=shift)
    y, x = np.meshgrid(*(np.linspace(-0.7, 0.7, n) for n in sensor), indexing="ij")
    shown = noisy(900 * (1 - 0.5 * np.hypot(y, x) + 0.2 * x) * seen_by_rays(patterns, truth, sensor, blur=0.2))
    assert register(shown, patterns, scale=scale).offset(truth) < 0.05


def test_a_map_that_the_frames_do_not_tell_is_refused():
    codes, sensor = (16, 16), (24, 24)
    patterns, truth = calibration_patterns(codes, 1), affine(codes, sensor)
    shown = noisy(900 * seen_by_rays(patterns, truth, sensor, blur=1.6), 20)
    with pytest.raises(DataError, match=r"of doubt about the mask's corners, expected 0\.25 at most"):
        register(shown, patterns, start=truth)


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("sensor", "snr_db"), [((181, 220), 30), ((260, 195), 20)])
def test_a_mask_on_a_small_part_of_the_sensor_is_found(sensor, snr_db):
    codes = (33, 41)
    patterns = calibration_patterns(codes)
    truth = affine(codes, sensor, turn=0.7, scale=1.01, shift=(31.3, -40.6))
    rng = np.random.default_rng(0)
    frames = 40 + 900 * seen_by_rays(patterns, truth, sensor, blur=0.4)
    frames += 900 / 10 ** (snr_db / 20) * rng.standard_normal(frames.shape)
    frames[:, rng.uniform(size=sensor) < 0.002] += 2000  # hot pixels
    assert register(frames, patterns).offset(truth) < (0.05 if snr_db == 30 else 0.1)
    with pytest.raises(DataError, match="of the patterns' contrast"):
        register(frames, patterns[[0, 1, 3, 2]], start=truth)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("level", [0, 7])
def test_frames_of_one_value_are_refused(level):
    with pytest.raises(DataError, match="no brighter than the dark"):
        register(np.full((4, 40, 50), level), calibration_patterns((33, 41)))


@pytest.mark.slow
@pytest.mark.parametrize("snr_db", [12, 20])
def test_noise_alone_refuses_no_fit(snr_db):
    codes, sensor = EVEN
    patterns = calibration_patterns(codes)
    truth = affine(codes, sensor, turn=0.6, scale=1.01, shift=(0.3, -0.4))
    y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in sensor), indexing="ij")
    frames = noisy(np.exp(-1.2 * (x**2 + y**2)) * seen_by_rays(patterns, truth, sensor, blur=0.4), snr_db)
    found = register(frames, patterns)
    assert found.residual > (0.2 if snr_db == 12 else 0.09)
    assert found.offset(truth) < 4 * found.edge_std
    for other in (patterns[[0, 1, 3, 2]], calibration_patterns(codes, seed=5)):
        with pytest.raises(DataError, match="of the patterns' contrast"):
            register(frames, other, start=truth)


@pytest.mark.slow
def test_the_standard_deviation_is_that_of_many_captures():
    codes, sensor = (24, 25), (26, 27)
    patterns, truth = calibration_patterns(codes), affine((24, 25), (26, 27), turn=0.3, shift=(0.2, 0.1))
    clean = seen_patterns(patterns, truth, sensor, 0.3)
    found = [register(noisy(clean, 30, seed), patterns, start=truth) for seed in range(6)]
    middle = np.array([11.5, 12, 1])
    spread = np.std([one.matrix @ middle for one in found], axis=0, ddof=1)
    # the dark and open frames' noise is not in the fit's own count of it
    assert (spread / found[0].std[:, 2]).mean() == pytest.approx(1.3, abs=0.6)


@pytest.mark.parametrize(("codes", "sensor"), FEW)
@pytest.mark.parametrize("share", [0.0, 0.004, 0.05])
def test_light_through_closed_pixels_is_found_again(codes, sensor, share):
    patterns, matrix = calibration_patterns(codes), affine(codes, sensor, turn=0.6, shift=(0.2, -0.4))
    light = 900 * (1 - 0.4 * np.linspace(0, 1, sensor[1]))
    frames = noisy(light * seen_by_rays(patterns + share * (1 - patterns), matrix, sensor, blur=0.3))
    found = register(frames, patterns, start=matrix, above_dark=True)
    assert found.leakage == pytest.approx(share, abs=4 * found.leakage_std)
    assert 0 < found.leakage_std < 1e-3
    assert found.offset(matrix) < 0.05
    assert found.closed_light == max(0, found.leakage)


def test_light_through_closed_pixels_is_unknown_beside_a_sensors_own_dark():
    codes, sensor = FEW[0]
    patterns, matrix = calibration_patterns(codes), affine(codes, sensor, turn=0.6, shift=(0.2, -0.4))
    frames = noisy(900 * seen_by_rays(patterns + 0.05 * (1 - patterns), matrix, sensor, blur=0.3))
    unknown = register(frames + 40, patterns, start=matrix)
    assert (unknown.leakage, unknown.closed_light, unknown.contrast_ratio) == (None, 0.0, np.inf)


@pytest.mark.parametrize("cut", [False, True])
def test_the_deviation_of_closed_light_is_that_of_many_captures(cut):
    rng, lit = np.random.default_rng(3), np.ones((40, 41), bool)
    light = rng.uniform(300, 1000, lit.shape)
    found = []
    for _ in range(60):
        dark = 0.01 * light + 20 * rng.standard_normal(lit.shape)
        dark[rng.uniform(size=lit.shape) < 0.005] = 4000
        found.append(closed_light(np.maximum(dark, -15) if cut else dark, light, lit))
    shares, stds = np.transpose(found)
    assert shares.mean() == pytest.approx(0.01, abs=5 * shares.std() / np.sqrt(60))
    assert stds.mean() == pytest.approx(shares.std(ddof=1), rel=0.3)


def test_patterns_that_were_not_shown_are_refused():
    codes, sensor = (18, 20), (18, 24)
    patterns = calibration_patterns(codes)
    frames = noisy(seen_by_rays(patterns, affine(codes, sensor), sensor))
    other = calibration_patterns(codes, seed=5)
    with pytest.raises(DataError, match=r"not seen|one order"):
        register(frames, other)
    with pytest.raises(DataError, match="in one order"):
        register(frames, other, start=nominal_matrix(codes, sensor))
    with pytest.raises(DataError, match="no brighter than the dark"):
        register(noisy(np.ones((4, *sensor))), patterns)
    with pytest.raises(DataError, match="no pattern that is all open"):
        register(frames[1:], patterns[1:])
    with pytest.raises(DataError, match="found 3 frames, expected 4"):
        register(frames[:3], patterns)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.35, 11.62), (-2.2, -7.15)])
def test_a_displaced_pattern_is_found_under_light_that_falls_off(shift):
    codes, sensor = (21, 26), (25, 53)
    pattern, matrix = calibration_patterns(codes)[3], affine(codes, sensor, turn=0.6, scale=1.01)
    light = 500 * (1 - 0.3 * np.linspace(-1, 1, sensor[1]) ** 2)
    frame = light * seen_by_rays(pattern[None], moved(matrix, shift), sensor, blur=0.3)[0]
    registered = Registration(matrix, np.zeros((2, 3)), 0.3, 0.0, codes, sensor)
    found = displacement_of(noisy(frame), pattern, registered)
    assert np.abs(found.shift - shift).max() < 0.02
    assert (np.abs(found.shift - shift) < 8 * found.std + 0.005).all()
    assert found.light == pytest.approx(light[14:39].mean(), rel=0.15)
    with pytest.raises(DataError, match="not seen"):
        displacement_of(noisy(np.ones(sensor), 20), pattern, registered)


def test_the_middle_of_the_mask_lies_beside_where_it_was_drawn_by_what_it_was_moved():
    matrix, drawn = np.array([[0, 2.0, 7], [1.0, 0, 9]]), np.array([[0, 2.0, 6.25], [1.0, 0, 9.5]])
    seen = Registration(matrix, np.zeros((2, 3)), 0.0, 0.0, (5, 8), (21, 30))
    assert seen.beside(drawn) == {"rows_from_where_drawn": 0.75, "columns_from_where_drawn": -0.5}
    away = {"rows_from_the_sensor_middle": 2 * 3.5 + 7 - 10, "columns_from_the_sensor_middle": 2.0 + 9 - 14.5}
    assert seen.beside(None) == away
