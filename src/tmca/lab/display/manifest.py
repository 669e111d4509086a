"""Exports read back: the manifest, every file there, unchanged, in order, and the very codes in them."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, model_validator

from tmca.attributes import Attributes, Inside, NamedJson, attributes_of, read_json
from tmca.data import checksum_of, content_digest, read_array
from tmca.errors import DataError, SettingError
from tmca.lab.display.codes import Planes, read_table, shutter_of
from tmca.lab.display.devices import DeviceDescription, grey_of, light_of
from tmca.lab.display.placement import Placement
from tmca.optics import ZernikeHeights
from tmca.optics.zernike import noll


def write_frame(file: Path, frame: NDArray[np.integer], bits: int) -> Path:
    """A frame (R, C) as PNG: one bit a pixel, 8, or 16."""
    from PIL import Image

    if bits == 1:
        Image.fromarray((frame > 0).astype(np.uint8) * 255).convert("1").save(file)
    else:
        Image.fromarray(frame.astype(np.uint8 if bits <= 8 else np.uint16)).save(file)
    return file


def read_frame(file: Path) -> NDArray[np.integer]:
    """(R, C) what ``write_frame`` wrote; 0 and 1 of one bit.

    Raises:
        DataError: a missing or broken picture, or one in colour.
    """
    frame = read_array(file)
    if frame.ndim != 2:
        raise DataError(file, f"an array of shape {frame.shape}", "one plane of pixels", "export again")
    return frame.astype(np.uint8) if frame.dtype == np.bool_ else frame


NAME, FORMAT = "manifest.json", "tmca export 1"
SOURCE_AT = "source_at"
"""Where the source lies, whatever folder its name was given in."""


def digest(codes: NDArray[Any]) -> str:
    """SHA-256 of codes, whatever the type that holds them."""
    values = np.ascontiguousarray(codes, dtype=np.float64)
    return hashlib.sha256(repr(values.shape).encode() + values.tobytes()).hexdigest()


def shown_digest(manifest: dict[str, Any]) -> str:
    """SHA-256 of what an export shows: its codes in their order, on which devices, where and when, but not of when or
    from which file it was written; pictures of the same codes may differ in their bytes."""
    planes = [
        {**plane, "frames": [{k: v for k, v in frame.items() if k != "sha256"} for frame in plane["frames"]]}
        for plane in manifest["planes"]
    ]
    return content_digest({"slots": manifest["slots"], "exposure_s": manifest["exposure_s"], "planes": planes}, "")


def read_manifest(folder: str | Path) -> dict[str, Any]:
    """The manifest of an export.

    Raises:
        DataError: no export, one of another version, or one that says no slots, exposure or planes.
    """
    file = Path(folder) / NAME
    about: dict[str, Any] = read_json(file, NamedJson, "the manifest of an export", "make one with `tmca export`")
    attributes_of(_Manifest, about, file, "entry")
    return about


class _Frame(Attributes):
    file: Inside
    sha256: str
    start_s: float = 0.0


class _Device(DeviceDescription):
    """One whose table of the response lies in the export."""

    lut: Inside | None = None


class _Plane(Attributes):
    plane: str
    device: _Device
    frames: list[_Frame] = Field(min_length=1)
    codes_sha256: str
    response_sha256: str | None = None
    placement: Placement | None = None

    @model_validator(mode="after")
    def _whole_response(self) -> _Plane:
        if (self.device.lut is None) != (self.response_sha256 is None):
            raise ValueError("device.lut and response_sha256, or none of them")
        return self


class _Manifest(Attributes):
    """What is read of a manifest."""

    format: Literal["tmca export 1"]
    camera: str
    settings: dict[str, Any]
    source: str
    slots: int = Field(ge=1)
    exposure_s: float = Field(gt=0)
    planes: list[_Plane] = Field(min_length=1)


def exposed_whole(manifest: dict[str, Any]) -> bool:
    """Whether the sensor codes its shutter itself, in one exposure of all slots."""
    return any(plane["device"]["kind"] == "coded-exposure" for plane in manifest["planes"])


def buckets_of(manifest: dict[str, Any]) -> int:
    """Of the sensor's pixels."""
    return max(plane["device"].get("buckets", 1) for plane in manifest["planes"])


def frame_time(manifest: dict[str, Any]) -> float:
    """Seconds that one frame of a capture is exposed: all slots of a coded shutter, or one."""
    return float(manifest["exposure_s"]) / (1 if exposed_whole(manifest) else int(manifest["slots"]))


_MASK = 64
"""Pixels of the side of height maps that are made of Zernike terms."""


def check_export(folder: str | Path) -> dict[str, Any]:
    """The manifest of an export all of whose files are there and as they were written.

    Raises:
        DataError: a file that is missing or changed.
    """
    manifest = read_manifest(folder)
    for plane in manifest["planes"]:
        checksums = {frame["file"]: frame["sha256"] for frame in plane["frames"]}
        if plane.get("response_sha256") is not None:
            checksums[plane["device"]["lut"]] = plane["response_sha256"]
        for name, content in checksums.items():
            file = Path(folder) / name
            if not file.is_file():
                raise DataError(file, "no such file", "all files of the export", "export again")
            if checksum_of(file) != content:
                raise DataError(file, "another content", "what was exported", "export again")
    return manifest


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
    modes, buckets = None, buckets_of(manifest)
    for about in manifest["planes"]:
        device = device_of(about, folder)
        if device.kind == "deformable-mirror":
            planes["heights"], modes = _heights(about, Path(folder))
        else:
            planes[about["plane"]] = _pixels(about, device, Path(folder))
    return Planes(str(folder), manifest["camera"], planes, (), modes, manifest["settings"], buckets)


def device_of(about: dict[str, Any], folder: str | Path) -> DeviceDescription:
    """The device of a plane."""
    device = DeviceDescription.model_validate(about["device"])
    return device if device.lut is None else device.model_copy(update={"lut": str(Path(folder) / device.lut)})


def placement_of(about: dict[str, Any], folder: str | Path) -> Placement:
    """How the codes of a plane lie on its device.

    Raises:
        DataError: the manifest does not say.
    """
    if about.get("placement") is None:
        raise DataError(folder, f"no placement of the {about['plane']}", "one", "export again")
    return TypeAdapter(Placement).validate_python(about["placement"])


def _pixels(about: dict[str, Any], device: DeviceDescription, folder: Path) -> torch.Tensor:
    frames = np.stack([read_frame(folder / frame["file"]) for frame in about["frames"]])
    try:
        levels = placement_of(about, folder).read_back(frames, f"{folder}: {about['plane']}")
    except SettingError as error:
        raise DataError(folder, f"a placement of {error.found}", error.expected, "export again") from error
    if device.buckets > 1:
        return _checked(shutter_of(levels, device), about, folder)
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
