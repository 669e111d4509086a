"""Truth and figures of merit of scenes that move within the exposure, frame by frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from tmca.arguments import described
from tmca.cameras import moving_object, moving_scene
from tmca.errors import DataError, check_range

if TYPE_CHECKING:
    import xarray as xr

    from tmca.data.formats.stored import Contents

MOTION = "motion_pixels"
"""Note of a snapshot: rows and columns by which its scene moved within the exposure."""
FRAMES = "slot"
"""Axis of the frames of an estimate."""
_FARTHEST = 1e6


def frames_of(scene: Any, displacement: tuple[float, float], frames: int, *, whole: bool = True) -> list[xr.DataArray]:
    """A labelled scene in every one of some frames of equal length, the mean of what passes during it.

    Args:
        scene: rows and columns last.
        displacement: rows and columns from the beginning to the end of the exposure, pixels.
        frames: how many.
        whole: whether all of it moves; else the disc in its middle, before the rest.
    """
    check_range("frames", frames, 1, 10_000, whole=True)
    values = torch.from_numpy(np.array(scene.values))
    move = moving_scene if whole else moving_object
    moved = move(values.flatten(0, -3), displacement, frames).unflatten(1, values.shape[:-2])
    return [scene.copy(data=one.numpy()) for one in moved]


def frame_pairs(
    estimate: xr.Dataset, truth: Any, displacement: tuple[float, float], frames: int, *, whole: bool = True
) -> Iterator[tuple[xr.Dataset, xr.DataArray]]:
    """An estimate, that of the time if it has frames, and the truth in every one of some frames; see `frames_of`."""
    own = estimate.sizes.get(FRAMES)
    for number, true in enumerate(frames_of(truth, displacement, frames, whole=whole)):
        yield estimate if own is None else estimate.isel({FRAMES: number * own // frames}), true


def in_frames(contents: Contents) -> bool:
    """Whether an open file has an estimate in frames."""
    estimate = contents.arrays.get("estimate")
    return estimate is not None and FRAMES in estimate.dims


def refuse_frames(path: str | Path, dims: Sequence[str]) -> None:
    """Raises DataError where the estimate of a file is one in frames, by its axes, and a still one is wanted."""
    if FRAMES in dims:
        remedy = f"keep one of them: xarray.open_dataset(…).isel({FRAMES}=0).to_netcdf(…)"
        raise DataError(path, "an estimate in frames", "one frame", remedy)


def check_axes(stored: xr.Dataset, path: str, *axes: str) -> None:
    """Raises DataError for an estimate in frames that runs over others than these axes in each of them."""
    there = stored["estimate"].dims
    if {*there} != {FRAMES, *axes}:
        found = f"an estimate by {', '.join(map(str, there))}"
        raise DataError(path, found, f"one by {', '.join((FRAMES, *axes))}", "write it again")


def moved_by(notes: Mapping[str, Any], where: str = "notes") -> tuple[float, float]:
    """Rows and columns by which the scene of a snapshot moved, as its notes say; none where they do not.

    Args:
        notes: of a snapshot or an estimate.
        where: their file, for the message.

    Raises:
        DataError: a damaged note.
    """
    noted = notes.get(MOTION, (0.0, 0.0))
    try:
        down, across = (float(part) for part in noted)
    except (TypeError, ValueError):
        down = across = inf
    if not (abs(down) < _FARTHEST and abs(across) < _FARTHEST):
        raise DataError(where, f"{MOTION} {described(noted)}", "rows and columns, pixels", "correct the attribute")
    return down, across


def mean_of(metrics: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Figures of merit of frames, averaged."""
    return {name: float(np.mean([one[name] for one in metrics])) for name in metrics[0]}
