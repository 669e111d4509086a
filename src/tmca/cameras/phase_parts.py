"""Parts of the spectral-depth camera, from what describes them: masks, shutter, filters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torch import Tensor, nn

from tmca.cameras.checks import check_one_hot
from tmca.codes import CodePlane, balanced_choice, one_hot_planes
from tmca.errors import SettingError, ShapeError
from tmca.optics import FreeForm, HeightMaps, PhaseMaskBench, Stroke, mask_heights
from tmca.sensor import ColourCodedAperture, feasible_filters

Size = tuple[int, int]


def mask_maps(
    mask: str | Tensor | HeightMaps,
    slots: int,
    bench: PhaseMaskBench,
    stroke: Stroke | None,
    *,
    learnable: bool,
    **drawn: Any,
) -> HeightMaps:
    """Height maps of K slots on a bench: of a family, drawn, or those that are given.

    Raises:
        ShapeError: maps of another size or number.
    """
    if isinstance(mask, str):
        return mask_heights(mask, slots, bench, stroke=stroke, learnable=learnable, **drawn)
    maps = mask if isinstance(mask, HeightMaps) else FreeForm(mask, stroke, learnable=learnable)
    if learnable and not list(maps.parameters()):
        maps = maps.repeated(slots, learnable=True)
    shape, expected = tuple(maps().shape), (slots, *bench.mask_size)
    if shape != expected:
        raise ShapeError("mask", str(shape), f"{expected}, (K, mask pixels, mask pixels)")
    return maps


def shutter_plane(
    shutter: str | Tensor | nn.Module, slots: int, size: Size, period: int, seed: int, learnable: bool
) -> CodePlane:
    """K shutter patterns on a sensor (H, W), tiled unless they are given for all of it.

    A named ``"one-hot"`` shutter opens as many pixels of a tile in every slot.
    """
    if isinstance(shutter, CodePlane):
        return shutter.resized(size)
    if isinstance(shutter, nn.Module):
        return shutter  # type: ignore[return-value]
    tile = None if isinstance(shutter, Tensor) and tuple(shutter.shape[1:]) == size else period
    shutter_seed = 2 * seed + 1
    plane = CodePlane(shutter, slots, size, period=tile, seed=shutter_seed, learnable=learnable, name="shutter")
    if isinstance(shutter, str) and shutter == "one-hot":
        check_one_hot(slots, period)
        plane.show(one_hot_planes(balanced_choice(slots, (period, period), shutter_seed), slots))
    return plane


def filter_array(
    filters: str | Tensor | ColourCodedAperture,
    wavelengths: Sequence[float],
    size: Size,
    period: int,
    cells: Tensor | None,
    seed: int,
    learnable: bool,
    *,
    required: bool,
) -> ColourCodedAperture:
    """Filters over the pixels of a sensor (H, W); ``required``: filters must be several where they are learned.

    Raises:
        ShapeError: filters of other bands, cells of another period.
        SettingError: a single filter that should be learned.
    """
    if isinstance(filters, ColourCodedAperture):
        return filters.resized(size)
    passed = feasible_filters(filters, wavelengths) if isinstance(filters, str) else filters
    if passed.shape[-1] != len(wavelengths):
        raise ShapeError("filters", f"{passed.shape[-1]} bands", f"{len(wavelengths)}, those of the camera")
    if cells is not None and tuple(cells.shape) != (period, period):
        raise ShapeError("cells", str(tuple(cells.shape)), f"({period}, {period}), the period")
    if len(passed) == 1 and learnable and required:
        raise SettingError("learnable", "filters, of which there is one", "two filters or more, such as gaussian")
    choice = learnable and len(passed) > 1
    return ColourCodedAperture(passed, size, period, cells=cells, seed=2 * seed, learnable=choice)
