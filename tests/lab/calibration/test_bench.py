"""The bench's own physics, held against what is known in closed form or by other programs."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tmca.cameras import SpectralCamera
from tmca.lab.calibration.registration import nominal_matrix
from tmca.lab.calibration.rendered.cameras import nominal_spectral, place_of_codes, spectral_truth
from tmca.lab.calibration.rendered.light import light_field_light, spectral_light
from tmca.lab.calibration.rendered.physics import BenchSensor, glass_shift, overlap_in_time, point_of, seen_by_rays
from tmca.lab.calibration.rendered.truth import BenchTruth
from tmca.optics import PhaseMaskBench


def ideal(truth, matrix, span):
    """The truth without faults: no blur, tilt, delay, and with this place and dispersion."""
    return replace(
        truth, matrix=matrix, span=span, tilt=0.0, blur=0.0, delay=0.0, ratio=1.0, step=np.ones(2), fall_off=0
    )


@pytest.mark.parametrize("size", [(24, 31), (25, 28)])
def test_without_faults_the_spectral_bench_is_the_camera(size):
    waves = [450e-9, 550e-9, 650e-9]
    camera = SpectralCamera(waves, size, 3, dispersion=[-2.0, 0.0, 3.0])
    truth = ideal(spectral_truth(camera, 0), place_of_codes(camera), 0.0)

    class Whole:
        """The truth with displacements in whole pixels."""

        def __getattr__(self, name):
            return getattr(truth, name)

        def shifts(self, wavelengths):
            return np.array([[0, -2.0], [0, 0.0], [0, 3.0]])

        def response(self, wavelengths):
            return np.ones(3)

    scene = np.random.default_rng(0).uniform(0, 1, (3, *size))
    with torch.no_grad():
        exact = camera.A(torch.from_numpy(scene)[None].float())[0, 0].numpy() / camera.full_scale
    assert np.abs(spectral_light(camera, Whole(), scene) - exact).max() < 1e-3


def test_without_faults_the_light_field_bench_is_the_camera():
    from tmca.cameras import LightFieldCamera

    camera = LightFieldCamera(3, (24, 27), 2)
    drawn = BenchTruth.drawn(camera.mask_size, camera.size, nominal_matrix(camera.mask_size, camera.size), 0.0, 2, 0)
    truth = ideal(drawn, nominal_matrix(camera.mask_size, camera.size), 0.0)
    scene = np.random.default_rng(1).uniform(0, 1, (3, 3, 24, 27))
    with torch.no_grad():
        exact = camera.A(torch.from_numpy(scene)[None].float())[0, 0].numpy() / camera.full_scale
    assert np.abs(light_field_light(camera, truth, scene) - exact).max() < 1e-3


def test_the_glass_disperses_as_its_catalogue_says():
    # N-BK7: n_F - n_C = 0.008054 between 486.13 and 656.27 nm, n_d = 1.5168 (Schott)
    lines = np.array([486.13e-9, 587.56e-9, 656.27e-9])
    red = glass_shift([486.13e-9], 656.27e-9, 1.0)[0]
    part = glass_shift([587.56e-9], 656.27e-9, 1.0)[0]
    assert part / red == pytest.approx((1.5168 - 1.51432) / 0.008054, abs=0.01)
    assert (np.diff(glass_shift(lines.tolist(), 550e-9, 11.0)) > 0).all()
    assert np.ptp(glass_shift([400e-9, 700e-9], 550e-9, 11.0)) == pytest.approx(11)


def test_slots_overlap_by_hand():
    # the shutter is late by a quarter of a slot and as long as the aperture's slots
    assert np.allclose(overlap_in_time(2, 0.25, 1.0), [[0.75, 0], [0.25, 0.75]], atol=1e-3)
    assert np.allclose(overlap_in_time(2, 0.0, 0.5), [[0.5, 0.5], [0, 0]], atol=1e-3)


def test_a_flat_mirror_in_focus_gives_the_airy_disk():
    from scipy.special import j1

    bench, size = PhaseMaskBench(focus=np.inf, window=(21, 21)), (21, 24)
    light = point_of(bench, np.zeros((256, 256)), np.inf, 550e-9, size, samples=21)
    y, x = (((np.arange(n * 21) + 0.5) / 21 - 0.5 - (n - 1) / 2) * bench.pitch for n in size)
    angle = np.pi * bench.diameter / (550e-9 * bench.distance) * np.hypot(y[:, None], x)
    airy = (2 * j1(angle + 1e-9) / (angle + 1e-9)) ** 2
    airy = airy.reshape(21, 21, 24, 21).mean(axis=(1, 3))
    assert np.abs(light / light.sum() - airy / airy.sum()).max() < 0.01 * (airy / airy.sum()).max()


def test_a_pattern_on_whole_pixels_is_seen_as_it_is():
    pattern = np.random.default_rng(0).integers(2, size=(1, 9, 12)).astype(float)
    assert np.array_equal(
        seen_by_rays(pattern, np.array([[1.0, 0, 2], [0, 1.0, 1]]), (12, 14))[0, 2:11, 1:13], pattern[0]
    )


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
