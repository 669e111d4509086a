"""Exports read back: every file there, unchanged, in order, and the very codes in them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from pydantic import ValidationError

from tmca.errors import DataError
from tmca.lab.devices.descriptions import DeviceDescription
from tmca.lab.devices.export import digest
from tmca.lab.devices.frames import read_frame
from tmca.lab.devices.manifest import checksum, read_manifest
from tmca.lab.devices.mirror import read_table
from tmca.lab.devices.placement import Placement
from tmca.lab.devices.response import grey_of, light_of
from tmca.lab.devices.sources import Planes
from tmca.optics import ZernikeHeights
from tmca.optics.zernike import noll

_MASK = 64
"""Pixels of the side of height maps that are made of Zernike terms."""


def check_export(folder: str | Path) -> dict[str, Any]:
    """The manifest of an export all of whose files are there and as they were written.

    Raises:
        DataError: a file that is missing, changed, or in another's place.
    """
    manifest, place = read_manifest(folder), Path(folder)
    for plane in manifest["planes"]:
        _check_response(plane, place)
        known = {frame["sha256"]: frame["file"] for frame in plane["frames"]}
        for frame in plane["frames"]:
            file = place / frame["file"]
            if not file.is_file():
                raise DataError(file, "no such file", f"the frame of slot {frame['slot']}", "export again")
            found = checksum(file)
            if found != frame["sha256"]:
                other = known.get(found)
                what = f"the content of {other}: frames in the wrong order" if other else "another content"
                raise DataError(file, what, f"what was exported for slot {frame['slot']}", "export again")
    return manifest


def _check_response(plane: dict[str, Any], place: Path) -> None:
    if "response_sha256" not in plane:
        return
    file = place / plane["device"]["lut"]
    if not file.is_file() or checksum(file) != plane["response_sha256"]:
        found = "another content" if file.is_file() else "no such file"
        raise DataError(file, found, "the response that frames were exported with", "export again")


def read_export(folder: str | Path) -> Planes:
    """The codes of an export.

    Returns:
        Planes as they were exported, over the whole device; heights of Zernike terms as maps of 64×64 pixels with their
        ``modes``.

    Raises:
        DataError: what ``check_export`` raises, or codes that are not those of the manifest.
    """
    manifest = check_export(folder)
    planes: dict[str, torch.Tensor] = {}
    modes = None
    for about in manifest["planes"]:
        device = device_of(about, folder)
        if device.kind == "deformable-mirror":
            planes["heights"], modes = _heights(about, Path(folder))
        else:
            planes[about["plane"]] = _pixels(about, device, Path(folder))
    return Planes(str(folder), manifest["camera"], planes, (), modes, manifest["settings"])


def device_of(about: dict[str, Any], folder: str | Path) -> DeviceDescription:
    """The device of a plane.

    Raises:
        DataError: the manifest describes none.
    """
    try:
        known = DeviceDescription.model_validate(about["device"])
    except (KeyError, ValidationError):
        raise DataError(folder, "a device that is none", "the manifest of an export", "export again") from None
    return known if known.lut is None else known.model_copy(update={"lut": str(Path(folder) / known.lut)})


def placement_of(about: dict[str, Any]) -> Placement:
    """How the codes of a plane lie on its device."""
    known = dict(about["placement"])
    pairs = {name: tuple(known[name]) for name in ("code", "device", "flip", "offset")}
    affine = known.get("affine")
    turned = None if affine is None else (tuple(affine[0]), tuple(affine[1]))
    return Placement(**{**known, **pairs, "affine": turned})


def _pixels(about: dict[str, Any], device: DeviceDescription, folder: Path) -> torch.Tensor:
    frames = np.stack([read_frame(folder / frame["file"]) for frame in about["frames"]])
    levels = placement_of(about).read_back(frames, f"{folder}: {about['plane']}")
    if device.kind != "lcos":
        return _checked(levels.astype(np.float32) / device.top, about, folder)
    light = light_of(levels.astype(np.uint8), device)
    binary = np.round(light).astype(np.float32)
    exact = np.array_equal(grey_of(binary, device), levels)  # zeros and ones come back as what they were
    return _checked(binary, about, folder) if exact else torch.from_numpy(light)


def _checked(codes: np.ndarray[Any, Any], about: dict[str, Any], folder: Path) -> torch.Tensor:
    if digest(codes) != about["codes_sha256"]:
        raise DataError(folder, f"other codes in the {about['plane']}", "those of the manifest", "export again")
    return torch.from_numpy(codes)


def _heights(about: dict[str, Any], folder: Path) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
    terms = read_table(folder / about["frames"][0]["file"])
    if digest(np.round(terms.rms * 1e6, 9)) != about["codes_sha256"]:
        raise DataError(folder, "other Zernike terms", "those of the manifest", "export again")
    coefficients = torch.from_numpy(terms.rms.astype(np.float32))
    maps = ZernikeHeights(coefficients, [noll(index) for index in terms.noll], (_MASK, _MASK))
    return maps().detach(), {"coefficients": coefficients, "noll": torch.tensor(terms.noll)}
