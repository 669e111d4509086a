"""Which file of a folder is which frame of an export: by slot and repeat in their names, or by their order."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tmca.errors import DataError
from tmca.lab.devices.captures import DARK, WHOLE, steps
from tmca.lab.devices.manifest import exposed_whole
from tmca.lab.frames import counted

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
    each = sum(step.of != DARK for step in steps(manifest))
    if not light or len(light) % each:
        found = f"{len(light)} frames whose names do not begin with {DARK}"
        raise DataError(folder, found, f"{each}, or as many again for every repeat", "see docs/devices.md")
    repeats = len(light) // each
    if repeats > 1 and each > 1 and _is_grid(light):
        found = f"names with two counts, such as {light[0].stem} and {light[-1].stem}"
        raise DataError(folder, found, "names that say which is the slot", f"rename them: {_EXAMPLES}")
    names = [step.name for step in steps(manifest, repeats) if step.of != DARK]
    return dict(zip(names, light, strict=True))


def _is_grid(files: Sequence[Path]) -> bool:
    """Whether names count along two axes, so that their order does not say which of them are the slots."""
    keys = [[number for number, _ in counted(file.stem) if number >= 0] for file in files]
    if len({len(key) for key in keys}) != 1:
        return False
    varying = [column for column in map(set, zip(*keys, strict=True)) if len(column) > 1]
    return len(varying) == 2 and len(varying[0]) * len(varying[1]) == len(files)
