"""Propagation beside another library's: angular spectrum, and one step from the mask to the sensor."""

import pytest
import torch
from torchoptics import Field

from tmca.optics import AngularSpectrum, FocalPlane

GREEN, PITCH = 550e-9, 10e-6
SIZES = [(64, 64), (63, 50)]


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
