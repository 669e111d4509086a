"""What a spectral-depth camera shows: height maps with their optics, and shutter patterns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from torch import Tensor, nn

from tmca.codes import BURST, CodePlane, balanced_choice, one_hot_planes
from tmca.codes.buckets import burst_pattern, check_buckets, check_patterns
from tmca.errors import SettingError, check_shape
from tmca.optics import FreeForm, HeightMaps, PhaseMaskBench, PointSpread, mask_heights


class PhaseCodes(nn.Module):
    """Height maps and shutter patterns of one exposure: what a spectral-depth camera shows.

    Args:
        optics: the point spread functions of the height maps, which are among their parts.
        shutter: (K, H, W) patterns.
    """

    if TYPE_CHECKING:

        def __call__(self) -> tuple[Tensor, Tensor]: ...

    def __init__(self, optics: PointSpread, shutter: nn.Module) -> None:
        super().__init__()
        self.optics, self.shutter = optics, shutter

    def forward(self) -> tuple[Tensor, Tensor]:
        """(height maps (K, Hm, Wm) in metres, shutter (K, H, W))."""
        return self.optics.heights(), self.shutter()


def mask_maps(
    mask: str | Tensor | HeightMaps, slots: int, bench: PhaseMaskBench, *, learnable: bool, **drawn: Any
) -> HeightMaps:
    """Height maps of K slots on a bench: of a family, drawn, or those that are given."""
    if isinstance(mask, str):
        return mask_heights(mask, slots, bench, learnable=learnable, **drawn)
    maps = mask if isinstance(mask, HeightMaps) else FreeForm(mask, drawn["stroke"], learnable=learnable)
    if learnable and not list(maps.parameters()):
        maps = maps.repeated(slots, learnable=True)
    check_shape("mask", maps(), (slots, *bench.mask_size))
    return maps


def shutter_plane(
    shutter: str | Tensor | nn.Module,
    slots: int,
    buckets: int,
    size: tuple[int, int],
    period: int,
    seed: int,
    learnable: bool,
) -> CodePlane:
    """K shutter patterns on a sensor (H, W), or R·K of R buckets; tiled unless they are given for all of it."""
    if isinstance(shutter, nn.Module):
        plane = shutter.resized(size) if isinstance(shutter, CodePlane) else shutter
        check_patterns(getattr(plane, "slots", slots), buckets, slots)  # type: ignore[arg-type]
        return plane  # type: ignore[return-value]
    if isinstance(shutter, str) and shutter == BURST:
        shutter = burst_pattern(slots, (period, period), buckets)
    if isinstance(shutter, Tensor) and shutter.ndim == 4:
        shutter = check_buckets(shutter, buckets, slots)
    count = slots if isinstance(shutter, str) or shutter.ndim == 2 else len(shutter)
    check_patterns(count, buckets, slots)
    tile, own_seed = None if isinstance(shutter, Tensor) and tuple(shutter.shape[1:]) == size else period, 2 * seed + 1
    plane = CodePlane(shutter, count, size, period=tile, seed=own_seed, learnable=learnable, name="shutter")
    if isinstance(shutter, str) and shutter == "one-hot":
        if slots > period**2:
            expected = f"at most {period**2}, the pixels of its period"
            raise SettingError("slots", f"{slots} with a one-hot shutter", expected, "take a longer period")
        plane.show(one_hot_planes(balanced_choice(slots, (period, period), own_seed), slots))
    return plane
