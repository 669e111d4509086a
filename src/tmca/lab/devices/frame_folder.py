"""Frames that other software took of an export, as a bench."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tmca.data import read_array
from tmca.errors import DataError, SettingError
from tmca.lab.devices.captures import DARK, steps
from tmca.lab.devices.export import Export
from tmca.lab.devices.frame_names import named_frames
from tmca.lab.frames import frame_files


class FrameFolder:
    """A folder of frames; a driver of the package, ``tmca capture EXPORT --device folder --set path=FOLDER``.

    Files that begin with ``dark`` are dark frames. The others say slot and repeat in their names (``slot_000``,
    ``slot_000_r1``, ``slot0_rep1``, …; ``exposure_r1`` of whole exposures); or none does, and they are taken in the
    order of the numbers in their names: one a slot, or one exposure of all, again for every repeat.

    Args:
        path: of the folder: PNG, TIFF, BMP or NPY, whole numbers; colours become channels.
        saturation: digital number from which on a pixel is saturated; the largest that the files can hold without.
        snapshot_units_per_dn: see ``Device``.

    Raises:
        DataError: no frames, or two files of one name.
        SettingError: numbers that are none above 0.
    """

    def __init__(
        self, path: str, saturation: str | float | None = None, snapshot_units_per_dn: str | float | None = None
    ) -> None:
        self.path = Path(path)
        self.there = frame_files(self.path)
        _check_names(self.there, self.path)
        self.saturation = _largest(self.there[0]) if saturation is None else _number("saturation", saturation)
        if snapshot_units_per_dn is not None:
            self.snapshot_units_per_dn = _number("snapshot_units_per_dn", snapshot_units_per_dn)
        self.name, self.files = DARK, {file.stem: file for file in self.there}

    def load(self, export: Export) -> None:
        """Find the frame of every step.

        Raises:
            DataError: frames of no whole number of exposures, or that do not say which they are.
        """
        self.files, once = named_frames(self.there, export.manifest, self.path), steps(export.manifest)
        if missing := [step.name for step in once if step.name not in self.files]:
            darks = sum(step.of == DARK for step in once)
            expected = f"{len(once) - darks} frames of light and {darks} dark ones, or more of both"
            raise DataError(self.path, f"no frame {', '.join(missing[:3])}", expected, "take what is missing")

    def files_of_frames(self, names: Sequence[str]) -> dict[str, Path]:
        """See ``Recorded``."""
        if missing := [name for name in names if name not in self.files]:
            found = f"no frame {', '.join(missing[:3])}"
            raise DataError(self.path, found, "one for every repeat", "pass --repeat less, or take it")
        light = [name for name in self.files if not name.startswith(DARK)]
        used = [name for name in light if name in names]
        if len(used) < len(light):
            many = len(light) // (len(used) // _repeats(used))
            expected = f"the {len(used)} that are asked for"
            raise DataError(self.path, f"{len(light)} frames of light", expected, f"pass --repeat {many}")
        return dict(self.files)

    def name_frame(self, name: str) -> None:
        """See ``Named``."""
        self.name = name

    def show(self, slot: int | None) -> None:
        """See ``Device``; what was shown is in the frames."""

    def capture(self, whole: bool = False) -> NDArray[np.integer]:
        """See ``Device``.

        Raises:
            DataError: a broken file.
        """
        found = read_array(self.files[self.name])
        return found if found.ndim != 3 else np.moveaxis(found[..., :3], -1, 0)


def _repeats(names: Sequence[str]) -> int:
    return 1 + max(int(name.partition("_r")[2] or 0) for name in names)


def _check_names(files: Sequence[Path], folder: Path) -> None:
    """Raises DataError where two files have one name, so that nobody knows which is the frame."""
    known: dict[str, Path] = {}
    for file in files:
        if (other := known.setdefault(file.stem, file)) is not file:
            raise DataError(
                folder, f"{other.name} beside {file.name}", "one file a frame", "move one of them elsewhere"
            )


def _largest(file: Path) -> float:
    kind = read_array(file).dtype
    if kind.kind not in "ui":
        raise DataError(file, f"{kind} values", "whole numbers of a sensor", "save frames as 8 or 16 bits")
    return float(np.iinfo(kind).max)


def _number(name: str, text: str | float) -> float:
    try:
        found = float(text)
    except ValueError:
        found = 0.0
    if not 0 < found < inf:
        raise SettingError(f"--set {name}", repr(text), "a number above 0")
    return found
