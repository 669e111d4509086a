"""Frames that other software took of an export, as a bench."""

from __future__ import annotations

from math import inf
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tmca.data import read_array
from tmca.errors import DataError, SettingError
from tmca.lab.devices.captures import DARK, steps
from tmca.lab.devices.export import Export
from tmca.lab.frames import frame_files


class FrameFolder:
    """A folder of frames; a driver of the package, ``tmca capture EXPORT --device folder --set path=FOLDER``.

    Files are the frames that ``captures.steps`` names (``dark``, ``slot_000``, ``dark_r1``, …), or, where none has such
    a name, those beginning with ``dark`` and all others, in the order of the numbers in their names: one a slot, or one
    exposure of all, again for every repeat.

    Args:
        path: of the folder: PNG, TIFF, BMP or NPY, whole numbers; colours become channels.
        saturation: digital number from which on a pixel is saturated; the largest that the files can hold without.
        snapshot_units_per_dn: see ``Device``.

    Raises:
        DataError: no frames.
        SettingError: numbers that are none above 0.
    """

    def __init__(
        self, path: str, saturation: str | float | None = None, snapshot_units_per_dn: str | float | None = None
    ) -> None:
        self.path = Path(path)
        self.files = {file.stem: file for file in frame_files(self.path)}
        first = next(iter(self.files.values()))
        self.saturation = _largest(first) if saturation is None else _number("saturation", saturation)
        if snapshot_units_per_dn is not None:
            self.snapshot_units_per_dn = _number("snapshot_units_per_dn", snapshot_units_per_dn)
        self.name = DARK

    def load(self, export: Export) -> None:
        """Find the frame of every step.

        Raises:
            DataError: frames of no whole number of exposures.
        """
        once = steps(export.manifest)
        if not any(step.name in self.files for step in once):
            slots = [step.name for step in once if step.of != DARK]
            self.files = self._in_order(export, len(slots))
        if missing := [step.name for step in once if step.name not in self.files]:
            darks = sum(step.of == DARK for step in once)
            expected = f"{len(once) - darks} frames of light and {darks} dark ones, or more of both"
            raise DataError(self.path, f"no frame {', '.join(missing[:3])}", expected, "take what is missing")

    def _in_order(self, export: Export, each: int) -> dict[str, Path]:
        dark = [file for stem, file in self.files.items() if stem.lower().startswith(DARK)]
        light = [file for stem, file in self.files.items() if not stem.lower().startswith(DARK)]
        if not light or len(light) % each:
            found = f"{len(light)} frames whose names do not begin with {DARK}"
            raise DataError(self.path, found, f"{each}, or as many again for every repeat", "see docs/devices.md")
        wanted = steps(export.manifest, len(light) // each)
        named = zip([step.name for step in wanted if step.of != DARK], light, strict=True)
        return {**dict(named), **{DARK + (f"_r{n}" if n else ""): file for n, file in enumerate(dark)}}

    def name_frame(self, name: str) -> None:
        """See ``Named``."""
        self.name = name

    def show(self, slot: int | None) -> None:
        """See ``Device``; what was shown is in the frames."""

    def capture(self, whole: bool = False) -> NDArray[np.integer]:
        """See ``Device``.

        Raises:
            DataError: no such frame, or a broken one.
        """
        if self.name not in self.files:
            raise DataError(self.path, f"no frame {self.name}", "one for every repeat", "--repeat less, or take it")
        found = read_array(self.files[self.name])
        return found if found.ndim != 3 else np.moveaxis(found[..., :3], -1, 0)


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
