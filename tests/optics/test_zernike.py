"""Zernike polynomials: indices as published, orthonormal on the disk, fits that find what was put in."""

from math import factorial

import numpy as np
import pytest
import torch

from tmca.errors import SettingError
from tmca.optics.zernike import fit_zernike, noll, noll_index, pupil_coordinates, radial, zernike_modes

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
    truth = torch.randn(21, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
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
