"""The folder of a capture: frames in digital numbers, and a list of them with their checksums."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.errors import DataError, OutputError
from tmca.lab.codes_date import CAPTURES
from tmca.lab.devices.manifest import NAME, checksum, exposed_whole, read_manifest, shown_digest

DARK, WHOLE = "dark", "exposure"
EXPORT, SHOWN = "export_sha256", "shown_sha256"
"""Of the manifest that was captured, and of what it shows, whenever it was written."""
_AGAIN = "delete this one file and run again what captured it: it alone is taken again"
_DARKS = 4
"""Least number of dark frames: their mean is taken from every other frame, and their spread is the read noise."""

_UNDONE = re.compile(r"\..+\.[0-9a-f]{12}\.tmp\.(json|tif)")
"""Names of files that were not written to their end."""


@dataclass(frozen=True)
class Step:
    """One frame of a capture.

    Args:
        name: of its file.
        slot: that is shown; None for dark, and for a whole exposure.
        of: the frame that it repeats; its own name for the first.
    """

    name: str
    slot: int | None
    of: str


def steps(manifest: dict[str, Any], repeats: int = 1) -> list[Step]:
    """Frames of an export: a dark one, then one a slot, or one exposure of a sensor whose shutter is coded; again for
    every repeat. As many dark ones follow as there are slots, for what they leave is taken from every slot alike."""
    slots = {f"slot_{k:03d}": k for k in range(manifest["slots"])}
    once: dict[str, int | None] = {DARK: None, **({WHOLE: None} if exposed_whole(manifest) else slots)}
    ends = ["", *(f"_r{n}" for n in range(1, repeats))]
    found = [Step(name + end, slot, name) for end in ends for name, slot in once.items()]
    darks = max(_DARKS, 0 if exposed_whole(manifest) else manifest["slots"])
    return found + [Step(f"{DARK}_r{n}", None, DARK) for n in range(repeats, darks)]


def kept_so_far(folder: Path, export: str | Path) -> dict[str, Any]:
    """What a folder holds of this export's capture; a new list where there is none. Frames whose file is gone are to be
    taken again.

    Raises:
        OutputError: the folder holds something else, or frames of another export.
        DataError: no export, or what ``read_captures`` raises.
    """
    if not (folder / CAPTURES).exists():
        if folder.exists() and (folder.is_file() or any(not _UNDONE.fullmatch(file.name) for file in folder.iterdir())):
            raise OutputError(folder, "something that is no capture", "a new folder", "choose another")
        of = {EXPORT: checksum(Path(export) / NAME), SHOWN: shown_digest(read_manifest(export))}
        return {"export": str(export), **of, "taken_with": {}, "frames": {}}
    kept = read_captures(folder, whole=False)
    if not is_of(kept, export):
        raise OutputError(folder, f"a capture of {kept['export']}", "one of this export", "choose another folder")
    return kept


def is_of(kept: dict[str, Any], export: str | Path) -> bool:
    """Whether a capture is of this export, or of one that shows the same; lists of before know the manifest alone.

    Raises:
        DataError: no export.
    """
    manifest = read_manifest(export)
    return kept[EXPORT] == checksum(Path(export) / NAME) or kept.get(SHOWN) == shown_digest(manifest)


def going_on(kept: dict[str, Any], how: dict[str, Any], folder: Path) -> dict[str, Any]:
    """A list of frames with what they were taken with; frames that were taken otherwise are never joined with others.

    Raises:
        OutputError: the folder holds frames of another bench.
    """
    before = kept["taken_with"] if kept["frames"] else how
    for name in sorted(before.keys() | how.keys()):
        if before.get(name) != how.get(name):
            found = f"frames of {name} {before.get(name)}"
            raise OutputError(folder, found, f"{name} {how.get(name)}", "choose another folder, or delete this one")
    return {**kept, "taken_with": how}


def keep(
    frame: NDArray[np.integer], step: Step, kept: dict[str, Any], folder: Path, about: Mapping[str, Any] | None = None
) -> None:
    """Write a frame (H, W), or (C, H, W), as 16-bit TIFF, and the list with it, what is known about it included.

    The list is there before the first frame, so that whatever ends the process leaves a capture that goes on; what was
    left half-written is swept away.
    """
    import tifffile

    from tmca.data import make_folder, write_json
    from tmca.data.write import atomic_path

    file = make_folder(folder) / f"{step.name}.tif"
    for left in [one for one in folder.iterdir() if _UNDONE.fullmatch(one.name)]:
        left.unlink(missing_ok=True)
    if not (folder / CAPTURES).exists():
        write_json(kept, folder / CAPTURES)
    with atomic_path(file, overwrite=True) as temporary:
        tifffile.imwrite(temporary, frame.astype(np.uint16), photometric="minisblack")
    taken = {"sha256": checksum(file), "taken": datetime.now(UTC).isoformat(timespec="seconds")}
    kept["frames"][step.name] = {"slot": step.slot, "of": step.of, **taken, **(about or {})}
    write_json(kept, folder / CAPTURES, overwrite=True)


def read_captures(folder: str | Path, whole: bool = True) -> dict[str, Any]:
    """What was captured, every frame as it was written.

    Args:
        folder: of the capture.
        whole: refuse frames whose file is missing, instead of leaving them out.

    Raises:
        DataError: no capture, or a frame that is missing, changed, or in another's place.
    """
    file = Path(folder) / CAPTURES
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
        there = {name: a for name, a in found["frames"].items() if whole or (Path(folder) / f"{name}.tif").exists()}
        frames = {name: (about["sha256"], about["of"]) for name, about in there.items()}
        found["export"], found[EXPORT], found["taken_with"]["gain"], found["taken_with"]["saturation"]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise DataError(file, "no list of captures", "what `tmca capture` wrote", "capture it again") from None
    for name, (known, _) in frames.items():
        _check_kept(Path(folder) / f"{name}.tif", known, frames)
    return {**found, "frames": there}


def _check_kept(frame: Path, known: str, frames: dict[str, tuple[str, str]]) -> None:
    if not frame.is_file():
        remedy = "run again what captured it, which takes it again"
        raise DataError(frame, "no such file", f"the frame {frame.stem}", remedy)
    there = checksum(frame)
    if there != known:
        other = [name for name, (value, _) in frames.items() if value == there]
        what = f"that of {other[0]}: frames in the wrong order" if other else "another content"
        raise DataError(frame, what, "what was captured", _AGAIN)


def read_tif(file: Path) -> NDArray[np.integer]:
    """A frame as it was kept.

    Raises:
        DataError: no picture.
    """
    import tifffile

    try:
        return np.asarray(tifffile.imread(file))
    except (OSError, ValueError, tifffile.TiffFileError):
        raise DataError(file, "no TIFF", "a frame of the capture", _AGAIN) from None
