"""Height maps: what is put in is shown, within the device's stroke; Zernike modes as published, and fits of them."""

from math import factorial

import numpy as np
import pytest
import torch

from tmca.errors import SettingError, ShapeError
from tmca.optics.heights import FreeForm, RotationalProfile, Stroke, ZernikeHeights
from tmca.optics.zernike import fit_zernike, noll, noll_index, pupil_coordinates, radial, zernike_modes


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


NOLL = [(0, 0), (1, 1), (1, -1), (2, 0), (2, -2), (2, 2), (3, -1), (3, 1), (3, -3), (3, 3), (4, 0), (4, 2), (4, -2),
        (4, 4), (4, -4), (5, 1), (5, -1), (5, 3), (5, -3), (5, 5), (5, -5), (6, 0)]  # fmt: skip


def test_indices_are_those_of_noll():
    assert [noll(j) for j in range(1, 23)] == NOLL
    assert all(noll_index(noll(j)) == j for j in range(1, 500))


@pytest.mark.parametrize("mode", [(0, 0), (2, 0), (5, 3), (8, 2), (12, 0)])
def test_the_radial_part_is_the_sum_of_factorials(mode):
    (n, m), rho = mode, np.linspace(0, 1, 31)
    slow = sum(
        (-1) ** k * factorial(n - k) / (factorial(k) * factorial((n + m) // 2 - k) * factorial((n - m) // 2 - k))
        * rho ** (n - 2 * k)
        for k in range((n - m) // 2 + 1)
    )  # fmt: skip
    np.testing.assert_allclose(radial(n, m, rho), slow, atol=1e-9)


@pytest.mark.parametrize("size", [(201, 201), (150, 170)])
def test_modes_are_orthonormal_on_the_disk(size):
    modes = zernike_modes([noll(j) for j in range(1, 29)], size)
    inside = pupil_coordinates(size)[0] <= 1
    gram = modes.flatten(1) @ modes.flatten(1).mT / inside.sum()
    torch.testing.assert_close(gram, torch.eye(28, dtype=torch.float64), atol=0.04, rtol=0)
    fine = zernike_modes([noll(j) for j in range(1, 29)], (601, 601))
    inside = pupil_coordinates((601, 601))[0] <= 1
    better = fine.flatten(1) @ fine.flatten(1).mT / inside.sum()
    worst = [float((g - torch.eye(28, dtype=torch.float64)).abs().max()) for g in (gram, better)]
    assert worst[1] < worst[0] / 2


def test_a_fit_finds_the_coefficients_of_a_map_with_holes():
    modes = [noll(j) for j in range(1, 22)]
    truth = torch.randn(21, dtype=torch.float64)
    values = torch.tensordot(truth, zernike_modes(modes, (76, 90)), 1)
    values[30:36, 40:50] = torch.nan
    found, left = fit_zernike(values, modes)
    torch.testing.assert_close(found, truth)
    assert left.abs().max() < 1e-9
    with pytest.raises(SettingError, match="known pixels"):
        fit_zernike(values[:3, :3], modes)


def test_what_is_no_mode_is_refused():
    for refused in (
        lambda: noll(0),
        lambda: noll_index((2, 1)),
        lambda: zernike_modes([(1, 3)], (4, 4)),
    ):
        with pytest.raises(SettingError):
            refused()
