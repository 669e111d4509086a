"""Frames that other software took of an export, as a bench."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data import read_array
from tmca.errors import DataError, SettingError, check_range
from tmca.lab.acquisition.captures import DARK, WHOLE, frames_of
from tmca.lab.display.export import Export
from tmca.lab.display.manifest import exposed_whole
from tmca.lab.frames import coloured, frame_files

_SLOT = re.compile(r"slot[ _-]?(\d+)", re.IGNORECASE)
_REPEAT = re.compile(r"(?:^|[^a-z])r(?:ep(?:eat)?)?[ _-]?(\d+)", re.IGNORECASE)
_NAMES = f"slot_000, slot_001, …, repeats slot_000_r1, …; {WHOLE}, {WHOLE}_r1, … of whole exposures"


def named_frames(files: Sequence[Path], manifest: dict[str, Any], folder: Path) -> dict[str, Path]:
    """Name of a frame, as ``captures.frames_of`` gives it, → its file, of files in the order of the numbers in their
    names. Those that begin with ``dark`` are dark ones, in their order.

    Raises:
        DataError: names that do not say which frame they are, or no whole number of exposures.
    """
    dark = [file for file in files if file.stem.lower().startswith(DARK)]
    light = [file for file in files if file not in dark]
    once = [frame.name for frame in frames_of(manifest) if frame.of != DARK]
    said = any(_SLOT.search(file.stem) or file.stem.lower().startswith(WHOLE) for file in light)
    by_place = _by_number(light, manifest, folder) if said else dict(enumerate(light))
    if not by_place or len(by_place) % len(once):
        expected = f"{len(once)}, or as many again for every repeat"
        raise DataError(folder, f"{len(light)} frames of light", expected, "see docs/devices.md")
    names = [_repeat(name, n) for n in range(len(by_place) // len(once)) for name in once]
    if gone := [name for n, name in enumerate(names) if n not in by_place]:
        raise DataError(folder, f"no frame of {', '.join(gone[:3])}", f"names such as {_NAMES}", "take or rename it")
    darks = {_repeat(DARK, n): file for n, file in enumerate(dark)}
    return darks | {name: by_place[n] for n, name in enumerate(names)}


def _repeat(name: str, number: int) -> str:
    return f"{name}_r{number}" if number else name


def _by_number(light: Sequence[Path], manifest: dict[str, Any], folder: Path) -> dict[int, Path]:
    """Place in the order of the capture → frame. Slots and repeats in the names count from the smallest there is."""
    whole = exposed_whole(manifest)
    numbers: dict[tuple[int, int], Path] = {}
    for file in light:
        slot, repeat = _SLOT.search(file.stem), _REPEAT.search(file.stem)
        if (slot is None) != whole:
            raise DataError(file, f"the name {file.stem}", f"names such as {_NAMES}", "rename it, or move it elsewhere")
        key = int(repeat[1]) if repeat else 0, int(slot[1]) if slot else 0
        if (other := numbers.setdefault(key, file)) is not file:
            found = f"{other.name} and {file.name} of one slot and repeat"
            raise DataError(folder, found, "one file a frame", f"name them {_NAMES}")
    first, start = (min(key[axis] for key in numbers) for axis in (0, 1))
    each, last = 1 if whole else int(manifest["slots"]), max(slot for _, slot in numbers)
    if last - start >= each:
        raise DataError(folder, f"frames of slots {start} to {last}", f"{each} slots of the export")
    return {(repeat - first) * each + slot - start: file for (repeat, slot), file in numbers.items()}


class FrameFolder:
    """A folder of frames; a driver of the package, ``tmca capture EXPORT --device folder --set path=FOLDER``.

    Files that begin with ``dark`` are dark frames. The others say slot and repeat in their names (``slot_000``,
    ``slot_000_r1``, ``slot0_rep1``, …; ``exposure_r1`` of whole exposures); or none does, and they are taken in the
    order of the numbers in their names: one a slot, or one exposure of all, again for every repeat.

    Args:
        path: of the folder: PNG, TIFF, BMP or NPY, whole numbers; colours become channels, and so do pages of a TIFF or
            the first axis of an NPY: the buckets of a sensor with several.
        saturation: digital number from which on a pixel is saturated; the largest that the files can hold without.
        snapshot_units_per_dn: see ``Device``.

    Raises:
        DataError: no frames, or two files of one name.
        SettingError: numbers that are not above 0, or a saturation that dark frames reach.
    """

    def __init__(
        self, path: str, saturation: str | float | None = None, snapshot_units_per_dn: str | float | None = None
    ) -> None:
        self.path = Path(path)
        self.there = frame_files(self.path)
        self.files = {file.stem: file for file in self.there}
        if twice := [file.name for file in self.there if self.files[file.stem] is not file]:
            raise DataError(path, f"two files of the name of {twice[0]}", "one file a frame", "move one elsewhere")
        self.saturation = _largest(self.there[0]) if saturation is None else self._above_dark(saturation)
        if snapshot_units_per_dn is not None:
            self.snapshot_units_per_dn = _setting("snapshot_units_per_dn", snapshot_units_per_dn)
        self.name = DARK

    def _above_dark(self, saturation: str | float) -> float:
        """The level that is asked for; SettingError for one that dark frames reach."""
        level = _setting("saturation", saturation)
        dark = next((file for file in self.there if file.stem.lower().startswith(DARK)), None)
        if dark is not None:
            black = float(np.median(read_array(dark)))
            remedy = "saturation is the digital number of a full pixel"
            check_range("--set saturation", level, above=black, remedy=f"{dark.name} has {black:g}; {remedy}")
        return level

    def load(self, export: Export) -> None:
        """Find the frame of every step.

        Raises:
            DataError: frames of no whole number of exposures, or that do not say which they are.
        """
        self.files = named_frames(self.there, export.manifest, self.path)
        once = [step.name for step in frames_of(export.manifest)]
        if missing := [name for name in once if name not in self.files]:
            expected = f"{len(once)} frames, dark ones among them"
            raise DataError(self.path, f"no frame {', '.join(missing[:3])}", expected, "take what is missing")

    def files_of_frames(self, names: Sequence[str]) -> dict[str, Path]:
        """See ``Recorded``."""
        light = {name for name in self.files if not name.startswith(DARK)}
        wanted = {name for name in names if not name.startswith(DARK)}
        if light != wanted:
            remedy = "pass the --repeat that takes them all, or take what is missing"
            raise DataError(self.path, f"{len(light)} frames of light", f"the {len(wanted)} that are asked for", remedy)
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
        frame = read_array(self.files[self.name])
        return np.moveaxis(frame[..., :3], -1, 0) if coloured(frame) else frame


def _largest(file: Path) -> float:
    kind = read_array(file).dtype
    if kind.kind not in "ui":
        raise DataError(file, f"{kind} values", "whole numbers of a sensor", "save frames as 8 or 16 bits")
    return float(np.iinfo(kind).max)


def _setting(name: str, text: str | float) -> float:
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not 0 < number < inf:
        raise SettingError(f"--set {name}", repr(text), "a number above 0")
    return number
