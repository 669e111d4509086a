"""Optics of the spectral camera: where each band falls on the sensor, and the blur of the relay before it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, inf, isfinite
from numbers import Real
from typing import cast

import torch
from torch import Tensor

from tmca.errors import SettingError

_DECIMALS, _FARTHEST = 9, 10_000


@dataclass(frozen=True)
class Dispersion:
    """Displacement of every band along the last axis, in pixels: band ℓ of scene column n falls on snapshot column
    ``n + displacement[ℓ] - origin``.

    Any values will do: negative, fractional, not monotone. A fractional displacement splits the light of a pixel
    between two neighbours, linearly (thesis eq 21 with the errata).

    Args:
        displacement: one value per band, pixels.

    Raises:
        SettingError: no bands, or a displacement that is not finite.
    """

    displacement: tuple[float, ...]

    def __post_init__(self) -> None:
        # what differs from a whole pixel by rounding errors only must not become a tap of its own
        values = tuple(round(float(d), _DECIMALS) for d in self.displacement)
        if not values or not all(isfinite(d) and abs(d) <= _FARTHEST for d in values):
            raise SettingError("dispersion", str(list(values)), f"pixels per band, one each, within ±{_FARTHEST}")
        object.__setattr__(self, "displacement", values)

    @classmethod
    def linear(cls, bands: int, step: float = 1.0) -> Dispersion:
        """``d_ℓ = ℓ · step`` pixels (the thesis: 1 pixel per band); a negative step disperses the other way."""
        return cls(tuple(step * band for band in range(bands)))

    @classmethod
    def of(cls, displacement: float | Sequence[float] | Dispersion, bands: int) -> Dispersion:
        """Pixels per band, or one displacement for each band, as a ``Dispersion`` of ``bands`` bands."""
        if isinstance(displacement, Real):
            return cls.linear(bands, float(displacement))
        if not isinstance(displacement, Dispersion):
            displacement = cls(tuple(cast(Sequence[float], displacement)))
        if displacement.bands != bands:
            raise SettingError("dispersion", f"{displacement.bands} values", f"one for each of {bands} bands")
        return displacement

    def scaled(self, factor: float) -> Dispersion:
        """Every band so many times as far from the middle of the displacements."""
        middle = (min(self.displacement) + max(self.displacement)) / 2
        return Dispersion(tuple(middle + factor * (one - middle) for one in self.displacement))

    @property
    def bands(self) -> int:
        """Number of bands L."""
        return len(self.displacement)

    @property
    def origin(self) -> int:
        """Scene column on which snapshot column 0 lies, pixels."""
        return floor(min(self.displacement))

    @property
    def extent(self) -> int:
        """Columns that the snapshot is wider than the scene: ⌈max d⌉ - ⌊min d⌋."""
        return ceil(max(self.displacement)) - self.origin

    def taps(self) -> tuple[tuple[int, int, float], ...]:
        """(band, offset on the snapshot, weight) of every tap: one per band, two where it falls between pixels."""
        taps = []
        for band, d in enumerate(self.displacement):
            whole, part = floor(d) - self.origin, d - floor(d)
            taps.append((band, whole, 1 - part))
            if part > 0:
                taps.append((band, whole + 1, part))
        return tuple(taps)


def gaussian_psf(sigma: float | Sequence[float], bands: int, radius: int | None = None) -> Tensor:
    """(L, 2·radius+1, 2·radius+1) blur of the relay optics between mask and sensor: Gaussians of unit energy.

    Args:
        sigma: standard deviation in pixels, one value or one per band; 0 is a perfect relay.
        bands: number of bands L.
        radius: half width of the kernels, pixels; 3 standard deviations if None.

    Raises:
        SettingError: negative sigma or a wrong number of them.
    """
    try:
        sigmas = [float(sigma)] * bands if isinstance(sigma, Real) else [float(s) for s in cast(Sequence[float], sigma)]
    except (TypeError, ValueError):
        sigmas = []
    if len(sigmas) != bands or not all(0 <= s < inf for s in sigmas):
        raise SettingError("relay_blur", str(sigma), f"one or {bands} standard deviations ≥ 0, in pixels")
    reach = radius if radius is not None else max(1, round(3 * max(sigmas)))
    axis = torch.arange(-reach, reach + 1, dtype=torch.float64)
    lines = [torch.exp(-(axis**2) / (2 * s**2)) if s**2 > 0 else (axis == 0).double() for s in sigmas]
    squares = (torch.outer(line, line) for line in lines)
    return torch.stack([square / square.sum() for square in squares]).to(torch.get_default_dtype())


def on_columns(values: Tensor, first: int, width: int) -> Tensor:
    """(…, W) values on a sensor that begins so many columns earlier, 0 where they have none."""
    laid = values.new_zeros(*values.shape[:-1], width)
    start, stop = max(0, first), min(width, first + values.shape[-1])
    laid[..., start:stop] = values[..., start - first : stop - first]
    return laid
