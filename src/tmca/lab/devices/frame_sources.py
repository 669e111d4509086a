"""The files that frames of a capture were taken from: kept beside them, so that files that change are noticed."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tmca.errors import OutputError
from tmca.lab.devices.captures import read_captures
from tmca.lab.devices.manifest import checksum

SOURCE = "source"
"""Of a frame in the list of captures: name and SHA-256 of its file."""
_SAID = 4
Sources = Mapping[str, dict[str, str]]


class ChangedFrames(UserWarning):
    """Files are others than when their frames were taken."""


def sources_of(files: Mapping[str, Path]) -> dict[str, dict[str, str]]:
    """Name of a frame → name and SHA-256 of its file."""
    return {name: {"file": file.name, "sha256": checksum(file)} for name, file in files.items()}


def still_current(kept: dict[str, Any], sources: Sources, folder: Path) -> dict[str, Any]:
    """A list of frames without those whose file is another by now: they are to be taken again, and a warning says so.

    Raises:
        OutputError: frames whose file is gone.
    """
    frames = kept["frames"]
    if gone := [name for name in frames if name not in sources]:
        found = f"{gone[0]}, whose file is not in the folder of frames any more"
        raise OutputError(folder, found, "frames of that folder alone", "choose another folder, or put it back")
    stale = [name for name, about in frames.items() if about.get(SOURCE) != sources[name]]
    if stale:
        said = ", ".join(stale[:_SAID]) + (f" and {len(stale) - _SAID} more" if len(stale) > _SAID else "")
        changed = "their files are not those that they were taken from"
        warnings.warn(f"{folder}: taken again: {said}; {changed}", ChangedFrames, stacklevel=2)
    return {**kept, "frames": {name: about for name, about in frames.items() if name not in stale}}


def said_sources(folder: str | Path) -> str:
    """Which file became which frame of a capture, the first and the last of them; empty where a driver took them.

    Raises:
        DataError: no capture.
    """
    frames = read_captures(folder)["frames"]
    pairs = [f"{name} ← {about[SOURCE]['file']}" for name, about in frames.items() if SOURCE in about]
    if len(pairs) > 2 * _SAID:
        pairs = [*pairs[:_SAID], "…", *pairs[-_SAID:]]
    return ", ".join(pairs)
