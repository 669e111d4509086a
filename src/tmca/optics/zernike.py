"""Zernike polynomials on a circular aperture: indices, modes, coefficients of a map."""

from __future__ import annotations

from collections.abc import Sequence
from math import isqrt

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.errors import SettingError

Mode = tuple[int, int]
"""(n, m): radial order and azimuthal frequency, negative for the sine."""


def noll(index: int) -> Mode:
    """(n, m) of a Noll index, 1 for piston. Source: Noll, J. Opt. Soc. Am. 66, 207 (1976).

    Raises:
        SettingError: an index below 1.
    """
    _check_index("Noll index", index, 1)
    n = (isqrt(8 * index - 7) - 1) // 2
    place = index - n * (n + 1) // 2 - 1
    m = place + (place + n) % 2
    return n, m if index % 2 == 0 else -m


def noll_index(mode: Mode) -> int:
    """The Noll index of (n, m)."""
    n, m = checked_mode(mode)
    first = n * (n + 1) // 2 + abs(m)
    even = n % 4 in (0, 1)
    later = (m >= 0) if not even else (m <= 0)
    return first + 1 if (later and m != 0) or (m == 0) else first


def osa(index: int) -> Mode:
    """(n, m) of an OSA/ANSI index, 0 for piston. Source: ANSI Z80.28.

    Raises:
        SettingError: a negative index.
    """
    _check_index("OSA index", index, 0)
    n = (isqrt(8 * index + 1) - 1) // 2
    return n, 2 * index - n * (n + 2)


def osa_index(mode: Mode) -> int:
    """The OSA/ANSI index of (n, m)."""
    n, m = checked_mode(mode)
    return (n * (n + 2) + m) // 2


def checked_mode(mode: Mode) -> Mode:
    """The mode itself.

    Raises:
        SettingError: |m| above n, or of other parity.
    """
    n, m = mode
    if n < 0 or abs(m) > n or (n - m) % 2:
        raise SettingError("Zernike mode", f"n = {n}, m = {m}", "n ≥ |m| of the same parity")
    return n, m


def _check_index(name: str, index: int, least: int) -> None:
    if isinstance(index, bool) or index != int(index) or index < least:
        raise SettingError(name, repr(index), f"a whole number, {least} or more")


def pupil_coordinates(size: tuple[int, int], diameter: float | None = None) -> tuple[Tensor, Tensor]:
    """(ρ, θ) of the pixels (H, W) around the middle; ρ = 1 on the circle of the diameter in pixels, min(H, W) without.

    Raises:
        SettingError: a diameter that is not positive.
    """
    wide = float(min(size) if diameter is None else diameter)
    if not wide > 0:
        raise SettingError("diameter", f"{wide:g}", "pixels, above 0")
    y, x = (2 * (torch.arange(n, dtype=torch.float64) - (n - 1) / 2) / wide for n in size)
    return torch.hypot(y[:, None], x[None]), torch.atan2(y[:, None].expand(*size), x[None].expand(*size))


def zernike_modes(modes: Sequence[Mode], size: tuple[int, int], diameter: float | None = None) -> Tensor:
    """(M, H, W) modes of unit rms over the unit disk (Noll's normalisation), zero outside it, float64.

    A map in metres is then the sum of coefficients in metres rms times modes. y runs downwards, θ from x towards y.

    Args:
        modes: (n, m) of each, see ``noll`` and ``osa``.
        size: (H, W) pixels.
        diameter: of the unit disk, pixels; the smaller side without.

    Raises:
        SettingError: impossible modes or diameter.
    """
    rho, theta = pupil_coordinates(size, diameter)
    inside = (rho <= 1).double()
    found = [
        torch.from_numpy(radial(n, abs(m), rho.clamp(max=1).numpy())) * _azimuthal(m, theta) * _scale(n, m) * inside
        for n, m in map(checked_mode, modes)
    ]
    return torch.stack(found) if found else torch.zeros(0, *size, dtype=torch.float64)


def radial(n: int, m: int, rho: NDArray[np.float64]) -> NDArray[np.float64]:
    """R_n^m(ρ) for m ≥ 0, by a Jacobi polynomial: stable at orders where sums of factorials are not."""
    from scipy.special import eval_jacobi

    k = (n - m) // 2
    value: NDArray[np.float64] = (-1) ** k * rho**m * eval_jacobi(k, m, 0, 1 - 2 * rho**2)
    return value


def _azimuthal(m: int, theta: Tensor) -> Tensor:
    return torch.cos(m * theta) if m >= 0 else torch.sin(-m * theta)


def _scale(n: int, m: int) -> float:
    return float((n + 1) if m == 0 else 2 * (n + 1)) ** 0.5


def fit_zernike(values: Tensor, modes: Sequence[Mode], diameter: float | None = None) -> tuple[Tensor, Tensor]:
    """Coefficients (M,) of a map (H, W) over the unit disk by least squares, and what they leave (H, W), 0 outside it.

    Args:
        values: map; pixels that are not finite do not count.
        modes: (n, m) of each.
        diameter: of the unit disk, pixels.

    Raises:
        SettingError: fewer known pixels than modes.
    """
    size = (values.shape[0], values.shape[1])
    basis, (rho, _) = zernike_modes(modes, size, diameter), pupil_coordinates(size, diameter)
    known = (rho <= 1) & torch.isfinite(values)
    if int(known.sum()) < len(basis):
        raise SettingError("values", f"{int(known.sum())} known pixels", f"at least {len(basis)}, one for each mode")
    found = torch.linalg.lstsq(basis[:, known].mT, values[known].double()[:, None]).solution[:, 0]
    left = torch.where(known, values.double() - torch.tensordot(found, basis, 1), torch.zeros((), dtype=torch.float64))
    return found, left
