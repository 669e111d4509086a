"""Height maps of phase masks, one per time slot: what is learned, and what a device can show of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from tmca.errors import SettingError, ShapeError
from tmca.optics.materials import Material
from tmca.optics.phase import pixel_places
from tmca.optics.zernike import Mode, pupil_coordinates, zernike_modes

HIGHEST = 1e-2
"""Metres that no phase mask is high."""


@dataclass(frozen=True)
class Stroke:
    """What a device can show.

    Args:
        low, high: least and largest height, metres.
        levels: number of evenly spaced heights; any without.

    Raises:
        SettingError: an empty range, or fewer than two levels.
    """

    low: float
    high: float
    levels: int | None = None

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise SettingError("stroke", f"{self.low:g} to {self.high:g} m", "a least height below the largest")
        if self.levels is not None and self.levels < 2:
            raise SettingError("levels", str(self.levels), "2 or more")

    def shown(self, heights: Tensor) -> Tensor:
        """The nearest heights that can be shown; gradients pass where the range is kept."""
        kept = heights.clamp(self.low, self.high)
        if self.levels is None:
            return kept
        step = (self.high - self.low) / (self.levels - 1)
        nearest = self.low + ((kept.detach() - self.low) / step).round() * step
        return kept + (nearest - kept.detach())

    def check(self, heights: Tensor, where: str = "heights") -> None:
        """Raises SettingError where heights go beyond the stroke by more than rounding."""
        values, slack = heights.detach(), 1e-6 * (self.high - self.low)
        lowest, highest = float(values.min()), float(values.max())
        if lowest < self.low - slack or highest > self.high + slack:
            found = f"{lowest * 1e6:.4g} to {highest * 1e6:.4g} µm"
            known = f"{self.low * 1e6:.4g} to {self.high * 1e6:.4g} µm, the device's stroke"
            raise SettingError(where, found, known, "scale them down, or set the stroke of the device")


class HeightMaps(nn.Module):
    """K height maps (K, H, W) in metres.

    Args:
        size: (H, W) pixels.
        stroke: of the device; any height without.
    """

    def __init__(self, size: tuple[int, int], stroke: Stroke | None = None) -> None:
        super().__init__()
        self.size, self.stroke = (int(size[0]), int(size[1])), stroke

    def forward(self) -> Tensor:
        """(K, H, W), as the device shows them."""
        heights = self.profile()
        return heights if self.stroke is None else self.stroke.shown(heights)

    def profile(self) -> Tensor:
        """(K, H, W), before the device's limits."""
        raise TypeError(f"{type(self).__name__} defines no profile")

    def repeated(self, slots: int, *, learnable: bool = False) -> HeightMaps:
        """The same maps in K slots, of the same family; of one slot that of all of them."""
        raise TypeError(f"{type(self).__name__} cannot be repeated")

    def _rows(self, values: Tensor, slots: int) -> Tensor:
        """(slots, ...) of (1, ...), or of as many."""
        if len(values) not in (1, slots):
            raise ShapeError("slots", str(slots), f"{len(values)}, as many as there are maps")
        return values.detach().expand(slots, *values.shape[1:]).clone()

    def _hold(self, name: str, values: Tensor, learnable: bool) -> None:
        kept = values.detach().clone().float()
        if learnable:
            self.register_parameter(name, nn.Parameter(kept))
        else:
            self.register_buffer(name, kept)


class FreeForm(HeightMaps):
    """A height for every pixel.

    Args:
        heights: (K, H, W) metres, start values.
        stroke: see ``HeightMaps``.
        learnable: whether heights are parameters.

    Raises:
        ShapeError: not K maps.
        SettingError: start values beyond the stroke; what is learned later is kept within it.
    """

    heights: Tensor

    def __init__(self, heights: Tensor, stroke: Stroke | None = None, *, learnable: bool = False) -> None:
        _check_dims("heights", heights, 3, "(K, H, W)")
        super().__init__((heights.shape[1], heights.shape[2]), stroke)
        if stroke is not None:
            stroke.check(heights)
        self.unit = _unit(heights)
        self._hold("heights", heights / self.unit, learnable)

    def profile(self) -> Tensor:
        """(K, H, W)."""
        return self.heights * self.unit

    def repeated(self, slots: int, *, learnable: bool = False) -> FreeForm:
        """See ``HeightMaps``; within the stroke."""
        return FreeForm(self._rows(self(), slots), self.stroke, learnable=learnable)


class ZernikeHeights(HeightMaps):
    """Sums of Zernike modes over a circular aperture, as a deformable mirror shows them.

    Args:
        coefficients: (K, M) metres rms.
        modes: (n, m) of each, see ``noll`` and ``osa``.
        size: (H, W) pixels.
        diameter: of the aperture, pixels; the smaller side without.
        stroke: see ``HeightMaps``.
        learnable: whether coefficients are parameters.

    Raises:
        ShapeError: coefficients of another number of modes.
    """

    coefficients: Tensor
    basis: Tensor

    def __init__(
        self,
        coefficients: Tensor,
        modes: Sequence[Mode],
        size: tuple[int, int],
        diameter: float | None = None,
        stroke: Stroke | None = None,
        *,
        learnable: bool = False,
    ) -> None:
        _check_dims("coefficients", coefficients, 2, "(K, M)")
        if coefficients.shape[1] != len(modes):
            raise ShapeError("coefficients", f"{coefficients.shape[1]} modes", f"{len(modes)}, as many as modes")
        super().__init__(size, stroke)
        self.modes, self.diameter, self.unit = tuple(modes), diameter, _unit(coefficients)
        self.register_buffer("basis", zernike_modes(modes, self.size, diameter).float(), persistent=False)
        self._hold("coefficients", coefficients / self.unit, learnable)

    def profile(self) -> Tensor:
        """(K, H, W)."""
        return torch.tensordot(self.metres(), self.basis, 1)

    def metres(self) -> Tensor:
        """(K, M) coefficients in metres rms."""
        return self.coefficients * self.unit

    def repeated(self, slots: int, *, learnable: bool = False) -> ZernikeHeights:
        """See ``HeightMaps``."""
        rows = self._rows(self.metres(), slots)
        return ZernikeHeights(rows, self.modes, self.size, self.diameter, self.stroke, learnable=learnable)


class RotationalProfile(HeightMaps):
    """Rotationally symmetric maps: heights at even radii from the middle to the rim, linear between them.

    Args:
        radii: (K, R) heights in metres, R ≥ 2.
        size: (H, W) pixels.
        diameter: where the last height stands, pixels; the smaller side without. Beyond it, it goes on.
        stroke: see ``HeightMaps``.
        learnable: whether heights are parameters.

    Raises:
        ShapeError: fewer than two heights.
    """

    radii: Tensor
    below: Tensor
    share: Tensor

    def __init__(
        self,
        radii: Tensor,
        size: tuple[int, int],
        diameter: float | None = None,
        stroke: Stroke | None = None,
        *,
        learnable: bool = False,
    ) -> None:
        _check_dims("radii", radii, 2, "(K, R), R ≥ 2", least=2)
        super().__init__(size, stroke)
        place = pupil_coordinates(self.size, diameter)[0].clamp(max=1) * (radii.shape[1] - 1)
        below = place.floor().clamp(max=radii.shape[1] - 2)
        self.diameter, self.unit = diameter, _unit(radii)
        self.register_buffer("below", below.long(), persistent=False)
        self.register_buffer("share", (place - below).float(), persistent=False)
        self._hold("radii", radii / self.unit, learnable)

    def profile(self) -> Tensor:
        """(K, H, W)."""
        radii = self.metres()
        return torch.lerp(radii[:, self.below], radii[:, self.below + 1], self.share)

    def metres(self) -> Tensor:
        """(K, R) heights in metres."""
        return self.radii * self.unit

    def repeated(self, slots: int, *, learnable: bool = False) -> RotationalProfile:
        """See ``HeightMaps``."""
        rows = self._rows(self.metres(), slots)
        return RotationalProfile(rows, self.size, self.diameter, self.stroke, learnable=learnable)


def fresnel_lens(
    size: tuple[int, int], pitch: float, focal: float, wavelength: float, material: Material | None, slots: int = 1
) -> Tensor:
    """(K, H, W) heights of a lens folded to one wavelength of path: the start of a learned mask.

    Args:
        size: (H, W) pixels.
        pitch: of the mask's pixels, metres.
        focal: length, metres; negative for a diverging lens.
        wavelength: that is focused, metres.
        material: of the mask; a mirror if None.
        slots: K equal maps.

    Raises:
        SettingError: a focal length of zero, or a pitch or wavelength that is not positive.
    """
    if focal == 0:
        raise SettingError("focal", f"{focal:g} m", "not 0")
    y, x = pixel_places(size, pitch)
    square = y**2 + x**2
    path = (abs(focal) - torch.sqrt(focal**2 + square)) * (1 if focal > 0 else -1)
    factor = 2.0 if material is None else float(material.index([wavelength])[0]) - 1
    return (torch.remainder(path, wavelength) / factor).expand(slots, -1, -1).clone()


def _unit(values: Tensor) -> float:
    """A micrometre, or what is largest: parameters near 1 suit every optimiser.

    Raises SettingError for what is no number or no height.
    """
    largest = float(values.detach().abs().max()) if values.numel() else 0.0
    if not largest <= HIGHEST:
        raise SettingError("heights", f"{largest:g} m", f"finite heights up to {HIGHEST:g} m", "give metres")
    return max(1e-6, largest)


def _check_dims(name: str, values: Any, dims: int, wanted: str, least: int = 1) -> None:
    if not isinstance(values, Tensor) or values.ndim != dims or 0 in values.shape or values.shape[-1] < least:
        shape = tuple(values.shape) if isinstance(values, Tensor) else type(values).__name__
        raise ShapeError(name, str(shape), wanted)
