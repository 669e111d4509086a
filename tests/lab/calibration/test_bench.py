"""The bench's own physics, held against what is known in closed form or by other programs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from studies.ray_physics import (
    BenchSensor,
    BenchTruth,
    glass_shift,
    light_field_light,
    overlap_in_time,
    pairs_in_time,
    point_of,
    spectral_light,
    time_beside,
)
from studies.rendered_bench import nominal_spectral, place_of_codes, spectral_truth
from tmca.cameras import Hardware, LightFieldCamera, SpectralCamera, imperfect
from tmca.lab.calibration.registration import nominal_matrix
from tmca.optics import PhaseMaskBench


def ideal(truth, matrix, span):
    """The truth without faults: no blur, tilt, delay, leak, and with this place and dispersion."""
    return replace(
        truth, matrix=matrix, span=span, tilt=0.0, blur=0.0, delay=0.0, ratio=1.0, step=np.ones(2), fall_off=0,
        contrast_ratio=np.inf, leakage=0.0,
    )  # fmt: skip


@pytest.mark.parametrize("size", [(24, 31), (25, 28)])
def test_without_faults_the_spectral_bench_is_the_camera(size):
    waves = [450e-9, 550e-9, 650e-9]
    camera = SpectralCamera(waves, size, 3, dispersion=[-2.0, 0.0, 3.0])
    truth = ideal(spectral_truth(camera, 0), place_of_codes(camera), 0.0)

    shifts = np.array([[0, -2.0], [0, 0.0], [0, 3.0]])  # in whole pixels
    whole = SimpleNamespace(**vars(truth), shifts=lambda _: shifts, response=lambda _: np.ones(3))
    scene = np.random.default_rng(0).uniform(0, 1, (3, *size))
    with torch.no_grad():
        exact = camera.A(torch.from_numpy(scene)[None].float())[0, 0].numpy() / camera.full_scale
    assert np.abs(spectral_light(camera, whole, scene) - exact).max() < 1e-3


@pytest.mark.parametrize("leaks", [{}, {"contrast_ratio": 30.0, "leakage": 0.04}])
def test_without_faults_of_place_and_time_the_light_field_bench_is_the_camera(leaks):
    camera = LightFieldCamera(3, (24, 27), 2)
    drawn = BenchTruth.drawn(camera.mask_size, camera.size, nominal_matrix(camera.mask_size, camera.size), 0.0, 2, 0)
    truth = replace(ideal(drawn, nominal_matrix(camera.mask_size, camera.size), 0.0), **leaks)
    scene = np.random.default_rng(1).uniform(0, 1, (3, 3, 24, 27))
    with torch.no_grad():
        image = imperfect(camera, Hardware(**leaks)).A(torch.from_numpy(scene)[None].float())
    exact = image[0, 0].numpy() / camera.full_scale
    assert np.abs(light_field_light(camera, truth, scene) - exact).max() < 1e-3


def test_the_glass_disperses_as_its_catalogue_says():
    # N-BK7: n_F - n_C = 0.008054 between 486.13 and 656.27 nm, n_d = 1.5168 (Schott)
    lines = np.array([486.13e-9, 587.56e-9, 656.27e-9])
    red = glass_shift([486.13e-9], 656.27e-9, 1.0)[0]
    part = glass_shift([587.56e-9], 656.27e-9, 1.0)[0]
    assert part / red == pytest.approx((1.5168 - 1.51432) / 0.008054, abs=0.01)
    assert (np.diff(glass_shift(lines.tolist(), 550e-9, 11.0)) > 0).all()
    assert np.ptp(glass_shift([400e-9, 700e-9], 550e-9, 11.0)) == pytest.approx(11)


def test_slots_overlap_and_leak_by_hand():
    # the shutter is late by a quarter of a slot and as long as the aperture's slots
    assert np.allclose(overlap_in_time(2, 0.25, 1.0), [[0.75, 0], [0.25, 0.75]], atol=1e-3)
    assert np.allclose(overlap_in_time(2, 0.0, 0.5), [[0.5, 0.5], [0, 0]], atol=1e-3)
    assert np.allclose(time_beside(2, 0.25, 1.0), [0.25, 0], atol=1e-3)
    assert np.allclose(time_beside(2, 0.0, 0.5), [0, 1], atol=1e-3)
    # first slot of both with leaks: 3/4 open in both, 1/4 behind the closed shutter; 1 behind both closed
    found = pairs_in_time(2, 0.25, 1.0, 50.0, 0.01)
    assert found[0, 0] == pytest.approx(0.75 + 0.25 * 0.01 + 0.25 * 0.02 + 0.75 * 0.0002, abs=1e-3)
    assert found[0, 1] == pytest.approx(0.01 + 0.75 * 0.02 + 0.25 * 0.0002, abs=1e-4)


@pytest.mark.parametrize("delay", [0.25, -0.2])
def test_snapshots_and_pairs_of_slots_leak_alike(delay):
    known = LightFieldCamera(1, (24, 25), 2)
    place = nominal_matrix(known.mask_size, known.size)
    drawn = ideal(BenchTruth.drawn(known.mask_size, known.size, place, 0.0, 2, 0), place, 0.0)
    truth = replace(drawn, delay=delay, ratio=0.97, contrast_ratio=20.0, leakage=0.1)
    pairs, slots = pairs_in_time(2, delay, 0.97, 20.0, 0.1), torch.eye(2)[:, :, None, None]
    for i, j in np.ndindex(2, 2):
        own, other = slots[i].expand(-1, *known.mask_size), slots[j].expand(-1, *known.size)
        camera = LightFieldCamera(1, known.size, 2, aperture=own, shutter=other)
        seen = light_field_light(camera, truth, np.ones((1, 1, *known.size)))
        assert np.allclose(seen, pairs[i, j] / 2, atol=1e-6)


def test_leaks_leave_the_other_hidden_numbers_of_a_seed_as_they_were():
    place = nominal_matrix((24, 25), (24, 25))
    drawn = [BenchTruth.drawn((24, 25), (24, 25), place, 11.0, 2, seed) for seed in range(20)]
    # as they were drawn before there were leaks
    assert (drawn[0].delay, drawn[0].sensor.offset[3, 4]) == pytest.approx((0.10296640585380991, 1014.5218757789553))
    assert all(50 <= one.contrast_ratio <= 400 and 0 <= one.leakage <= 0.02 for one in drawn)
    assert len({one.leakage for one in drawn}) == 20


def test_a_flat_mirror_in_focus_gives_the_airy_disk():
    from scipy.special import j1

    bench, size = PhaseMaskBench(focus=np.inf, window=(21, 21)), (21, 24)
    light = point_of(bench, np.zeros((256, 256)), np.inf, 550e-9, size, samples=21)
    y, x = (((np.arange(n * 21) + 0.5) / 21 - 0.5 - (n - 1) / 2) * bench.pitch for n in size)
    angle = np.pi * bench.diameter / (550e-9 * bench.distance) * np.hypot(y[:, None], x)
    airy = (2 * j1(angle + 1e-9) / (angle + 1e-9)) ** 2
    airy = airy.reshape(21, 21, 24, 21).mean(axis=(1, 3))
    assert np.abs(light / light.sum() - airy / airy.sum()).max() < 0.01 * (airy / airy.sum()).max()


def test_frames_have_the_noise_that_was_asked_for():
    rng = np.random.default_rng(0)
    sensor = BenchSensor.drawn((60, 61), rng)
    light = np.full((60, 61), 0.5)
    seen = sensor.recorded(light, rng, 40.0) - sensor.offset - sensor.light(light)
    good = ~(sensor.hot | sensor.dead)
    assert seen[good].std() == pytest.approx(sensor.light(light)[good].mean() / 100, rel=0.05)
    own = sensor.recorded(light, rng) - sensor.offset - sensor.light(light)
    assert own[good].var() == pytest.approx(20000 / sensor.gain + sensor.read_noise**2, rel=0.1)
    assert nominal_spectral((24, 25), 2, 0).snapshot_shape == (1, 24, 36)
