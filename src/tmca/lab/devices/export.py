"""Codes as files that devices show, with a manifest that says when, and reads them back."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import tmca
from tmca.errors import SettingError
from tmca.lab.codes_date import CODES_DATE, date_of_codes, now
from tmca.lab.devices.descriptions import DeviceDescription
from tmca.lab.devices.export_folder import RESPONSE, TABLE, check_free, written_whole
from tmca.lab.devices.frames import write_frame
from tmca.lab.devices.manifest import FORMAT, NAME, SOURCE_AT, Timing, checksum, sealed, shown_files
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
_FRAME_RATE = 500
"""Frames a second of ordinary cameras at most."""


class FastFrames(UserWarning):
    """More frames a second than ordinary cameras take."""


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
        offset: (rows, columns) by which the aperture is displaced from the device's middle, pitches of its pixels.
        affine: of ``registered_affine``, from code to device pixels of the aperture, in the place of its description's
            macro-pixel, angle and flip and of the offset.
        overwrite: replace an export.

    Raises:
        SettingError: codes that a device cannot show, or two devices for one plane.
        OutputError: something is in the folder's place.
    """
    for name, size in (("--code-size", code_size), ("--sensor-size", sensor_size)):
        if size is not None and min(size) < 1:
            raise SettingError(name, f"{size[0]}x{size[1]}", "HEIGHTxWIDTH of one pixel or more")
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
        _remark_rate(device, timing)
    with written_whole(folder) as temporary:
        manifest = _manifest(codes, timing, [_plane(codes, one, shown, timing, temporary) for one in devices])
        _write_manifest(manifest, temporary)
    return Export(folder, manifest)


def _remark_rate(device: DeviceDescription, timing: Timing) -> None:
    """Warn where an ordinary camera would have to take frames one after the other faster than most can."""
    rate = timing.slots / timing.exposure
    if device.kind == "emulated-shutter" and rate > _FRAME_RATE:
        said = f"{timing.slots} frames of {1e3 / rate:.3g} ms, {rate:.0f} a second where they follow each other"
        remedy = "where the camera is slower, pause between the slots of a scene that stands still, or --exposure more"
        warnings.warn(f"{device.name}: {said}; {remedy}", FastFrames, stacklevel=2)


def _check_asked(devices: Sequence[DeviceDescription], folder: Path, overwrite: bool) -> None:
    planes = [device.plane for device in devices]
    if not planes or len(set(planes)) < len(planes):
        found = f"{len(planes)} of them, for {', '.join(planes) or 'nothing'}"
        raise SettingError("--device", found, "one device for each plane that is shown")
    check_free(folder, overwrite)


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
        "units": "grey level" if device.kind == "lcos" else f"{device.top} = open",
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
    if device.plane not in codes.tiled:
        return None
    option = "--sensor-size" if device.plane == "shutter" else "--code-size"
    if device.size is None:
        tile = "×".join(map(str, codes.planes[device.plane].shape[1:]))
        said = f"HEIGHTxWIDTH of {device.name}, which shows a tile of {tile} pixels again and again"
        raise SettingError(option, "none", said)
    if device.mounting_angle_deg or device.lattice != "square":
        raise SettingError(option, "none", "HEIGHTxWIDTH of the code where a device is turned", "give one that fits")
    return (int(device.size[0] // device.macro_pixel), int(device.size[1] // device.macro_pixel))


def _levels(plane: NDArray[np.float32], device: DeviceDescription, source: str) -> NDArray[np.integer]:
    if device.kind == "lcos":
        return grey_of(plane, device)
    if ((plane != 0) & (plane != 1)).any():
        raise SettingError(source, f"grey values in the {device.plane}", "zeros and ones on a binary device")
    return (plane * device.top).astype(np.uint16)


def _mirror(codes: Planes, device: DeviceDescription, timing: Timing, place: Path, folder: Path) -> dict[str, Any]:
    terms = terms_of(codes, device)
    file = place / TABLE
    file.write_text(table(terms), encoding="utf-8")
    frames = shown_files([file] * len(terms.rms), folder, timing, _TRIGGERS[device.kind])
    return {
        "units": "micrometres of surface, root mean square over the pupil; larger = deeper (longer path)",
        "frames": frames,
        "residual_rms_nm": (terms.residual * 1e9).round(4).tolist(),
        "peak_to_valley_um": (terms.peak_to_valley() * 1e6).round(6).tolist(),
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
        **({SOURCE_AT: str(Path(codes.source).absolute())} if Path(codes.source).exists() else {}),
        CODES_DATE: date_of_codes([codes.source]) if Path(codes.source).exists() else now(),
        "slots": timing.slots, "exposure_s": timing.exposure, "planes": planes,
    })  # fmt: skip


def _write_manifest(manifest: dict[str, Any], folder: Path) -> None:
    from tmca.data import write_json

    write_json(manifest, folder / NAME)
