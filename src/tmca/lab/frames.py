"""Frames of a camera from files: a folder of pictures in the order of their names, or one stack."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data import read_array
from tmca.errors import DataError, check_range

Array = NDArray[np.float64]
SUFFIXES = (".png", ".tif", ".tiff", ".npy", ".bmp")


@dataclass(frozen=True)
class Frames:
    """Grey frames in digital numbers.

    ``values`` is ``(N, H, W)`` float32, of several buckets ``(N, R, H, W)``, ``saturated`` likewise, ``names`` say
    which frame is which (the file's name without its suffix, or the number in a stack), ``step`` is one digital number
    (0 of floats), ``top`` the value from which on a pixel is saturated, ``kind`` the type of the file's numbers.
    """

    source: Path
    names: tuple[str, ...]
    values: NDArray[np.float32]
    saturated: NDArray[np.bool_]
    step: float = 1.0
    top: float = np.inf
    kind: str = ""


def read_frames(path: str | Path, saturation: float | None = None, *, buckets: bool = False) -> Frames:
    """Read a folder of PNG, TIFF, BMP or NPY frames, or one such file with ``(N, H, W)`` or ``(H, W)``.

    Files count in the order of the numbers in their names. Colour frames become grey by the mean of their channels, and
    are saturated where one channel is.

    Args:
        path: the folder or the stack.
        saturation: the value from which on a pixel is saturated; an integer type's maximum without it, and 1 for
            floats that stay below or at 1. Larger floats have none.
        buckets: whether a file of a folder may hold those of a pixel, ``(R, H, W)``.

    Raises:
        DataError: no frames, a broken file, or frames of different size or type.
        SettingError: a saturation that is not a number above 0.
    """
    path = Path(path)
    if saturation is not None:
        check_range("saturation", saturation, above=0)
    if path.is_dir():
        files = frame_files(path)
        names, arrays = tuple(f.stem for f in files), [_grey_axes(read_array(f), f, buckets) for f in files]
    elif path.is_file():
        names, arrays = _of_stack(path)
    else:
        raise DataError(path, "no such file or folder", "a folder of frames or a stack", "check the path")
    _same(path, names, arrays)
    return _frames(path, names, np.stack(arrays), saturation)


def write_frames(folder: Path, frames: Mapping[str, NDArray[Any]]) -> None:
    """Write ``NAME.png`` of 8 or 16 bits into a new folder."""
    from PIL import Image

    folder.mkdir()
    for name, frame in frames.items():
        Image.fromarray(np.ascontiguousarray(frame)).save(folder / f"{name}.png")


def check_size(where: object, what: str, found: Sequence[int], wanted: Sequence[int], remedy: str = "") -> None:
    """Raises DataError unless two sizes (rows, columns, …) are one."""
    if tuple(found) != tuple(wanted):
        one, other = ("×".join(map(str, size)) for size in (found, wanted))
        raise DataError(where, f"{what} of {one} pixels", f"{other} pixels", remedy)


def check_saturation(frames: Frames, most: float) -> None:
    """Raises DataError for a frame of which more than this share is saturated."""
    share = frames.saturated.reshape(len(frames.names), -1).mean(axis=1)
    if share.max() > most:
        found = f"{share.max():.0%} of the pixels saturated in {frames.names[int(share.argmax())]}"
        raise DataError(frames.source, found, f"{most:.0%} at most", "expose for less time")


def named(frames: Frames, pattern: re.Pattern[str], example: str) -> list[tuple[float, ...]]:
    """The numbers in every frame's name.

    Raises:
        DataError: a name without them.
    """
    matches = [pattern.search(name) for name in frames.names]
    if None in matches:
        name = frames.names[matches.index(None)]
        raise DataError(frames.source, f"a frame named {name}", f"names such as {example}", "rename the frames")
    return [tuple(float(part) for part in match.groups()) for match in matches if match]


def frame_files(folder: Path) -> list[Path]:
    """Files of frames in the order of the numbers in their names.

    Raises:
        DataError: no folder, or none in it.
    """
    if not folder.is_dir():
        raise DataError(folder, "no such folder", "a folder of frames", "check the path")
    files = sorted((f for f in folder.iterdir() if f.suffix.lower() in SUFFIXES), key=lambda f: counted(f.name))
    if not files:
        raise DataError(folder, "a folder without frames", f"files {', '.join('*' + s for s in SUFFIXES)}")
    return files


def coloured(frame: NDArray[Any]) -> bool:
    """Whether a frame has colours on its last axis."""
    return frame.ndim == 3 and frame.shape[-1] in (1, 2, 3, 4)


def _of_stack(file: Path) -> tuple[tuple[str, ...], list[NDArray[Any]]]:
    if file.suffix.lower() not in SUFFIXES:
        raise DataError(file, f"the suffix {file.suffix!r}", ", ".join(SUFFIXES), "save the stack as one of them")
    stack = read_array(file)
    if stack.ndim == 2:
        return (file.stem,), [stack]
    if stack.ndim != 3:
        raise DataError(file, f"an array of shape {stack.shape}", "frames (N, H, W)")
    return tuple(map(str, range(len(stack)))), list(stack)


def counted(name: str) -> list[tuple[int, str]]:
    """Sorting key by which frame 9 comes before frame 10."""
    return [(int(part), "") if part.isdigit() else (-1, part.lower()) for part in re.split(r"(\d+)", name)]


def _grey_axes(frame: NDArray[Any], file: Path, buckets: bool) -> NDArray[Any]:
    if frame.ndim != 2 and not coloured(frame) and not (buckets and frame.ndim == 3):
        raise DataError(file, f"an array of shape {frame.shape}", "one frame (H, W), in grey or colour")
    return frame


def _same(path: Path, names: tuple[str, ...], arrays: list[NDArray[Any]]) -> None:
    first = arrays[0]
    for name, array in zip(names, arrays, strict=True):
        if array.shape != first.shape or array.dtype != first.dtype:
            found = f"frame {name} of {_said(array)}"
            raise DataError(path, found, f"{_said(first)} as in {names[0]}", "capture it again with the same settings")
        if array.dtype.kind not in "uif" or not array.size:
            raise DataError(path, f"frame {name} of {_said(array)}", "digital numbers")
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise DataError(path, f"frame {name} with values that are not finite", "digital numbers", "write it again")


def _said(array: NDArray[Any]) -> str:
    return f"{'×'.join(map(str, array.shape))} pixels ({array.dtype})"


def _frames(path: Path, names: tuple[str, ...], raw: NDArray[Any], saturation: float | None) -> Frames:
    colours = raw[..., : 1 if raw.shape[-1] == 2 else 3] if coloured(raw[0]) else raw[..., None]
    top = saturation if saturation is not None else _full_scale(raw)
    values = colours.mean(axis=-1, dtype=np.float64).astype(np.float32)
    saturated = np.asarray((colours >= top).any(axis=-1))
    kind = "float" if raw.dtype.kind == "f" else raw.dtype.name
    return Frames(path, names, values, saturated, 0.0 if kind == "float" else 1.0, top, kind)


def _full_scale(raw: NDArray[Any]) -> float:
    if raw.dtype.kind in "ui":
        return float(np.iinfo(raw.dtype).max)
    return 1.0 if float(raw.max()) <= 1 else np.inf
