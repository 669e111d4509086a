"""Height maps: what is put in is shown, within the device's stroke; gradients reach every parameter."""

import pytest
import torch

from tmca.errors import SettingError, ShapeError
from tmca.optics.heights import FreeForm, RotationalProfile, Stroke, ZernikeHeights
from tmca.optics.zernike import noll, zernike_modes

GREEN = 550e-9


@pytest.mark.parametrize("size", [(12, 12), (11, 14)])
def test_parametrisations_show_what_they_are_given(size):
    heights = 2e-6 * torch.rand(3, *size)
    torch.testing.assert_close(FreeForm(heights)(), heights)
    modes = [noll(4), noll(6)]
    coefficients = torch.tensor([[1e-7, -2e-7], [0.0, 3e-7]])
    expected = torch.einsum("km,mhw->khw", coefficients.double(), zernike_modes(modes, size)).float()
    torch.testing.assert_close(ZernikeHeights(coefficients, modes, size)(), expected, atol=1e-12, rtol=1e-5)
    radii = torch.tensor([[0.0, 1e-6, 4e-6]])
    shown = RotationalProfile(radii, size)()
    torch.testing.assert_close(shown, shown.flip(1, 2))
    middle = [(n - 1) / 2 for n in size]
    for row, column in ((1, 3), (5, 5), (0, 0)):
        rho = min(2 * ((row - middle[0]) ** 2 + (column - middle[1]) ** 2) ** 0.5 / min(size), 1)
        expected = 1e-6 * (2 * rho if rho <= 0.5 else 1 + 3 * (2 * rho - 1))
        assert float(shown[0, row, column]) == pytest.approx(expected, rel=1e-4)


def test_a_device_shows_its_stroke_and_levels_and_gradients_pass():
    stroke = Stroke(0.0, 1e-6, levels=5)
    maps = FreeForm(torch.tensor([[[1e-7, 1.3e-7, 6.1e-7, 9e-7]]]), stroke, learnable=True)
    with torch.no_grad():  # as an optimiser moves them
        maps.heights += torch.tensor([-2e-7, 0, 0, 1.1e-6]) / maps.unit
    torch.testing.assert_close(maps(), torch.tensor([[[0.0, 2.5e-7, 5e-7, 1e-6]]]), atol=1e-12, rtol=1e-5)
    maps().sum().backward()
    assert (maps.heights.grad != 0).flatten().tolist() == [False, True, True, False]
    stroke.check(maps())
    with pytest.raises(SettingError, match="stroke"):
        stroke.check(maps.profile())
    with pytest.raises(SettingError, match=r"heights: found -0\.1 to 2 µm, expected 0 to 1 µm, the device's stroke"):
        FreeForm(maps.profile().detach(), stroke)
    for refused in (lambda: Stroke(1e-6, 1e-6), lambda: Stroke(0, 1e-6, levels=1)):
        with pytest.raises(SettingError):
            refused()


def test_gradients_reach_every_parametrisation():
    for maps in (
        ZernikeHeights(torch.full((2, 2), 1e-8), [noll(4), noll(5)], (6, 7), learnable=True),
        RotationalProfile(torch.rand(1, 4) * 1e-6, (6, 7), learnable=True),
    ):
        (maps() * torch.rand(6, 7)).sum().backward()
        assert all(parameter.grad.abs().sum() > 0 for parameter in maps.parameters())


def test_wrong_shapes_are_refused():
    for where, refused in (
        ("heights", lambda: FreeForm(torch.zeros(3, 3))),
        ("coefficients", lambda: ZernikeHeights(torch.zeros(1, 3), [noll(2)], (4, 4))),
        ("coefficients", lambda: ZernikeHeights(torch.zeros(1, 0), [], (4, 4))),
        ("radii", lambda: RotationalProfile(torch.zeros(1, 1), (4, 4))),
    ):
        with pytest.raises(ShapeError, match=f"^{where}: "):
            refused()
