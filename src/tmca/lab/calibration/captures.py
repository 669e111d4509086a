"""Captures for calibration: read, known by name, corrected for the sensor; the patterns that are shown."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tmca.data import atomic_path
from tmca.errors import DataError, SettingError
from tmca.lab.acquisition.captures import read_captures as captures_of_bench
from tmca.lab.frames import Array, Frames, check_saturation, check_size, read_frames, write_frames
from tmca.lab.notes import CAPTURES

_SATURATED = 0.01


def calibration_patterns(size: tuple[int, int], count: int = 2, seed: int = 0) -> Array:
    """(2 + count, h, w): all open, all dark, then random blocks of 4, 2, 4, 2, … pixels, half of them open.

    Blocks are large enough to be seen after a rotation or blur, and no two places, turns or flips of them are alike.

    Args:
        size: (h, w) of the mask, pixels.
        count: of random patterns.
        seed: of them.

    Raises:
        SettingError: a mask below 16 pixels, or no random pattern.
    """
    if min(size) < 16 or count < 1:
        raise SettingError("patterns", f"{count} of {size[0]}×{size[1]} pixels", "1 or more of 16×16 pixels or more")
    rng = np.random.default_rng(seed)
    planes: list[Array] = [np.ones(size), np.zeros(size)]
    for index in range(count):
        side = 4 if index % 2 == 0 else 2
        blocks = rng.integers(2, size=tuple(-(-n // side) for n in size)).astype(np.float64)
        shown = np.kron(blocks, np.ones((side, side)))[: size[0], : size[1]]
        planes.append(np.asarray(shown, dtype=np.float64))
    return np.stack(planes)


def write_patterns(
    folder: str | Path, size: tuple[int, int], count: int = 2, seed: int = 0, *, overwrite: bool = False
) -> list[str]:
    """Write ``pattern_0.png`` … into a folder, white where the mask is open, and give back their names.

    Raises:
        SettingError: see ``calibration_patterns``.
        OutputError: see `tmca.data.atomic_path`.
    """
    planes = (255 * calibration_patterns(size, count, seed)).astype(np.uint8)
    with atomic_path(folder, overwrite=overwrite) as place:
        write_frames(place, {f"pattern_{index}": plane for index, plane in enumerate(planes)})
    return [f"pattern_{index}.png" for index in range(len(planes))]


def read_patterns(path: str | Path, device: Sequence[int] | None = None) -> Array:
    """(P, h, w) patterns that were shown, zeros and ones, from a folder of pictures or a stack.

    Raises:
        DataError: grey patterns, or a size that is not the device's.
    """
    values = read_frames(path).values
    top = float(values.max())
    if not top > 0 or not np.isin(values, (0, top)).all():
        raise DataError(path, "grey patterns", "pictures of two levels: dark and open", "save them without smoothing")
    if device is not None:
        check_size(path, "patterns", values.shape[1:], device, "name what the device showed")
    return np.asarray(values, dtype=np.float64) / top


def read_captures(
    path: str | Path,
    *,
    saturation: float | None = None,
    may_saturate: bool = False,
    sensor: Sequence[int] | None = None,
) -> Frames:
    """Frames of a folder or stack; those that a bench took have to be as it kept them.

    Args:
        path: see `tmca.lab.frames.read_frames`.
        saturation: see there; that of the bench that took them where it was kept.
        may_saturate: whether saturated frames are wanted.
        sensor: (H, W) they have to have, or (R, H, W).

    Raises:
        DataError: no frames, another size, frames that are missing or changed, or one more than a hundredth of which is
            saturated.
    """
    top = taken_with(path).get("saturation") if saturation is None else saturation
    frames = read_frames(path, top, buckets=True)
    if sensor is not None:
        check_size(path, "frames", frames.values.shape[1:], sensor, "use the sensor that was calibrated before")
    if not may_saturate:
        check_saturation(frames, _SATURATED)
    return frames


def taken_with(path: str | Path) -> dict[str, Any]:
    """What the bench kept with the frames of a folder; nothing of other frames."""
    return dict(captures_of_bench(path)["taken_with"]) if (Path(path) / CAPTURES).is_file() else {}


def whole_exposures(path: str | Path) -> bool | None:
    """Whether a bench took frames of even light as whole exposures, in which the sensor codes its shutter, and not slot
    by slot; None of frames that no bench took."""
    if not (Path(path) / CAPTURES).is_file():
        return None
    return any(frame.get("slot") is None for frame in captures_of_bench(path)["frames"].values())


def averaged(values: ArrayLike, keys: Sequence[tuple[float, ...]]) -> tuple[Array, list[tuple[float, ...]]]:
    """Mean of the frames of every key, and the keys in ascending order."""
    distinct, index = np.unique(np.array(keys), axis=0, return_inverse=True)
    frames = np.asarray(values, dtype=np.float64)
    means = np.stack([frames[index.ravel() == k].mean(axis=0) for k in range(len(distinct))])
    return means, [tuple(key) for key in distinct.tolist()]
