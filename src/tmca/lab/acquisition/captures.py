"""The folder of a capture: frames in digital numbers, and a list of them with their checksums."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.attributes import Attributes, Beside, OpenAttributes, read_json
from tmca.data import atomic_path, checksum_of, held_folder, make_folder, tiff_bytes, write_json
from tmca.data.atomic import sweep
from tmca.errors import DataError, OutputError
from tmca.lab.display.manifest import NAME, exposed_whole, read_manifest, shown_digest
from tmca.lab.notes import CAPTURES

DARK, WHOLE = "dark", "exposure"
EXPORT, SHOWN = "export_sha256", "shown_sha256"
"""Of the manifest that was captured, and of what it shows, whenever it was written."""
SOURCE = "source"
"""Of a frame in the list of captures: name and SHA-256 of the file that it was taken from."""
_AGAIN = "delete this one file and run again what captured it: it alone is taken again"
_DARKS = 4
"""Least number of dark frames: their mean is taken from every other frame, and their spread is the read noise."""
_UNDONE = re.compile(r"\..+\.[0-9a-f]{12}\.tmp|\.lock")
"""What a killed process leaves: folders of files that were not written to their end, and its lock."""
_SATURATED = 0.5
_SAID = 4


@dataclass(frozen=True)
class CaptureFrame:
    """One frame of a capture.

    Args:
        name: of its file.
        slot: that is shown; None for dark, and for a whole exposure.
        of: the frame that it repeats; its own name for the first.
    """

    name: str
    slot: int | None
    of: str


def frames_of(manifest: dict[str, Any], repeats: int = 1) -> list[CaptureFrame]:
    """Frames of an export: a dark one, then one a slot, or one exposure of a sensor whose shutter is coded; again for
    every repeat. As many dark ones follow as there are slots, for what they leave is taken from every slot alike."""
    slots = {f"slot_{k:03d}": k for k in range(manifest["slots"])}
    once: dict[str, int | None] = {DARK: None, **({WHOLE: None} if exposed_whole(manifest) else slots)}
    ends = ["", *(f"_r{n}" for n in range(1, repeats))]
    frames = [CaptureFrame(name + end, slot, name) for end in ends for name, slot in once.items()]
    darks = max(_DARKS, 0 if exposed_whole(manifest) else manifest["slots"])
    return frames + [CaptureFrame(f"{DARK}_r{n}", None, DARK) for n in range(repeats, darks)]


def captured_so_far(folder: Path, export: str | Path) -> dict[str, Any]:
    """What a folder holds of this export's capture; a new list where there is none. Frames whose file is gone are to be
    taken again.

    Raises:
        OutputError: the folder holds something else, or frames of another export.
        DataError: no export, or what ``read_captures`` raises.
    """
    if not (folder / CAPTURES).exists():
        if folder.exists() and (folder.is_file() or any(not _UNDONE.fullmatch(file.name) for file in folder.iterdir())):
            raise OutputError(folder, "something that is no capture", "a new folder", "choose another")
        of = {EXPORT: checksum_of(Path(export) / NAME), SHOWN: shown_digest(read_manifest(export))}
        return {"export": str(export), **of, "taken_with": {}, "frames": {}}
    record = read_captures(folder, whole=False)
    if not is_of(record, export):
        raise OutputError(folder, f"a capture of {record['export']}", "one of this export", "choose another folder")
    return record


def is_of(record: dict[str, Any], export: str | Path) -> bool:
    """Whether a capture is of this export, or of one that shows the same; lists of before know the manifest alone."""
    manifest = read_manifest(export)
    return record[EXPORT] == checksum_of(Path(export) / NAME) or record.get(SHOWN) == shown_digest(manifest)


def resumed(record: dict[str, Any], how: dict[str, Any], folder: Path) -> dict[str, Any]:
    """A list of frames with what they were taken with; frames that were taken otherwise are never joined with others.

    Raises:
        OutputError: the folder holds frames of another bench.
    """
    before = record["taken_with"] if record["frames"] else how
    for name in sorted(before.keys() | how.keys()):
        if before.get(name) != how.get(name):
            found = f"frames of {name} {before.get(name)}"
            remedy = "frames of both are not joined: choose another folder, or delete this one"
            raise OutputError(folder, found, f"{name} {how.get(name)}", remedy)
    return {**record, "taken_with": how}


@contextmanager
def in_use(folder: Path) -> Iterator[None]:
    """Keep other processes out of the folder of a capture, which is gone again if nothing came into it.

    Raises:
        OutputError: another one captures into it.
    """
    if folder.exists() and not folder.is_dir():
        raise OutputError(folder, "something that is no capture", "a new folder", "choose another")
    with held_folder(folder, "a capture"):
        sweep(folder)  # of one that was killed behind its last frame; nothing else may be written here
        yield


def keep(
    values: NDArray[np.integer],
    frame: CaptureFrame,
    record: dict[str, Any],
    folder: Path,
    about: Mapping[str, Any] | None = None,
) -> None:
    """Write a frame (H, W), or (C, H, W), as 16-bit TIFF, and the list with it, what is known about it included.

    The list is there before the first frame, so that whatever ends the process leaves a capture that goes on.
    """
    file = make_folder(folder) / f"{frame.name}.tif"
    if not (folder / CAPTURES).exists():
        write_json(record, folder / CAPTURES)
    with atomic_path(file, overwrite=True) as temporary:
        temporary.write_bytes(tiff_bytes(values.astype(np.uint16), photometric="minisblack"))
    taken = {"sha256": checksum_of(file), "taken": datetime.now(UTC).isoformat(timespec="seconds")}
    record["frames"][frame.name] = {"slot": frame.slot, "of": frame.of, **taken, **(about or {})}
    write_json(record, folder / CAPTURES, overwrite=True)


class _Frame(Attributes):
    """What the list says of a frame."""

    slot: int | None = None
    of: str
    sha256: str
    taken: str | None = None
    source: dict[str, str] | None = None


class _Taken(OpenAttributes):
    """What frames were taken with."""

    gain: float
    saturation: float
    reflectance: float | None = None
    wavelength_nm: float | None = None
    pattern: int | None = None


class _Record(Attributes):
    """The list of captures."""

    export: str
    export_sha256: str
    shown_sha256: str | None = None
    taken_with: _Taken
    frames: dict[Beside, _Frame]


def read_captures(folder: str | Path, whole: bool = True) -> dict[str, Any]:
    """What was captured, every frame as it was written.

    Args:
        folder: of the capture.
        whole: refuse frames whose file is missing, instead of leaving them out.

    Raises:
        DataError: no capture, or a frame that is missing or changed.
    """
    record = read_json(Path(folder) / CAPTURES, _Record, "what `tmca capture` wrote").model_dump(exclude_unset=True)
    for name, about in list(record["frames"].items()):
        frame = Path(folder) / f"{name}.tif"
        if frame.is_file() and checksum_of(frame) != about["sha256"]:
            raise DataError(frame, "another content", "what was captured", _AGAIN)
        if not frame.is_file():
            if whole:
                raise DataError(frame, "no such file", f"the frame {name}", "run again what captured it")
            del record["frames"][name]
    return record


def check_frame(values: NDArray[np.integer], where: Path, size: tuple[int, ...], saturation: float) -> None:
    """Raises DataError for a frame of another size than (H, W), or (C, H, W) of a sensor with channels, or one of which
    more than half is saturated."""
    if values.shape not in ((size, size[1:]) if size[0] == 1 else (size,)):
        found, expected = ("×".join(map(str, one)) for one in (values.shape, size if size[0] > 1 else size[1:]))
        alike = values.shape[-2:] == size[-2:]
        remedy = "take all channels, or buckets, of the sensor" if alike else "set the sensor's region to that"
        raise DataError(where, f"a frame of {found}", f"{expected} pixels", remedy)
    if (share := float((values >= saturation).mean())) > _SATURATED:
        remedy = "open the aperture of the lens less, or expose shorter"
        raise DataError(where, f"{share:.0%} saturated pixels", f"{_SATURATED:.0%} at most", remedy)


def said_sources(folder: str | Path) -> str:
    """Which file became which frame of a capture, the first and the last of them; empty where a driver took them."""
    frames = read_captures(folder)["frames"]
    pairs = [f"{name} ← {about[SOURCE]['file']}" for name, about in frames.items() if SOURCE in about]
    return ", ".join(pairs if len(pairs) <= 2 * _SAID else [*pairs[:_SAID], "…", *pairs[-_SAID:]])
