"""Colour on the sensor: filters over its pixels, and how its channels see the spectrum (thesis eqs 31 to 36)."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from math import inf
from numbers import Integral
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor, nn

from tmca.codes import CodePlane, balanced_choice, check_shares, one_hot_planes
from tmca.errors import SettingError, ShapeError, check_choice, check_range, check_shape

SENSORS = ("monochrome", "rgb")
FILTERS = ("clear", "gaussian", "rgbw")
_CAMERA = "Nikon 5100 (NPL)"


class ColourCodedAperture(nn.Module):
    """Filters over the pixels of the sensor, repeated with a period: ``C_{ℓ,m,n} = Σ_r w_{r,m,n} F_{r,ℓ}``.

    Each cell is a mixture of R feasible filters while ``relaxed``, and one of them otherwise; gradients pass in both.
    Source: thesis section 5.1; Arguello et al., Optica 8, 1424 (2021).

    Args:
        filters: (R, L) transmittance.
        size: (H, W) of the sensor, pixels.
        period: side of the tile Q, or (height, width), pixels; that of ``cells`` if given.
        cells: (Q, Q) index of the filter over every pixel of the tile; random, each filter as often, if None.
        seed: of random cells.
        learnable: whether the choice of filters is learned.
        slope: of the softmax over filters.
        jitter: see ``CodePlane``.

    Raises:
        ShapeError, SettingError: filters outside [0, 1], or cells that name no filter.
    """

    filters: Tensor

    def __init__(
        self,
        filters: Tensor,
        size: tuple[int, int],
        period: int | tuple[int, int] = 4,
        *,
        cells: Tensor | None = None,
        seed: int = 0,
        learnable: bool = False,
        slope: float = 4.0,
        jitter: float = 0.5,
    ) -> None:
        super().__init__()
        values = torch.as_tensor(filters, dtype=torch.get_default_dtype())
        check_shape("filters", values, ("R", "L"))
        check_shares("filters", values, "transmittance of every filter and band")
        self.register_buffer("filters", values)
        if cells is None:
            cells = balanced_choice(len(values), (period, period) if isinstance(period, int) else period, seed)
        tile = (len(cells), len(cells[0]))
        self.plane = CodePlane(
            "one-hot", len(values), size, period=tile, seed=seed, learnable=learnable, slope=slope, jitter=jitter,
            name="colour-coded aperture",
        )  # fmt: skip
        self.plane.show(_one_hot(cells, len(values)), jitter=jitter, seed=seed)

    @classmethod
    def of(
        cls,
        filters: str | Tensor | ColourCodedAperture,
        wavelengths: Sequence[float],
        size: tuple[int, int],
        period: int,
        cells: Tensor | None = None,
        seed: int = 0,
        *,
        learnable: bool = False,
    ) -> ColourCodedAperture:
        """Filters of a family of ``feasible_filters``, of (R, L) transmittance, or those that are given, at this size;
        where there is one alone, its choice is not learned."""
        if isinstance(filters, ColourCodedAperture):
            return filters.resized(size)
        passed = feasible_filters(filters, wavelengths) if isinstance(filters, str) else filters
        check_shape("filters", passed, ("R", len(wavelengths)), "give the bands of the camera")
        if cells is not None:
            check_shape("cells", cells, (period, period), "a tile of the period")
        return cls(passed, size, period, cells=cells, seed=2 * seed, learnable=learnable and len(passed) > 1)

    @property
    def learnable(self) -> bool:
        """Whether the choice of filters is learned."""
        return self.plane.learnable

    def resized(self, size: tuple[int, int]) -> ColourCodedAperture:
        """The same tile over a sensor of another size (H, W); itself at its own size."""
        if size == self.plane.size:
            return self
        tensors = (*self.parameters(), *self.buffers())
        other = copy.deepcopy(self, {id(tensor): tensor for tensor in tensors})  # which are shared
        other.plane = self.plane.resized(size)
        return other

    def relax(self, relaxed: bool) -> None:
        """Let cells be mixtures, or one filter each again."""
        self.plane.relaxed = relaxed

    def forward(self) -> Tensor:
        """(L, H, W) transmittance over every pixel."""
        return torch.einsum("rhw,rl->lhw", self.plane(), self.filters)

    def part(self, rows: slice, columns: slice) -> Tensor:
        """(L, h, w) transmittance over some pixels."""
        return torch.einsum("rhw,rl->lhw", self.plane.part(rows, columns), self.filters)

    def cells(self) -> Tensor:
        """(Q, Q) index of the filter over every pixel of the tile."""
        return self.plane.tile().argmax(0)


def _one_hot(cells: Tensor, count: int) -> Tensor:
    chosen = torch.as_tensor(cells)
    if chosen.ndim != 2 or chosen.is_floating_point() or not bool(((chosen >= 0) & (chosen < count)).all()):
        raise SettingError("cells", str(chosen.tolist())[:60], f"(Q, Q) whole numbers from 0 to {count - 1}")
    return one_hot_planes(chosen, count)


def feasible_filters(family: str, wavelengths: Sequence[float], count: int = 4) -> Tensor:
    """(R, L) transmittance of named filters.

    ``"clear"``: one that passes everything. ``"gaussian"``: R bell-shaped pass bands side by side over the range.
    ``"rgbw"``: the red, green and blue of a measured camera, each scaled to a peak of one, and clear.

    Args:
        family: one of ``FILTERS``.
        wavelengths: (L,) metres.
        count: R of ``"gaussian"``.

    Raises:
        SettingError: unknown family or none.
    """
    check_choice("filters", family, FILTERS)
    check_range("filters", count, 1)
    if family == "clear":
        return torch.ones(1, len(wavelengths))
    if family == "rgbw":
        return torch.cat([channel_response("rgb", wavelengths), torch.ones(1, len(wavelengths))])
    bands = torch.as_tensor(list(wavelengths), dtype=torch.float64)
    width = (bands.max() - bands.min()).clamp_min(1e-9) / count
    middles = bands.min() + width * (torch.arange(count) + 0.5)
    return torch.exp(-0.5 * ((bands - middles[:, None]) / (width / 2)) ** 2).float()


def channel_response(sensor: str | Tensor | Sequence[Sequence[float]], wavelengths: Sequence[float]) -> Tensor:
    """(C, L) response κ of the sensor's channels, at most 1.

    Args:
        sensor: ``"monochrome"``, ``"rgb"`` (measured sensitivities of a Nikon D5100, from colour-science), or (C, L).
        wavelengths: (L,) metres.

    Raises:
        SettingError: unknown sensor, or values outside [0, 1].
        ShapeError: a table of another number of bands.
    """
    if isinstance(sensor, str):
        if sensor not in SENSORS:
            raise SettingError("channels", repr(sensor), f"one of {', '.join(SENSORS)}, or a table (C, L)")
        response = torch.ones(1, len(wavelengths)) if sensor == "monochrome" else _camera_sensitivities(wavelengths)
        if response.sum(1).min() <= 0:
            bands = f"{min(wavelengths) * 1e9:.0f} to {max(wavelengths) * 1e9:.0f} nm"
            raise SettingError("channels", f"{sensor}, a channel of which is blind at {bands}", "bands that it sees")
        return response
    values = torch.as_tensor(sensor, dtype=torch.get_default_dtype())
    check_shape("channels", values, ("C", len(wavelengths)))
    check_shares("channels", values, "a response for every band")
    if values.sum(1).min() <= 0:
        raise SettingError("channels", "a blind channel", "a response for every band")
    return values


def band_wavelengths(bands: int | Sequence[float]) -> tuple[float, ...]:
    """Wavelengths of bands, metres; of their number, evenly spaced from 400 to 700 nm.

    Raises:
        SettingError: no bands, equal ones, or nanometres.
    """
    if isinstance(bands, Integral):
        check_range("bands", bands, 1)
        values = torch.linspace(400e-9, 700e-9, int(bands), dtype=torch.float64).tolist()
        return tuple(values) if len(values) > 1 else (550e-9,)
    values = [float(w) for w in cast(Sequence[float], bands)]
    if not values or not all(100e-9 < w < 100e-6 for w in values) or len(set(values)) < len(values):
        raise SettingError("bands", str(values), "different wavelengths in metres, such as 550e-9", "give nm × 1e-9")
    return tuple(values)


def channel_weights(where: str, values: Any, shape: tuple[int, ...]) -> Tensor:
    """Weights of a scene's channels, such as a sensor's response to bands, of this shape.

    Raises:
        ShapeError, SettingError: others, or negative ones, or all zero.
    """
    try:
        weights = values if isinstance(values, Tensor) else torch.tensor(values, dtype=torch.get_default_dtype())
    except (TypeError, ValueError):
        raise ShapeError(where, "rows of unequal length, or no numbers", str(shape)) from None
    check_shape(where, weights, shape)
    smallest, largest = torch.aminmax(weights)  # NaN where any value is
    if not (smallest >= 0 and 0 < largest < inf):
        raise SettingError(where, str(weights.tolist()), "finite numbers ≥ 0, not all zero")
    return weights


def _camera_sensitivities(wavelengths: Sequence[float]) -> Tensor:
    """(3, L) red, green, blue, each with a peak of one over the whole spectrum; linear between 5 nm samples."""
    from colour import MSDS_CAMERA_SENSITIVITIES

    table = MSDS_CAMERA_SENSITIVITIES[_CAMERA]
    grid, values = np.asarray(table.wavelengths) * 1e-9, np.asarray(table.values)
    channels = np.stack([np.interp(wavelengths, grid, channel, 0, 0) for channel in values.T / values.max()])
    return torch.from_numpy(channels.clip(0, 1)).float()
