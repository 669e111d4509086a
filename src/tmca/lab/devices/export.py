"""Codes as files that devices show, with a manifest that says when, and reads them back."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import tmca
from tmca.errors import OutputError, SettingError
from tmca.lab.codes_date import CODES_DATE, date_of_codes, now
from tmca.lab.devices.descriptions import DeviceDescription
from tmca.lab.devices.frames import write_frame
from tmca.lab.devices.manifest import FORMAT, NAME, Timing, checksum, sealed, shown_files
from tmca.lab.devices.mirror import table, terms_of
from tmca.lab.devices.placement import Affine, Placement
from tmca.lab.devices.response import grey_of, response
from tmca.lab.devices.sources import Planes, Size

_TRIGGERS = {
    "dmd": {"source": "external", "edge": "rising", "shows": "one pattern a pulse"},
    "lcos": {"source": "video", "edge": "frame", "shows": "one frame a slot"},
    "deformable-mirror": {"source": "software", "edge": "none", "shows": "one shape a slot"},
    "coded-exposure": {"source": "sensor", "edge": "slot", "shows": "one mask a slot, one exposure of all"},
    "emulated-shutter": {"source": "software", "edge": "none", "shows": "one frame a slot, masked afterwards"},
}
TABLE, RESPONSE = "zernike.csv", "response.csv"


@dataclass(frozen=True)
class Export:
    """What was written.

    Args:
        folder: of the export.
        manifest: its content.
    """

    folder: Path
    manifest: dict[str, Any]


def export_codes(
    codes: Planes,
    devices: Sequence[DeviceDescription],
    out: str | Path,
    *,
    exposure: float = 0.1,
    code_size: Size | None = None,
    sensor_size: Size | None = None,
    offset: tuple[int, int] = (0, 0),
    affine: Affine | None = None,
    overwrite: bool = False,
) -> Export:
    """Write what devices show.

    Args:
        codes: of one exposure.
        devices: one for each plane that is shown.
        out: folder, written whole or not at all.
        exposure: of all slots together, seconds.
        code_size: (H, W) pixels of the aperture's code; the code's own, or as many as the device shows of a tile.
        sensor_size: (H, W) of the shutter, likewise; the shutter's own without.
        offset: (rows, columns) of device pixels by which the aperture is displaced from the device's middle.
        affine: of ``registered_affine``, from code to device pixels of the aperture, in the place of its description's
            macro-pixel, angle and flip and of the offset.
        overwrite: replace an export.

    Raises:
        SettingError: codes that a device cannot show, or two devices for one plane.
        OutputError: something is in the folder's place.
    """
    sizes, places = {"aperture": code_size, "shutter": sensor_size}, {"aperture": (offset, affine)}

    def shown(device: DeviceDescription) -> tuple[NDArray[np.float32], Placement]:
        plane = codes.full(device.plane, sizes.get(device.plane) or _shown_size(codes, device)).numpy()
        return plane, _placed(device, plane.shape[1:], *places.get(device.plane, ((0, 0), None)))

    return _written(codes, devices, shown, Path(out), exposure, overwrite)


def export_like(
    codes: Planes, placed: Mapping[str, tuple[DeviceDescription, Placement]], out: str | Path, slot: float
) -> Export:
    """Write other codes for the devices of an export, placed as its own are; what is in the folder's place is replaced.

    Args:
        codes: planes of the sizes of those placements.
        placed: device and placement by plane.
        out: folder, written whole or not at all.
        slot: seconds.

    Raises:
        SettingError, OutputError: see ``export_codes``.
    """

    def shown(device: DeviceDescription) -> tuple[NDArray[np.float32], Placement]:
        return codes.full(device.plane).numpy(), placed[device.plane][1]

    return _written(codes, [device for device, _ in placed.values()], shown, Path(out), codes.slots * slot, True)


_Shown = Callable[[DeviceDescription], tuple[NDArray[np.float32], Placement]]
"""(K, H, W) what a device shows, and where."""


def _placed(
    device: DeviceDescription, code: tuple[int, ...], offset: tuple[int, int], affine: Affine | None
) -> Placement:
    size = (code[0], code[1])
    placement = Placement.of(device, size, offset)
    return placement if affine is None else Placement.by(affine, placement.device, size)


def _written(
    codes: Planes, devices: Sequence[DeviceDescription], shown: _Shown, folder: Path, exposure: float, overwrite: bool
) -> Export:
    """The folder of an export, whole or not at all."""
    _check_asked(devices, folder, overwrite)
    timing = Timing(codes.slots, exposure)
    for device in devices:
        timing.check(device)
    temporary = folder.with_name(f".{folder.name}.part")
    shutil.rmtree(temporary, ignore_errors=True)
    try:
        temporary.mkdir(parents=True)
        manifest = _manifest(codes, timing, [_plane(codes, one, shown, timing, temporary) for one in devices])
        _write_manifest(manifest, temporary)
        if folder.exists():
            shutil.rmtree(folder)
        temporary.rename(folder)
    except OSError as error:
        found = f"no folder can be written ({error.strerror})"
        raise OutputError(folder, found, "a folder", "choose another") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return Export(folder, manifest)


def _check_asked(devices: Sequence[DeviceDescription], folder: Path, overwrite: bool) -> None:
    planes = [device.plane for device in devices]
    if not planes or len(set(planes)) < len(planes):
        found = f"{len(planes)} of them, for {', '.join(planes) or 'nothing'}"
        raise SettingError("--device", found, "one device for each plane that is shown")
    there = folder.exists() and (folder.is_file() or any(folder.iterdir()))
    if there and not (folder / NAME).is_file():
        raise OutputError(folder, "something that is no export", "a new folder", "choose another")
    if there and not overwrite:
        raise OutputError(folder, "an export", "a new folder", "choose another, or pass --overwrite")


def _plane(codes: Planes, device: DeviceDescription, shown: _Shown, timing: Timing, folder: Path) -> dict[str, Any]:
    """Files of one device, and what the manifest says of them."""
    place = folder / device.plane
    place.mkdir()
    about: dict[str, Any] = {"plane": device.plane, "device": device.model_dump(), **_response(device, place)}
    if device.kind == "deformable-mirror":
        return about | _mirror(codes, device, timing, place, folder)
    plane, placement = shown(device)
    frames = placement.shown(_levels(plane, device, codes.source))
    files = [write_frame(place / f"{device.plane}_{k:03d}.png", frame, device.bits) for k, frame in enumerate(frames)]
    return about | {
        "placement": vars(placement),
        "units": "1 = open" if device.bits == 1 else "grey level",
        "frames": shown_files(files, folder, timing, _TRIGGERS[device.kind]),
        "codes_sha256": digest(plane),
    }


def _response(device: DeviceDescription, place: Path) -> dict[str, Any]:
    """The table of a display's response beside its frames, without which they cannot be read."""
    if device.lut is None:
        return {}
    response(device)
    shutil.copyfile(device.lut, place / RESPONSE)
    name = f"{place.name}/{RESPONSE}"
    return {"device": device.model_dump() | {"lut": name}, "response_sha256": checksum(place / RESPONSE)}


def _shown_size(codes: Planes, device: DeviceDescription) -> Size | None:
    """Of a tile: as many code pixels as a device shows; None for codes that have a size of their own."""
    if device.plane not in codes.tiled or device.size is None:
        return None
    if device.mounting_angle_deg or device.lattice != "square":
        raise SettingError("--size", "none", "HEIGHTxWIDTH of the code where a device is turned", "give one that fits")
    return (int(device.size[0] // device.macro_pixel), int(device.size[1] // device.macro_pixel))


def _levels(plane: NDArray[np.float32], device: DeviceDescription, source: str) -> NDArray[np.uint8]:
    if device.kind == "lcos":
        return grey_of(plane, device)
    if ((plane != 0) & (plane != 1)).any():
        raise SettingError(source, f"grey values in the {device.plane}", "zeros and ones on a binary device")
    return plane.astype(np.uint8)


def _mirror(codes: Planes, device: DeviceDescription, timing: Timing, place: Path, folder: Path) -> dict[str, Any]:
    terms = terms_of(codes, device)
    file = place / TABLE
    file.write_text(table(terms), encoding="utf-8")
    frames = shown_files([file] * len(terms.rms), folder, timing, _TRIGGERS[device.kind])
    return {
        "units": "micrometres of surface, root mean square over the pupil; larger = deeper (longer path)",
        "frames": frames,
        "residual_rms_nm": (terms.residual * 1e9).round(4).tolist(),
        "codes_sha256": digest(np.round(terms.rms * 1e6, 9)),
    }


def digest(codes: NDArray[Any]) -> str:
    """SHA-256 of codes, whatever the type that holds them."""
    import hashlib

    values = np.ascontiguousarray(codes, dtype=np.float64)
    return hashlib.sha256(repr(values.shape).encode() + values.tobytes()).hexdigest()


def _manifest(codes: Planes, timing: Timing, planes: list[dict[str, Any]]) -> dict[str, Any]:
    return sealed({
        "format": FORMAT, "tmca": tmca.__version__, "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "source": codes.source, "camera": codes.application, "settings": dict(codes.settings or {}),
        CODES_DATE: date_of_codes([codes.source]) if Path(codes.source).exists() else now(),
        "slots": timing.slots, "exposure_s": timing.exposure, "planes": planes,
    })  # fmt: skip


def _write_manifest(manifest: dict[str, Any], folder: Path) -> None:
    from tmca.data import write_json

    write_json(manifest, folder / NAME)
