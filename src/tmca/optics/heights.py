"""Height maps of phase masks, one per time slot: what is learned, and what a device can show of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from tmca.errors import SettingError, ShapeError, check_range, check_shape
from tmca.optics.materials import Material
from tmca.optics.phase import pixel_places
from tmca.optics.zernike import Mode, noll, noll_index, pupil_coordinates, zernike_modes

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
        size: (H, W) pixels.
        stroke: of the device; any height without.
        name: of the parameters.
        values: (K, ...) their start values, metres.
        learnable: whether they are learned.

    Raises:
        SettingError: start values that are no height.
    """

    def __init__(
        self, size: tuple[int, int], stroke: Stroke | None, name: str, values: Tensor, learnable: bool
    ) -> None:
        super().__init__()
        self.size, self.stroke, self.name = (int(size[0]), int(size[1])), stroke, name
        largest = float(values.detach().abs().max())
        if not largest <= HIGHEST:
            raise SettingError("heights", f"{largest:g} m", f"finite heights up to {HIGHEST:g} m", "give metres")
        self.unit = max(1e-6, largest)
        start = (values / self.unit).detach().clone().float()
        if learnable:
            self.register_parameter(name, nn.Parameter(start))
        else:
            self.register_buffer(name, start)

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
        values = self._start()
        if len(values) not in (1, slots):
            raise ShapeError("slots", str(slots), f"{len(values)}, as many as there are maps")
        return self._of(values.detach().expand(slots, *values.shape[1:]), learnable)

    def _start(self) -> Tensor:
        """(K, ...) what maps of this family are made of."""
        return self.metres()

    @abstractmethod
    def _of(self, values: Tensor, learnable: bool) -> HeightMaps:
        """Maps of this family of other parameters in metres."""


class FreeForm(HeightMaps):
    """A height for every pixel.

    Args:
        heights: (K, H, W) metres, start values.
        stroke, learnable: see ``HeightMaps``.

    Raises:
        ShapeError: not K maps.
        SettingError: start values beyond the stroke; what is learned later is kept within it.
    """

    heights: Tensor

    def __init__(self, heights: Tensor, stroke: Stroke | None = None, *, learnable: bool = False) -> None:
        check_shape("heights", heights, ("K", "H", "W"))
        if stroke is not None:
            stroke.check(heights)
        super().__init__((heights.shape[1], heights.shape[2]), stroke, "heights", heights, learnable)

    def profile(self) -> Tensor:
        """(K, H, W)."""
        return self.metres()

    def _start(self) -> Tensor:
        """Within the stroke."""
        return self()

    def _of(self, values: Tensor, learnable: bool) -> FreeForm:
        return FreeForm(values, self.stroke, learnable=learnable)


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
        super().__init__(size, stroke, "coefficients", coefficients, learnable)
        self.modes = tuple(modes)
        self.register_buffer("basis", zernike_modes(modes, self.size).float(), persistent=False)

    def profile(self) -> Tensor:
        """(K, H, W)."""
        return torch.tensordot(self.metres(), self.basis, 1)

    def _of(self, values: Tensor, learnable: bool) -> ZernikeHeights:
        return ZernikeHeights(values, self.modes, self.size, self.stroke, learnable=learnable)


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
        check_shape("radii", radii, ("K", "R"))
        if radii.shape[1] < 2:
            raise ShapeError("radii", str(tuple(radii.shape)), "(K, R), R ≥ 2")
        super().__init__(size, stroke, "radii", radii, learnable)
        place = pupil_coordinates(self.size)[0].clamp(max=1) * (radii.shape[1] - 1)
        below = place.floor().clamp(max=radii.shape[1] - 2)
        self.register_buffer("below", below.long(), persistent=False)
        self.register_buffer("share", (place - below).float(), persistent=False)

    def profile(self) -> Tensor:
        """(K, H, W)."""
        radii = self.metres()
        return torch.lerp(radii[:, self.below], radii[:, self.below + 1], self.share)

    def _of(self, values: Tensor, learnable: bool) -> RotationalProfile:
        return RotationalProfile(values, self.size, self.stroke, learnable=learnable)


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


def family_parameters(maps: HeightMaps) -> dict[str, Tensor]:
    """What a family's maps are made of, to be kept beside them; nothing of free-form maps.

    Returns:
        ``coefficients`` (K, M) in metres rms and ``noll`` (M,) of Zernike modes, or ``radii`` (K, R) in metres.
    """
    if isinstance(maps, ZernikeHeights):
        places = torch.tensor([noll_index(mode) for mode in maps.modes])
        return {"coefficients": maps.metres().detach(), "noll": places}
    if isinstance(maps, RotationalProfile):
        return {"radii": maps.metres().detach()}
    return {}


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
        modes = [noll(int(index)) for index in parameters["noll"]]
        family: HeightMaps = ZernikeHeights(parameters["coefficients"], modes, size, stroke=stroke)
    elif "radii" in parameters:
        family = RotationalProfile(parameters["radii"], size, stroke=stroke)
    else:
        return maps
    if family().shape != heights.shape or not torch.allclose(family(), maps(), rtol=1e-4, atol=1e-9):
        raise SettingError("heights", "others than their modes or radii make", "the same", "leave modes and radii out")
    return family
