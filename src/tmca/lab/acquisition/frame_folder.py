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
from tmca.errors import DataError, SettingError
from tmca.lab.acquisition.captures import DARK, WHOLE, frames_of
from tmca.lab.display.export import Export
from tmca.lab.display.manifest import exposed_whole
from tmca.lab.frames import counted, frame_files

_SLOT = re.compile(r"slot[ _-]?(\d+)", re.IGNORECASE)
_REPEAT = re.compile(r"(?:^|[^a-z])r(?:ep(?:eat)?)?[ _-]?(\d+)", re.IGNORECASE)
_NAMED = re.compile(rf"{_SLOT.pattern}|(?:^|[^a-z])rep(?:eat)?[ _-]?\d|^{WHOLE}(?:_r\d+)?$", re.IGNORECASE)
"""Names that say which frame they are."""
_EXAMPLES = "names such as slot_000, slot_001, …, repeats slot_000_r1, …"
_OF_WHOLE = f"{WHOLE}, {WHOLE}_r1, …"
Number = tuple[int, int]
"""Slot, 0 of a whole exposure, and repeat."""


def named_frames(files: Sequence[Path], manifest: dict[str, Any], folder: Path) -> dict[str, Path]:
    """Name of a frame, as ``captures.steps`` gives it, → its file.

    Args:
        files: in the order of the numbers in their names. Those that begin with ``dark`` are dark ones, in their order.
        manifest: of the export.
        folder: that errors name.

    Raises:
        DataError: names that do not say which frame they are, or frames that are missing.
    """
    dark = [file for file in files if file.stem.lower().startswith(DARK)]
    light = [file for file in files if file not in dark]
    whole = exposed_whole(manifest)
    if any(_NAMED.search(file.stem) for file in light):
        found = _by_number(light, None if whole else manifest["slots"], folder)
    else:
        found = _in_order(light, manifest, folder)
    return {**{DARK + (f"_r{n}" if n else ""): file for n, file in enumerate(dark)}, **found}


def _by_number(light: Sequence[Path], slots: int | None, folder: Path) -> dict[str, Path]:
    """Frames whose names say slot and repeat, both counted from 0 or both from 1; a repeat that is the same in all of
    them is none."""
    numbers: dict[Number, Path] = {}
    for file in light:
        other = numbers.setdefault(_number(file, slots), file)
        if other is not file:
            found, remedy = f"{other.name} and {file.name} of one slot and repeat", f"rename them: {_examples(slots)}"
            raise DataError(folder, found, "one file a frame", remedy)
    last, counts = max(slot for slot, _ in numbers), {repeat for _, repeat in numbers}
    first = 1 if slots and last == slots and min(numbers)[0] == 1 else 0
    if last - first >= (slots or 1):
        raise DataError(folder, f"frames of slot {last}", f"{slots} slots of the export, from 0 or from 1")
    start = min(counts) if len(counts) == 1 else min(*counts, 1)
    wanted = {
        (k + first, r): _name(k, r - start, slots) for r in range(start, max(counts) + 1) for k in range(slots or 1)
    }
    if missing := [number for number in wanted if number not in numbers]:
        found = _said_missing(missing, numbers, first, slots)
        raise DataError(folder, found, "one of every slot and repeat", "take it")
    return {name: numbers[number] for number, name in wanted.items()}


def _said_missing(missing: Sequence[Number], numbers: dict[Number, Path], first: int, slots: int | None) -> str:
    """Frames that are not there, as the names of the others count."""
    repeated = len({repeat for _, repeat in numbers}) > 1
    each = [
        ", ".join([f"slot {slot}"] * (slots is not None) + [f"repeat {repeat}"] * repeated) for slot, repeat in missing
    ]
    example = min(numbers)
    counted_as = f"from {first} as in" if slots is None or example[0] == first else f"from {first}, beside"
    return f"no frame of {'; '.join(each[:3])}, counted {counted_as} {numbers[example].name}"


def _examples(slots: int | None) -> str:
    return _EXAMPLES if slots is not None else f"names such as {_OF_WHOLE}"


def _number(file: Path, slots: int | None) -> Number:
    slot, repeat = _SLOT.search(file.stem), _REPEAT.search(file.stem)
    if (slot is None) == (slots is not None):
        expected = _EXAMPLES if slots is not None else f"{_OF_WHOLE}: the shutter is coded in one exposure"
        raise DataError(file, f"the name {file.stem}", expected, "rename the frames, or move what is none elsewhere")
    return int(slot[1]) if slot else 0, int(repeat[1]) if repeat else 0


def _name(slot: int, repeat: int, slots: int | None) -> str:
    return (WHOLE if slots is None else f"slot_{slot:03d}") + (f"_r{repeat}" if repeat else "")


def _in_order(light: Sequence[Path], manifest: dict[str, Any], folder: Path) -> dict[str, Path]:
    """Frames of every slot, again for every repeat."""
    each = sum(step.of != DARK for step in frames_of(manifest))
    if not light or len(light) % each:
        found = f"{len(light)} frames whose names do not begin with {DARK}"
        raise DataError(folder, found, f"{each}, or as many again for every repeat", "see docs/devices.md")
    repeats = len(light) // each
    if repeats > 1 and each > 1 and _is_grid(light):
        found = f"names with two counts, such as {light[0].stem} and {light[-1].stem}"
        raise DataError(folder, found, "names that say which is the slot", f"rename them: {_EXAMPLES}")
    names = [step.name for step in frames_of(manifest, repeats) if step.of != DARK]
    return dict(zip(names, light, strict=True))


def _is_grid(files: Sequence[Path]) -> bool:
    """Whether names count along two axes, so that their order does not say which of them are the slots."""
    keys = [[number for number, _ in counted(file.stem) if number >= 0] for file in files]
    if len({len(key) for key in keys}) != 1:
        return False
    varying = [column for column in map(set, zip(*keys, strict=True)) if len(column) > 1]
    return len(varying) == 2 and len(varying[0]) * len(varying[1]) == len(files)


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
        self.saturation = _largest(self.there[0]) if saturation is None else _setting("saturation", saturation)
        if snapshot_units_per_dn is not None:
            self.snapshot_units_per_dn = _setting("snapshot_units_per_dn", snapshot_units_per_dn)
        self.name, self.files = DARK, {file.stem: file for file in self.there}

    def load(self, export: Export) -> None:
        """Find the frame of every step.

        Raises:
            DataError: frames of no whole number of exposures, or that do not say which they are.
        """
        self.files, once = named_frames(self.there, export.manifest, self.path), frames_of(export.manifest)
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


def _setting(name: str, text: str | float) -> float:
    try:
        found = float(text)
    except ValueError:
        found = 0.0
    if not 0 < found < inf:
        raise SettingError(f"--set {name}", repr(text), "a number above 0")
    return found
