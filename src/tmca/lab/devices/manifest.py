"""The manifest of an export: every file in its order, when it is shown, and what it was made from."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

from tmca.data import content_digest
from tmca.errors import DataError, SettingError
from tmca.lab.devices.descriptions import DeviceDescription

NAME, FORMAT = "manifest.json", "tmca export 1"
SOURCE_AT = "source_at"
"""Where the source lies, whatever folder its name was given in."""
DIGEST = "manifest_sha256"
"""Of the manifest's own content."""


@dataclass(frozen=True)
class Timing:
    """When the slots of one exposure are shown.

    Args:
        slots: K.
        exposure: of all slots, seconds.
    """

    slots: int
    exposure: float

    def of_slots(self) -> list[dict[str, float]]:
        """Beginning and duration of every slot, seconds from the trigger."""
        each = self.exposure / self.slots
        return [{"start_s": slot * each, "duration_s": each} for slot in range(self.slots)]

    def check(self, device: DeviceDescription) -> None:
        """Raises SettingError where a device is too slow, or holds too few patterns."""
        if isinstance(self.exposure, str) or not 0 < self.exposure < inf:
            raise SettingError("--exposure", f"{self.exposure} s", "a finite time above 0")
        rate = self.slots / self.exposure
        if device.pattern_rate_hz is not None and rate > device.pattern_rate_hz * (1 + 1e-9):
            least = self.slots / device.pattern_rate_hz
            found = f"{self.slots} slots in {self.exposure:g} s, {rate:g} patterns a second"
            remedy = f"expose {least:g} s or longer, or take fewer slots"
            raise SettingError("--exposure", found, f"{device.pattern_rate_hz:g} at most on {device.name}", remedy)
        if device.memory_patterns is not None and self.slots > device.memory_patterns:
            raise SettingError(device.name, f"{self.slots} patterns", f"{device.memory_patterns} at most in its memory")


def checksum(file: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def shown_files(files: Sequence[Path], folder: Path, timing: Timing, trigger: dict[str, str]) -> list[dict[str, Any]]:
    """What the manifest says of the files of one plane, in the order of the slots."""
    names = [file.relative_to(folder).as_posix() for file in files]
    return [
        {"slot": slot, "file": name, **when, "trigger": trigger, "sha256": checksum(folder / name)}
        for slot, (name, when) in enumerate(zip(names, timing.of_slots(), strict=True))
    ]


def sealed(manifest: dict[str, Any]) -> dict[str, Any]:
    """A manifest with its own digest."""
    return manifest | {DIGEST: content_digest(manifest, DIGEST)}


def shown_digest(manifest: dict[str, Any]) -> str:
    """SHA-256 of what an export shows: its codes in their order, on which devices, where and when, but not of when or
    from which file it was written; pictures of the same codes may differ in their bytes."""
    planes = [
        {**plane, "frames": [{k: v for k, v in frame.items() if k != "sha256"} for frame in plane["frames"]]}
        for plane in manifest["planes"]
    ]
    return content_digest({"slots": manifest["slots"], "exposure_s": manifest["exposure_s"], "planes": planes}, DIGEST)


def read_manifest(folder: str | Path) -> dict[str, Any]:
    """The manifest of an export.

    Raises:
        DataError: no export, one of another version, or a manifest that was changed.
    """
    file = Path(folder) / NAME
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except OSError:
        raise DataError(folder, f"no {NAME}", "the folder of an export", "make one with `tmca export`") from None
    except (ValueError, UnicodeDecodeError):
        raise DataError(file, "no JSON", "the manifest of an export", "export again") from None
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise DataError(file, f"format {found.get('format') if isinstance(found, dict) else None!r}", repr(FORMAT))
    if DIGEST not in found:
        raise DataError(file, f"no {DIGEST}", "the digest that `tmca export` writes", "export again")
    if found[DIGEST] != content_digest(found, DIGEST):
        raise DataError(file, "a manifest that was changed after the export", f"that of its {DIGEST}", "export again")
    _check_planes(found, file)
    return found


def _check_planes(found: dict[str, Any], file: Path) -> None:
    """Raises DataError for a manifest that was altered: without planes or exposure, or with files of other slots."""
    try:
        slots = {len({shown["slot"] for shown in plane["frames"]}) for plane in found["planes"]}
        stated = {int(found["slots"])}
        float(found["exposure_s"])
    except (KeyError, TypeError, ValueError):
        said = "no slots, no exposure time, or planes without frames"
        raise DataError(file, said, "the manifest of an export", "export again") from None
    if not slots or slots != stated:
        said = f"{', '.join(map(str, sorted(slots))) or 'no'} slots shown where {found['slots']} are stated"
        raise DataError(file, said, "as many as it states", "export again")


def exposed_whole(manifest: dict[str, Any]) -> bool:
    """Whether the sensor codes its shutter itself, in one exposure of all slots."""
    return any(plane["device"]["kind"] == "coded-exposure" for plane in manifest["planes"])


def frame_time(manifest: dict[str, Any]) -> float:
    """Seconds that one frame of a capture is exposed: all slots of a coded shutter, or one."""
    return float(manifest["exposure_s"]) / (1 if exposed_whole(manifest) else int(manifest["slots"]))
