"""Zernike polynomials on the circle in a map: indices, modes, coefficients of a map."""

from __future__ import annotations

from collections.abc import Sequence
from math import isqrt

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.errors import SettingError, check_range
from tmca.optics.phase import pixel_places

Mode = tuple[int, int]
"""(n, m): radial order and azimuthal frequency, negative for the sine."""
_MOST = 10_000
"""No mask has modes of larger Noll indices: they are finer than its pixels."""


def noll(index: int) -> Mode:
    """(n, m) of a Noll index, 1 for piston. Source: Noll, J. Opt. Soc. Am. 66, 207 (1976).

    Raises:
        SettingError: an index below 1, or beyond any mask.
    """
    check_range("Noll index", index, 1, _MOST, whole=True)
    n = (isqrt(8 * index - 7) - 1) // 2
    place = index - n * (n + 1) // 2 - 1
    m = place + (place + n) % 2
    return n, m if index % 2 == 0 else -m


def noll_index(mode: Mode) -> int:
    """The Noll index of (n, m)."""
    n, m = _checked(mode)
    first = n * (n + 1) // 2 + abs(m)
    later = m > 0 if n % 4 in (2, 3) else m < 0
    return first + 1 if later or m == 0 else first


def _checked(mode: Mode) -> Mode:
    n, m = mode
    if n < 0 or abs(m) > n or (n - m) % 2:
        raise SettingError("Zernike mode", f"n = {n}, m = {m}", "n ≥ |m| of the same parity")
    return n, m


def pupil_coordinates(size: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """(ρ, θ) of the pixels (H, W) around the middle, ρ = 1 on the circle of diameter min(H, W); θ from x towards y."""
    y, x = (2 * place / min(size) for place in pixel_places(size, 1.0))
    return torch.hypot(y, x), torch.atan2(y.expand(*size), x.expand(*size))


def zernike_modes(modes: Sequence[Mode], size: tuple[int, int]) -> Tensor:
    """(M, H, W) modes (n, m) of unit rms over the circle (Noll's normalisation), zero outside it, float64.

    A map in metres is then the sum of coefficients in metres rms times modes. y runs downwards.

    Raises:
        SettingError: impossible modes.
    """
    rho, theta = pupil_coordinates(size)
    inside = (rho <= 1).double()
    maps = torch.zeros(len(modes), *size, dtype=torch.float64)
    for place, (n, m) in enumerate(map(_checked, modes)):
        azimuthal = torch.cos(m * theta) if m >= 0 else torch.sin(-m * theta)
        scale = float(n + 1 if m == 0 else 2 * (n + 1)) ** 0.5
        maps[place] = torch.from_numpy(radial(n, abs(m), rho.clamp(max=1).numpy())) * azimuthal * scale * inside
    return maps


def radial(n: int, m: int, rho: NDArray[np.float64]) -> NDArray[np.float64]:
    """R_n^m(ρ) for m ≥ 0, by a Jacobi polynomial: stable at orders where sums of factorials are not."""
    from scipy.special import eval_jacobi

    k = (n - m) // 2
    value: NDArray[np.float64] = (-1) ** k * rho**m * eval_jacobi(k, m, 0, 1 - 2 * rho**2)
    return value


def fit_zernike(values: Tensor, modes: Sequence[Mode]) -> tuple[Tensor, Tensor]:
    """Coefficients (M,) of a map (H, W) over the circle by least squares, and what they leave (H, W), 0 outside it.

    Pixels that are not finite do not count.

    Raises:
        SettingError: fewer known pixels than modes.
    """
    size = (values.shape[0], values.shape[1])
    basis, rho = zernike_modes(modes, size), pupil_coordinates(size)[0]
    valid = (rho <= 1) & torch.isfinite(values)
    if int(valid.sum()) < len(basis):
        raise SettingError("values", f"{int(valid.sum())} known pixels", f"at least {len(basis)}, one for each mode")
    fit = torch.linalg.lstsq(basis[:, valid].mT, values[valid].double()[:, None]).solution[:, 0]
    left = torch.where(valid, values.double() - torch.tensordot(fit, basis, 1), torch.zeros((), dtype=torch.float64))
    return fit, left
