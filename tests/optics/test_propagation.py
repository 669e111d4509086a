"""Propagation matches the Airy disk, defocus, the Gaussian beam, a slow sum over spherical waves, another library."""

from math import pi

import numpy as np
import pytest
import torch
from scipy.special import j1
from torchoptics import Field

from tmca.errors import SettingError, ShapeError
from tmca.optics import MATERIALS, AngularSpectrum, FocalPlane, Undersampled
from tmca.optics.phase import circular_aperture, mask_field, pixel_places, radians_per_metre, spherical_wave

GREEN, RED = 550e-9, 650e-9


def test_a_circular_pupil_makes_the_airy_disk():
    size, pitch, focal, diameter = (240, 255), 10e-6, 50e-3, 240
    pupil = circular_aperture(size).to(torch.complex64).expand(2, -1, -1)
    seen = FocalPlane(size, pitch, [GREEN, RED], focal, (41, 41), 0.8e-6, chirp=False)(pupil).abs() ** 2
    y, x = pixel_places((41, 41), 0.8e-6)
    radius = torch.hypot(y, x).numpy()
    for image, wavelength in zip(seen, (GREEN, RED), strict=True):
        v = pi * diameter * pitch * np.maximum(radius, 1e-12) / (wavelength * focal)
        airy = np.where(radius < 1e-9, 1, (2 * j1(v) / v) ** 2)
        np.testing.assert_allclose(image.numpy() / float(image.max()), airy, atol=4e-3)
    area = float(circular_aperture(size).sum()) * pitch**2
    on_axis = (area / (GREEN * focal)) ** 2 * (0.8e-6 / pitch) ** 2
    assert float(seen[0].max()) == pytest.approx(on_axis, rel=1e-4)


def test_defocus_lowers_the_peak_as_the_sinc_of_its_phase():
    """On the axis of a circular pupil with defocus phase W ρ², the intensity is sinc²(W/2)."""
    size, pitch, focal = (280, 280), 10e-6, 50e-3
    rho = torch.hypot(*pixel_places(size, 2 / 280))
    plane = FocalPlane(size, pitch, [GREEN], focal, (1, 1), 1e-6, chirp=False)
    aperture = circular_aperture(size)
    peaks = []
    for defocus in (0.0, 2.0, 4.5, 2 * pi):
        field = torch.polar(aperture, defocus * rho**2)[None].to(torch.complex64)
        peaks.append(float(plane(field).abs().squeeze() ** 2))
    expected = [np.sinc(w / 2 / pi) ** 2 for w in (0.0, 2.0, 4.5, 2 * pi)]
    np.testing.assert_allclose(np.array(peaks) / peaks[0], expected, atol=3e-3)


def test_a_gaussian_beam_widens_as_it_should():
    size, pitch, waist, distance = (256, 256), 4e-6, 60e-6, 30e-3
    y, x = pixel_places(size, pitch)
    field = torch.exp(-(y**2 + x**2) / waist**2)[None].to(torch.complex64)
    seen = AngularSpectrum(size, pitch, [GREEN], distance)(field)[0].abs() ** 2
    width = waist * (1 + (distance * GREEN / (pi * waist**2)) ** 2) ** 0.5
    expected = (waist / width) ** 2 * torch.exp(-2 * (y**2 + x**2) / width**2)
    torch.testing.assert_close(seen.double(), expected, atol=2e-3 * float(expected.max()), rtol=0)


def test_it_is_the_sum_over_spherical_waves():
    """Rayleigh–Sommerfeld's first integral, pixel by pixel, on a few points of the sensor."""
    size, pitch, distance = (48, 51), 2e-6, 3e-3
    y, x = pixel_places(size, pitch)
    field = torch.exp(-(y**2 + (x - 6e-6) ** 2) / (22e-6) ** 2).to(torch.complex128)
    field = field * torch.exp(1j * 6e4 * x)
    seen = AngularSpectrum(size, pitch, [RED], distance, padding=3)(field[None].to(torch.complex64))[0]
    k = 2 * pi / RED
    slow, places = [], [(24, 25), (20, 30), (30, 22), (24, 33)]
    for row, column in places:
        r = torch.sqrt((y - y[row]) ** 2 + (x - x[0, column]) ** 2 + distance**2)
        kernel = distance / (2 * pi) * torch.exp(1j * k * (r - distance)) / r**2 * (1 / r - 1j * k)
        slow.append((field * kernel).sum() * pitch**2)
    found = torch.stack([seen[place] for place in places]).to(torch.complex128)
    torch.testing.assert_close(found, torch.stack(slow), atol=4e-3 * float(seen.abs().max()), rtol=0)


@pytest.mark.parametrize("size", [(128, 128), (127, 130), (129, 127)])
@pytest.mark.parametrize("focal", [40e-3, 40.6e-3])
def test_one_fresnel_step_agrees_with_the_angular_spectrum(size, focal):
    """A lens and a mask without symmetry, in focus and beside it, on the same pixels."""
    pitch, distance, waves = 8e-6, 40e-3, [GREEN, RED]
    y, x = pixel_places(size, 1.0)
    heights = 60e-9 * torch.cos(x / 9) * torch.sin(y / 7) + 1e-9 * x
    lens = spherical_wave(size, pitch, waves, float("inf"), focus=focal)
    field = (50.5 - torch.hypot(y, x)).clamp(0, 1) * lens * mask_field(heights, radians_per_metre(waves, None))
    seen = tuple(20 + side % 2 for side in size)
    one = FocalPlane(size, pitch, waves, distance, seen, pitch)(field.to(torch.complex64)).abs() ** 2
    other = AngularSpectrum(size, pitch, waves, distance)(field.to(torch.complex64)).abs() ** 2
    top, left = ((side - part) // 2 for side, part in zip(size, seen, strict=True))
    other = other[:, top : top + seen[0], left : left + seen[1]]
    torch.testing.assert_close(one, other, atol=2e-3 * float(other.max()), rtol=0)


def test_a_point_source_is_focused_where_the_lens_equation_says():
    """A lens that brings a source at 0.5 m to a focus at s leaves one at 1 m out of focus by the analytic phase."""
    size, pitch = (64, 66), 20e-6
    field = spherical_wave(size, pitch, [GREEN, RED], 1.0, focus=0.5)
    y, x = pixel_places(size, pitch)
    phase = pi * (y**2 + x**2) * (1 / 1.0 - 1 / 0.5)
    for own, wavelength in zip(field, (GREEN, RED), strict=True):
        torch.testing.assert_close(own, torch.polar(torch.ones_like(phase), phase / wavelength), atol=2e-4, rtol=0)
    torch.testing.assert_close(spherical_wave(size, pitch, [GREEN], 0.5, focus=0.5).real, torch.ones(1, *size).double())


def test_heights_delay_light_by_their_index_and_mirrors_twice():
    glass, mirror = (radians_per_metre([GREEN], material) for material in (MATERIALS["N-BK7"], None))
    assert float(glass) == pytest.approx(2 * pi * (MATERIALS["N-BK7"].index([GREEN])[0] - 1) / GREEN)
    assert float(mirror) == pytest.approx(4 * pi / GREEN)
    height = torch.full((2, 3, 4), GREEN / 4, dtype=torch.float64)
    torch.testing.assert_close(mask_field(height, mirror).real, -torch.ones(2, 1, 3, 4, dtype=torch.float64))


@pytest.mark.parametrize("size", [(9, 8), (12, 11)])
def test_samples_of_a_pixel_sum_to_the_light_on_its_area(size):
    """Against midpoints that lie 24 times as dense."""
    field = torch.randn(1, *size, dtype=torch.complex128)
    coarse = FocalPlane(size, 100e-6, [GREEN], 50e-3, (3, 4), 8e-6, samples=4)
    fine = FocalPlane(size, 100e-6, [GREEN], 50e-3, (72, 96), 8e-6 / 24)
    seen = (plane(field)[0].abs() ** 2 for plane in (coarse, fine))
    light, expected = (
        torch.nn.functional.avg_pool2d(one[None], n, divisor_override=1) for one, n in zip(seen, (4, 24), strict=True)
    )
    torch.testing.assert_close(light, expected, rtol=2e-3, atol=1e-3 * float(expected.max()))


def test_impossible_numbers_are_refused():
    for where, refused in (
        ("padding", lambda: AngularSpectrum((4, 4), 1e-6, [GREEN], 1e-3, padding=0.5)),
        ("distance", lambda: FocalPlane((4, 4), 1e-6, [GREEN], 0.0, (4, 4), 1e-6)),
        ("focus", lambda: spherical_wave((4, 4), 1e-6, [GREEN], 1.0, focus=-1)),
        ("wavelengths", lambda: radians_per_metre([0.0], None)),
    ):
        with pytest.raises(SettingError, match=f"^{where}: "):
            refused()
    with pytest.raises(ShapeError, match="field"):
        AngularSpectrum((4, 4), 1e-6, [GREEN], 1e-3)(torch.zeros(2, 4, 4))


@pytest.mark.parametrize(("distance", "padding"), [(5.0, 2.0), (0.4, 2.0), (0.05, 1.0)])
def test_distances_that_the_grid_cannot_follow_are_warned_of(distance, padding):
    with pytest.warns(Undersampled, match="frequencies follow"):
        AngularSpectrum((64, 64), 10e-6, [550e-9], distance, padding)


PITCH, SIZES = 10e-6, [(64, 64), (63, 50)]


def field(size):
    """A bell behind a smooth random phase."""
    coarse = torch.randn(1, 1, 8, 8, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    phase = torch.nn.functional.interpolate(coarse, size=size, mode="bicubic")[0, 0]
    y, x = (torch.linspace(-1, 1, side, dtype=torch.float64) for side in size)
    return torch.polar(torch.exp(-4 * (x**2 + y[:, None] ** 2)), phase)


@pytest.mark.parametrize("size", SIZES)
def test_the_angular_spectrum_is_the_same(size):
    own = AngularSpectrum(size, PITCH, [GREEN], 2e-3, padding=3.0)(field(size)[None])[0]
    other = Field(field(size), GREEN, 0.0, PITCH).propagate_to_z(2e-3, propagation_method="ASM", asm_pad=size).data
    turned = torch.vdot(other.flatten(), own.flatten())  # theirs has the phase of the axis
    assert float((own - other * turned / turned.abs()).abs().max()) < 1e-6 * float(own.abs().max())


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(("method", "tolerance"), [("DIM_FRESNEL", 1e-5), ("DIM", 1e-4)])
def test_light_on_the_sensor_is_the_same(size, method, tolerance):
    """Against the Fresnel sum, and against Rayleigh and Sommerfeld's, of which it is the paraxial form."""
    seen, coarser = (21, 24), 3
    own = FocalPlane(size, PITCH, [GREEN], 50e-3, seen, coarser * PITCH)(field(size)[None])[0].abs() ** 2
    there = Field(field(size), GREEN, 0.0, PITCH).propagate(seen, 50e-3, coarser * PITCH, propagation_method=method)
    expected = coarser**2 * there.data.abs() ** 2  # light of a pixel, in that of a pixel of the mask
    torch.testing.assert_close(own, expected, rtol=0, atol=tolerance * float(expected.max()))
