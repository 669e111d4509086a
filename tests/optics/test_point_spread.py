"""PSF cubes: energy, scaling with depth and wavelength, gradients against finite differences and plain autograd."""

from math import pi

import pytest
import torch

from tmca.errors import SettingError, ShapeError
from tmca.optics.heights import FreeForm
from tmca.optics.phase import circular_aperture, mask_field, pixel_places, radians_per_metre, spherical_wave
from tmca.optics.point_spread import AngularSpectrum, FocalPlane, PointSpread, point_spread

GREEN, RED = 500e-9, 650e-9
SIZE, PITCH, FOCUS = (40, 37), 20e-6, 50e-3


def waves(depths, wavelengths=(GREEN, RED), size=SIZE, focus=1.0):
    return circular_aperture(size) * torch.stack([spherical_wave(size, PITCH, wavelengths, z, focus) for z in depths])


def plane(out=(31, 32), pitch=10e-6, wavelengths=(GREEN, RED), size=SIZE):
    return FocalPlane(size, PITCH, wavelengths, FOCUS, out, pitch, chirp=False)


def test_every_psf_has_unit_energy_or_the_apertures():
    heights = FreeForm(2e-7 * torch.rand(2, *SIZE))
    own = radians_per_metre([GREEN, RED], None)
    found = PointSpread(heights, waves([0.5, 1.0, 4.0]), own, plane())()
    assert found.shape == (2, 3, 2, 31, 32)
    torch.testing.assert_close(found.sum((-2, -1)), torch.ones(2, 3, 2))
    assert (found >= 0).all()
    wide = plane((160, 160), PITCH / 4)  # the whole period of the shortest wave: nothing is lost
    shares = PointSpread(FreeForm(torch.zeros(1, *SIZE)), waves([1.0]), own, wide, "aperture")().sum((-2, -1))
    assert ((shares > 0.93) & (shares < 1.001)).all()


def test_a_defocused_spot_grows_as_geometry_says():
    """Far from focus the spot is the aperture's shadow: its radius is f · R · |1/z - 1/z₀|, whatever the wavelength."""
    size, pitch, focal, focus = (200, 200), 20e-6, 50e-3, 1.0
    field = circular_aperture(size) * torch.stack(
        [spherical_wave(size, pitch, [GREEN, RED], z, focus) for z in (0.3, 0.22)]
    )
    own, out = radians_per_metre([GREEN, RED], None), (129, 129)
    propagator = FocalPlane(size, pitch, [GREEN, RED], focal, out, 8e-6, chirp=False)
    found = PointSpread(FreeForm(torch.zeros(1, *size)), field, own, propagator)()[0]
    y, x = pixel_places(out, 8e-6)
    square = (y**2 + x**2).float()
    for depth, z in enumerate((0.3, 0.22)):
        radius = focal * size[0] * pitch / 2 * abs(1 / z - 1 / focus)
        rms = (found[depth] * square).sum((-2, -1)).sqrt()
        torch.testing.assert_close(rms, torch.full((2,), radius / 2**0.5), rtol=0.06, atol=0)


def test_a_tilt_moves_the_spot():
    slope = 10e-6 / (2 * FOCUS)  # of a mirror: doubled on the way back
    y, x = pixel_places(SIZE, PITCH)
    heights = torch.stack([torch.zeros(SIZE), (slope * x).expand(SIZE), (slope * y).expand(SIZE)]).float()
    own = radians_per_metre([GREEN, RED], None)
    still, across, along = PointSpread(FreeForm(heights), waves([0.8]), own, plane((31, 31)))()
    torch.testing.assert_close(across[..., 2:-2, 3:-1], still[..., 2:-2, 2:-2], atol=2e-3, rtol=0)
    torch.testing.assert_close(along[..., 3:-1, 2:-2], still[..., 2:-2, 2:-2], atol=2e-3, rtol=0)


@pytest.mark.parametrize("kind", ["free", "focal"])
def test_gradients_are_those_of_plain_autograd_and_of_finite_differences(kind):
    size = (8, 7)
    own = radians_per_metre([GREEN, RED], None) * 1e-7
    fields = waves([0.5, 2.0], size=size)
    if kind == "free":
        propagator = AngularSpectrum(size, PITCH, [GREEN, RED], 2e-3)
        propagator.transfer = propagator.transfer.to(torch.complex128)
    else:
        propagator = plane((5, 6), size=size)
        propagator.rows, propagator.columns = (m.to(torch.complex128) for m in (propagator.rows, propagator.columns))
    heights = torch.rand(2, *size, dtype=torch.float64).requires_grad_()
    plain = torch.stack(
        [torch.stack([propagator(wave * mask_field(height, own)).abs() ** 2 for wave in fields]) for height in heights]
    )
    target = torch.rand(plain.shape, dtype=torch.float64)
    (expected,) = torch.autograd.grad((plain * target).sum(), heights)
    found = point_spread(heights, fields, own, propagator)
    torch.testing.assert_close(found, plain)
    (gradient,) = torch.autograd.grad((found * target).sum(), heights)
    torch.testing.assert_close(gradient, expected)
    one = heights[:1].detach().requires_grad_()
    assert torch.autograd.gradcheck(lambda h: point_spread(h, fields, own, propagator), one)


def test_a_height_of_a_whole_wave_changes_nothing_at_its_wavelength():
    own = radians_per_metre([GREEN], None)
    heights = 1e-7 * torch.rand(1, *SIZE)
    pair = torch.cat([heights, heights + GREEN / 2 * (torch.rand(1, *SIZE) > 0.5)])
    one, other = PointSpread(FreeForm(pair), waves([0.7], [GREEN]), own, plane(wavelengths=[GREEN]))()
    torch.testing.assert_close(one, other, atol=1e-5, rtol=1e-3)
    assert float(own) == pytest.approx(4 * pi / GREEN)


def test_what_does_not_fit_is_refused():
    heights, own = FreeForm(torch.zeros(1, *SIZE)), radians_per_metre([GREEN, RED], None)
    with pytest.raises(ShapeError, match="waves"):
        PointSpread(heights, waves([1.0], [GREEN]), own, plane())
    with pytest.raises(SettingError, match="energy"):
        PointSpread(heights, waves([1.0]), own, plane(), "all")
