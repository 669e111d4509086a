"""Codes that calibration shows, as exports for the devices of a capture, placed as its own codes are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch

from tmca.data import make_folder
from tmca.errors import DataError, OutputError
from tmca.lab.calibrating.shots import CODES, OPEN, PATTERNS, Asked, pair_name
from tmca.lab.calibration.patterns import calibration_patterns, write_patterns
from tmca.lab.calibration.steps.building_on import read_patterns
from tmca.lab.devices.descriptions import DeviceDescription
from tmca.lab.devices.export import Export, export_like
from tmca.lab.devices.manifest import read_manifest
from tmca.lab.devices.placement import Placement
from tmca.lab.devices.reading import device_of, placement_of
from tmca.lab.devices.sources import Planes

_MASKED = ("coded-exposure",)
"""Devices whose shutter is shown; that of others is laid on the frames afterwards."""


class ShownCodes:
    """Exports of what a calibration shows, written into ``FOLDER/shown`` when they are asked for.

    Args:
        export: of the codes that are to be captured afterwards.
        folder: of the calibration's frames; ``FOLDER/patterns`` holds the patterns as pictures.
        asked: how many of them.
    """

    def __init__(self, export: str | Path, folder: Path, asked: Asked) -> None:
        self.source, self.manifest, self.folder, self.asked = Path(export), read_manifest(export), folder, asked
        self.placed = _placed(export, self.manifest)

    @property
    def size(self) -> tuple[int, int]:
        """(H, W) of the aperture's code."""
        return self.placed["aperture"][1].code

    def export(self, name: str) -> Export:
        """The codes of a ``Shot`` for the devices.

        Raises:
            DataError: an export without an aperture of pixels.
            OutputError: other patterns in their place.
        """
        if name == CODES:
            return Export(self.source, self.manifest)
        if "aperture" not in self.placed:
            found = f"an export of {', '.join(self.placed) or 'masks'}"
            raise DataError(self.source, found, "an aperture of pixels", "export it to the device that shows it")
        planes = self._patterns() if name == PATTERNS else self._slots(name)
        placed = {plane: self.placed[plane] for plane in planes}
        codes = Planes("codes of a calibration", self.manifest["camera"], planes)
        slot = float(self.manifest["exposure_s"]) / int(self.manifest["slots"])
        return export_like(codes, placed, self.folder / "shown" / name, slot)

    def _patterns(self) -> dict[str, torch.Tensor]:
        own = calibration_patterns(self.size, self.asked.count)
        place = self.folder / "patterns"
        if not place.exists():
            make_folder(self.folder)
            write_patterns(place, self.size, self.asked.count)
        kept = read_patterns(place)
        if kept.shape != own.shape or not np.array_equal(kept, own):
            raise OutputError(place, "other patterns", "those of this calibration", "choose another folder")
        return {"aperture": torch.from_numpy(own).float()}

    def _slots(self, name: str) -> dict[str, torch.Tensor]:
        """All open in every slot, or in one slot of each plane."""
        slots = int(self.manifest["slots"])
        pairs = {pair_name(i, j): (i, j) for i in range(slots) for j in range(slots)} | {OPEN: (None, None)}
        return {
            plane: _open(slots, self.placed[plane][1].code, only)
            for plane, only in zip(("aperture", "shutter"), pairs[name], strict=True)
            if plane in self.placed
        }


def _open(slots: int, size: tuple[int, int], only: int | None) -> torch.Tensor:
    """(K, H, W) open in one slot, or in all of them."""
    chosen = torch.ones(slots) if only is None else torch.eye(slots)[only]
    return chosen[:, None, None].expand(slots, *size).contiguous()


def _placed(export: str | Path, manifest: dict[str, Any]) -> dict[str, tuple[DeviceDescription, Placement]]:
    found = {}
    for about in manifest["planes"]:
        device = device_of(about, export)
        if about["plane"] == "aperture" or device.kind in _MASKED:
            found[about["plane"]] = (device, placement_of(about))
    return found
