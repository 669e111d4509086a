"""Height maps of phase masks, one per time slot: what is learned, and what a device can show of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from pydantic import with_config
from torch import Tensor, nn

from tmca.attributes import STRICT
from tmca.errors import SettingError, ShapeError, check_range, check_shape
from tmca.optics.zernike import Mode, noll, noll_index, pupil_coordinates, zernike_modes

HIGHEST = 1e-2
"""Metres that no phase mask is high."""


@with_config(STRICT)
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
        if self.levels is not None:
            check_range("levels", self.levels, 2)

    def shown(self, heights: Tensor) -> Tensor:
        """The nearest heights that can be shown; gradients pass where the range is kept."""
        within = heights.clamp(self.low, self.high)
        if self.levels is None:
            return within
        step = (self.high - self.low) / (self.levels - 1)
        nearest = self.low + ((within.detach() - self.low) / step).round() * step
        return within + (nearest - within.detach())

    def check(self, heights: Tensor, where: str = "heights") -> None:
        """Raises SettingError where heights go beyond the stroke by more than rounding."""
        values, slack = heights.detach(), 1e-6 * (self.high - self.low)
        lowest, highest = float(values.min()), float(values.max())
        if lowest < self.low - slack or highest > self.high + slack:
            text = f"{lowest * 1e6:.4g} to {highest * 1e6:.4g} µm"
            limits = f"{self.low * 1e6:.4g} to {self.high * 1e6:.4g} µm, the device's stroke"
            raise SettingError(where, text, limits, "scale them down, or set the stroke of the device")


class HeightMaps(nn.Module, ABC):
    """K height maps (K, H, W) in metres, of parameters near 1: metres over ``unit``.

    Args:
        values: (K, ...) start values of the parameters, metres.
        size: (H, W) pixels.
        stroke: of the device; any height without.
        learnable: whether they are learned.
        form: what else makes maps of this family, between values and stroke.

    Raises:
        SettingError: start values that are no height.
    """

    name: ClassVar[str]
    """Of the parameters."""

    def __init__(
        self, values: Tensor, size: tuple[int, int], stroke: Stroke | None, learnable: bool, *form: Any
    ) -> None:
        super().__init__()
        self.size, self.stroke, self._form = (int(size[0]), int(size[1])), stroke, form
        largest = float(values.detach().abs().max())
        check_range("heights", largest, 0, HIGHEST, unit="m")
        self.unit = max(1e-6, largest)
        start = (values / self.unit).detach().clone().float()
        if learnable:
            self.register_parameter(self.name, nn.Parameter(start))
        else:
            self.register_buffer(self.name, start)

    def metres(self) -> Tensor:
        """(K, ...) the parameters in metres."""
        values: Tensor = getattr(self, self.name)
        return values * self.unit

    def forward(self) -> Tensor:
        """(K, H, W), as the device shows them."""
        heights = self.profile()
        return heights if self.stroke is None else self.stroke.shown(heights)

    @abstractmethod
    def profile(self) -> Tensor:
        """(K, H, W), before the device's limits."""

    def repeated(self, slots: int, *, learnable: bool = False) -> HeightMaps:
        """The same maps in K slots, of the same family; of one slot that of all of them.

        Raises:
            ShapeError: another number of maps than one or K.
        """
        values = self._start().detach()
        if len(values) not in (1, slots):
            raise ShapeError("slots", str(slots), f"{len(values)}, as many as there are maps")
        family: Any = type(self)
        return family(values.expand(slots, *values.shape[1:]), *self._form, self.stroke, learnable=learnable)

    def _start(self) -> Tensor:
        """(K, ...) what maps of this family are made of."""
        return self.metres()


class FreeForm(HeightMaps):
    """A height for every pixel.

    Args:
        heights: (K, H, W) metres, start values.
        stroke, learnable: see ``HeightMaps``.

    Raises:
        ShapeError: not K maps.
        SettingError: start values beyond the stroke; what is learned later is kept within it.
    """

    name = "heights"
    heights: Tensor

    def __init__(self, heights: Tensor, stroke: Stroke | None = None, *, learnable: bool = False) -> None:
        check_shape("heights", heights, ("K", "H", "W"))
        if stroke is not None:
            stroke.check(heights)
        super().__init__(heights, (heights.shape[1], heights.shape[2]), stroke, learnable)

    def profile(self) -> Tensor:
        return self.metres()

    def _start(self) -> Tensor:
        return self()  # within the stroke


class ZernikeHeights(HeightMaps):
    """Sums of Zernike modes over the circle in the maps, as a deformable mirror shows them.

    Args:
        coefficients: (K, M) metres rms.
        modes: (n, m) of each, see ``noll``.
        size: (H, W) pixels.
        stroke, learnable: see ``HeightMaps``.

    Raises:
        ShapeError: coefficients of another number of modes.
    """

    name = "coefficients"
    coefficients: Tensor
    basis: Tensor

    def __init__(
        self,
        coefficients: Tensor,
        modes: Sequence[Mode],
        size: tuple[int, int],
        stroke: Stroke | None = None,
        *,
        learnable: bool = False,
    ) -> None:
        check_shape("coefficients", coefficients, ("K", "M"))
        check_shape("coefficients", coefficients, ("K", len(modes)))
        super().__init__(coefficients, size, stroke, learnable, modes, size)
        self.modes = tuple(modes)
        self.register_buffer("basis", zernike_modes(modes, self.size).float(), persistent=False)

    def profile(self) -> Tensor:
        return torch.tensordot(self.metres(), self.basis, 1)


class RotationalProfile(HeightMaps):
    """Rotationally symmetric maps: heights at even radii from the middle to the rim of the circle in the maps, linear
    between them; beyond it the last one goes on.

    Args:
        radii: (K, R) heights in metres, R ≥ 2.
        size: (H, W) pixels.
        stroke, learnable: see ``HeightMaps``.

    Raises:
        ShapeError: fewer than two heights.
    """

    name = "radii"
    radii: Tensor
    below: Tensor
    share: Tensor

    def __init__(
        self,
        radii: Tensor,
        size: tuple[int, int],
        stroke: Stroke | None = None,
        *,
        learnable: bool = False,
    ) -> None:
        if radii.ndim != 2 or len(radii) < 1 or radii.shape[1] < 2:
            raise ShapeError("radii", str(tuple(radii.shape)), "(K, R), R ≥ 2")
        super().__init__(radii, size, stroke, learnable, size)
        place = pupil_coordinates(self.size)[0].clamp(max=1) * (radii.shape[1] - 1)
        below = place.floor().clamp(max=radii.shape[1] - 2)
        self.register_buffer("below", below.long(), persistent=False)
        self.register_buffer("share", (place - below).float(), persistent=False)

    def profile(self) -> Tensor:
        radii = self.metres()
        return torch.lerp(radii[:, self.below], radii[:, self.below + 1], self.share)


def family_parameters(maps: HeightMaps) -> dict[str, Tensor]:
    """What a family's maps are made of, to be kept beside them; nothing of free-form maps.

    Returns:
        ``coefficients`` (K, M) in metres rms and ``noll`` (M,) of Zernike modes, or ``radii`` (K, R) in metres.
    """
    parameters = {}
    if isinstance(maps, ZernikeHeights | RotationalProfile):
        parameters[maps.name] = maps.metres().detach()
    if isinstance(maps, ZernikeHeights):
        parameters["noll"] = torch.tensor([noll_index(mode) for mode in maps.modes])
    return parameters


def restored_maps(heights: Tensor, parameters: Mapping[str, Tensor], stroke: Stroke | None = None) -> HeightMaps:
    """Maps of the family that ``family_parameters`` described, free-form without.

    Args:
        heights: (K, H, W) metres, as shown.
        parameters: of the family.
        stroke: of the device.

    Raises:
        ShapeError, SettingError: parameters that make no or other maps, or heights beyond the stroke.
    """
    size, maps = (heights.shape[-2], heights.shape[-1]), FreeForm(heights, stroke)
    if "coefficients" in parameters:
        if "noll" not in parameters:
            raise ShapeError("noll", "none beside the coefficients of modes", "the index of every mode")
        modes = [noll(int(index)) for index in parameters["noll"]]
        family: HeightMaps = ZernikeHeights(parameters["coefficients"], modes, size, stroke)
    elif "radii" in parameters:
        family = RotationalProfile(parameters["radii"], size, stroke)
    else:
        return maps
    if family().shape != heights.shape or not torch.allclose(family(), maps(), rtol=1e-4, atol=1e-9):
        raise SettingError("heights", "others than their modes or radii make", "the same", "leave modes and radii out")
    return family
