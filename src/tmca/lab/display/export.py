"""Codes as files that devices show, with a manifest that says when."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any
from warnings import warn

import numpy as np
from numpy.typing import NDArray

import tmca
from tmca.cameras import CodesWarning
from tmca.data import atomic_path, checksum_of, make_folder, write_json
from tmca.data.atomic import sweep
from tmca.errors import OutputError, SettingError, check_range
from tmca.lab.display.codes import Planes, Size, check_buckets, numbers_of, read_table, table, terms_of
from tmca.lab.display.devices import PLANES, DeviceDescription, grey_of, response
from tmca.lab.display.manifest import FORMAT, NAME, SOURCE_AT, digest, read_frame, read_manifest, write_frame
from tmca.lab.display.placement import Affine, Placement
from tmca.lab.notes import CODES_DATE, date_of_codes, now
from tmca.summaries import Summary

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE, RESPONSE, OVERVIEW = "zernike.csv", "response.csv", "overview.png"
_PLANES = "|".join(sorted(set(PLANES.values())))
_OWN = re.compile(rf"{NAME}|{OVERVIEW}|({_PLANES})(/(\1_\d+\.png|{TABLE}|{RESPONSE}))?")
"""Names within an export."""
_OF_SYSTEMS = {".DS_Store", "Thumbs.db"}
"""Files that systems put into any folder that is looked at."""


def check_free(folder: Path, overwrite: bool) -> None:
    """Raises OutputError where something is in an export's place: another one, or with ``overwrite`` files that are no
    part of it, such as captures."""
    if folder.resolve() == Path.cwd():
        raise OutputError(folder, "the folder that you stand in", "another, which can be replaced whole")
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return
    if not (folder / NAME).is_file():
        raise OutputError(folder, "something that is no export", "a new folder", "choose another")
    if not overwrite:
        raise OutputError(folder, "an export", "a new folder", "choose another, or pass --overwrite")
    sweep(folder)
    inside = sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.name not in _OF_SYSTEMS)
    if strangers := [name for name in inside if not _OWN.fullmatch(name)]:
        found, remedy = f"{strangers[0]}, which is no part of the export", "move it, or choose another folder"
        raise OutputError(folder, found, "nothing else where an export is replaced", remedy)


_TRIGGERS = {
    "dmd": {"source": "external", "edge": "rising", "shows": "one pattern a pulse"},
    "lcos": {"source": "video", "edge": "frame", "shows": "one frame a slot"},
    "deformable-mirror": {"source": "software", "edge": "none", "shows": "one shape a slot"},
    "coded-exposure": {"source": "sensor", "edge": "slot", "shows": "one mask a slot, one exposure of all"},
    "emulated-shutter": {"source": "software", "edge": "none", "shows": "one frame a slot, masked afterwards"},
}
_SLOTS = 4
LITTLE = 0.1
"""Share of a device below which codes are probably one tile of many."""
EXPOSURE = 0.1
"""Seconds of all slots together where neither the call nor the codes say it."""


@dataclass(frozen=True, repr=False)
class Export(Summary):
    """What was written.

    Args:
        folder: of the export.
        manifest: its content.
    """

    folder: Path
    manifest: dict[str, Any]

    def plot(self) -> Figure:
        """The first slots of every plane, as devices show them."""
        return export_figure(self.manifest, self.folder)

    def _facts(self) -> dict[str, str]:
        slots, seconds = self.manifest["slots"], self.manifest["exposure_s"]
        planes = {plane["plane"]: plane["device"]["name"] for plane in self.manifest["planes"]}
        return {
            "folder": str(self.folder),
            "slots": f"K = {slots} of {seconds / slots * 1e3:g} ms",
            **{plane: f"on {device}" for plane, device in planes.items()},
        }

    def _picture(self) -> Figure:
        return self.plot()


def export_codes(
    codes: Planes,
    devices: Sequence[DeviceDescription],
    out: str | Path,
    *,
    exposure: float | None = None,
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
        exposure: of all slots together, seconds; that which the codes were designed for without, else 0.1 s.
        code_size: (H, W) pixels of the aperture's code; the code's own, or as many as the device shows of a tile.
        sensor_size: (H, W) of the shutter, likewise; the shutter's own without.
        offset: (rows, columns) by which the aperture is displaced from the device's middle, pitches of its pixels.
        affine: of ``registered_affine``, from code to device pixels of the aperture, in the place of its description's
            macro-pixel, angle and flip and of the offset.
        overwrite: replace an export.

    Raises:
        SettingError: codes that a device cannot show, or two devices for one plane.
        OutputError: something is in the folder's place.

    Warns:
        CodesWarning: codes of a file alone, without a period, that cover little of a device.
    """
    _check_asked(devices, code_size, sensor_size)
    check_free(Path(out), overwrite)
    sizes = {"aperture": code_size, "shutter": sensor_size}
    shown: list[_Shown] = []
    for device in devices:
        if device.kind == "deformable-mirror":
            shown.append((device, None, None))
            continue
        plane = codes.full(device.plane, sizes.get(device.plane) or _shown_size(codes, device)).numpy()
        size, moved = (plane.shape[-2], plane.shape[-1]), offset if device.plane == "aperture" else (0, 0)
        placement = Placement.of(device, size, moved)
        if affine is not None and device.plane == "aperture":
            placement = Placement.by(affine, placement.device, size)
        shown.append((device, plane, placement))
        _warn_of_small_codes(codes, device, placement)
    return _written(codes, shown, Path(out), codes.exposure or EXPOSURE if exposure is None else exposure)


def _check_asked(devices: Sequence[DeviceDescription], code_size: Size | None, sensor_size: Size | None) -> None:
    """Raises SettingError for sizes below a pixel, or for no device or two of one plane."""
    for name, asked in (("--code-size", code_size), ("--sensor-size", sensor_size)):
        if asked is not None and min(asked) < 1:
            raise SettingError(name, f"{asked[0]}x{asked[1]}", "HEIGHTxWIDTH of one pixel or more")
    planes = [device.plane for device in devices]
    if not planes or len(set(planes)) < len(planes):
        named = f"{len(planes)} of them, for {', '.join(planes) or 'nothing'}"
        raise SettingError("--device", named, "one device for each plane that is shown")


def _warn_of_small_codes(codes: Planes, device: DeviceDescription, placement: Placement) -> None:
    """Of a snapshot or weights the camera says the size; a file of codes alone may hold a tile that does not say so."""
    if placement.share >= LITTLE or codes.settings is not None or device.plane in codes.tiled:
        return
    rows, columns = placement.code
    fill = f"{rows}×{columns} code pixels fill {100 * placement.share:.3g}% of {device.name}"
    tile = f"a tile that repeats needs the attribute period: [{rows}, {columns}] (docs/devices.md)"
    warn(f"{codes.source}: {fill}; {tile}", CodesWarning, stacklevel=3)


def export_like(
    codes: Planes, placed: Mapping[str, tuple[DeviceDescription, Placement]], out: str | Path, slot: float
) -> Export:
    """Write other codes for the devices of an export, placed as its own are; see ``export_codes``.

    What is in the folder's place is replaced. Codes have the sizes of the placements, a slot lasts so many seconds.
    """
    check_free(Path(out), overwrite=True)
    shown: list[_Shown] = [(device, codes.full(plane).numpy(), place) for plane, (device, place) in placed.items()]
    return _written(codes, shown, Path(out), codes.slots * slot)


_Shown = tuple[DeviceDescription, NDArray[np.float32] | None, Placement | None]
"""A device, (K, H, W) what it shows, and where; a mirror shows terms."""


def _written(codes: Planes, shown: Sequence[_Shown], folder: Path, exposure: float) -> Export:
    """The folder of an export, whole or not at all; of a link, the place that it leads to."""
    for device, _, _ in shown:
        _check_rate(device, codes.slots, exposure)
    place = folder.resolve()
    make_folder(place.parent)
    with atomic_path(place, overwrite=True) as temporary:
        temporary.mkdir()
        manifest = _manifest(codes, exposure, [_plane(codes, *one, exposure, temporary) for one in shown])
        write_json(manifest, temporary / NAME)
        manifest = read_manifest(temporary)  # drivers get the same types whether it was read or written
    return Export(folder, manifest)


def _check_rate(device: DeviceDescription, slots: int, exposure: float) -> None:
    """Raises SettingError where a device is too slow, or holds too few patterns."""
    check_range("--exposure", exposure, above=0, unit="s")
    rate, most = slots / exposure, device.pattern_rate_hz
    if most is not None and rate > most * (1 + 1e-9):
        found = f"{slots} slots in {exposure:g} s, {rate:g} patterns a second"
        remedy = f"expose {slots / most:g} s or longer, or take fewer slots"
        raise SettingError("--exposure", found, f"{most:g} at most on {device.name}", remedy)
    if device.memory_patterns is not None and slots > device.memory_patterns:
        raise SettingError(device.name, f"{slots} patterns", f"{device.memory_patterns} at most in its memory")


def _plane(
    codes: Planes,
    device: DeviceDescription,
    plane: NDArray[np.float32] | None,
    placement: Placement | None,
    exposure: float,
    folder: Path,
) -> dict[str, Any]:
    """Files of one device, and what the manifest says of them."""
    place = folder / device.plane
    place.mkdir()
    about: dict[str, Any] = {"plane": device.plane, "device": device.model_dump(), **_response(device, place)}
    if plane is None or placement is None:
        return about | _mirror(codes, device, exposure, place)
    check_buckets(codes, device)
    frames = placement.shown(_levels(plane, device, codes.source))
    files = [write_frame(place / f"{device.plane}_{k:03d}.png", frame, device.bits) for k, frame in enumerate(frames)]
    return about | {
        "placement": vars(placement),
        "units": _units(device),
        "frames": _timed(files, device, exposure),
        "codes_sha256": digest(plane),
    }


def _timed(files: Sequence[Path], device: DeviceDescription, exposure: float) -> list[dict[str, Any]]:
    """What the manifest says of the files of one plane, in the order of the slots; seconds from the trigger."""
    each = exposure / len(files)
    return [
        {"slot": slot, "file": f"{file.parent.name}/{file.name}", "start_s": slot * each, "duration_s": each,
         "trigger": _TRIGGERS[device.kind], "sha256": checksum_of(file)}
        for slot, file in enumerate(files)
    ]  # fmt: skip


def _units(device: DeviceDescription) -> str:
    """What the numbers in a device's frames mean."""
    if device.buckets == 1:
        return "grey level" if device.kind == "lcos" else f"{device.top} = open"
    names = ["drain" if bucket is None else f"bucket {bucket + 1}" for bucket in device.places]
    return ", ".join(f"{number} = {name}" for number, name in enumerate(names))


def _response(device: DeviceDescription, place: Path) -> dict[str, Any]:
    """The table of a display's response beside its frames, without which they cannot be read."""
    if device.lut is None:
        return {}
    response(device)
    shutil.copyfile(device.lut, place / RESPONSE)
    name = f"{place.name}/{RESPONSE}"
    return {"device": device.model_dump() | {"lut": name}, "response_sha256": checksum_of(place / RESPONSE)}


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
    frames = plane * device.top if device.buckets == 1 else numbers_of(plane, device)
    _check_tile(frames, device, source)
    return frames.astype(np.uint16)


def _check_tile(frames: NDArray[np.generic], device: DeviceDescription, source: str) -> None:
    """Raises SettingError for codes that do not repeat as a device that holds one tile of them does."""
    if device.tile is None or all(_repeats(frames, axis, side) for axis, side in enumerate(device.tile, 1)):
        return
    rows, columns = device.tile
    expected = f"one that repeats every {rows}×{columns}, the tile of {device.name}"
    own = f"--period {rows}" if rows == columns else "such a tile from a file (--codes, docs/devices.md)"
    found = f"a {device.plane} that {_said_period(frames)}"
    raise SettingError(source, found, expected, f"take codes with {own}, or another device")


def _repeats(frames: NDArray[np.generic], axis: int, every: int) -> bool:
    lines = np.moveaxis(frames, axis, 0)
    return np.array_equal(lines[every:], lines[:-every])


def _said_period(frames: NDArray[np.generic]) -> str:
    sizes = enumerate(frames.shape[1:], 1)
    periods = [next((n for n in range(1, size) if _repeats(frames, axis, n)), 0) for axis, size in sizes]
    return f"repeats every {periods[0]}×{periods[1]} pixels" if all(periods) else "does not repeat"


def _mirror(codes: Planes, device: DeviceDescription, exposure: float, place: Path) -> dict[str, Any]:
    terms = terms_of(codes, device)
    file = place / TABLE
    file.write_text(table(terms), encoding="utf-8")
    return {
        "units": "micrometres of surface, root mean square over the pupil; larger = deeper (longer path)",
        "frames": _timed([file] * len(terms.rms), device, exposure),
        "residual_rms_nm": (terms.residual * 1e9).round(4).tolist(),
        "peak_to_valley_um": (terms.peak_to_valley() * 1e6).round(6).tolist(),
        "codes_sha256": digest(np.round(terms.rms * 1e6, 9)),
    }


def _manifest(codes: Planes, exposure: float, planes: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "format": FORMAT, "tmca": tmca.__version__, "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "source": codes.source, "camera": codes.application, "settings": dict(codes.settings or {}),
        **({SOURCE_AT: str(Path(codes.source).absolute())} if Path(codes.source).exists() else {}),
        CODES_DATE: date_of_codes([codes.source]) if Path(codes.source).exists() else now(),
        "slots": codes.slots, "exposure_s": exposure, "planes": planes,
    }  # fmt: skip


def export_figure(manifest: dict[str, Any], folder: Path) -> Figure:
    """The first slots of every plane of an export: frames as devices show them, Zernike terms as bars."""
    from tmca.plots.lab import shown_figure

    slots = range(min(_SLOTS, manifest["slots"]))
    names = ["\n".join((plane["plane"], plane["device"]["name"], scale_of(plane))) for plane in manifest["planes"]]
    pictures = [[_picture(plane, slot, folder) for slot in slots] for plane in manifest["planes"]]
    return shown_figure(dict(zip(names, pictures, strict=True)))


def scale_of(plane: dict[str, Any]) -> str:
    """How many pixels of its device show a code pixel; empty for a mirror's shapes."""
    if "placement" not in plane:
        return ""
    side, kind = plane["placement"]["macro_pixel"], plane["device"]["kind"]
    return f"1 code pixel = {side:.3g}×{side:.3g} {'mirrors' if kind == 'dmd' else 'pixels'}"


def _picture(plane: dict[str, Any], slot: int, folder: Path) -> tuple[str, np.ndarray, Sequence[int] | None]:
    """Title of a slot, its frame or Zernike terms, and their Noll indices."""
    frame = plane["frames"][slot]
    title, file = f"slot {slot}, from {frame['start_s'] * 1e3:g} ms", folder / frame["file"]
    if "placement" in plane:
        return title, read_frame(file), None
    terms = read_table(file)
    return title, terms.rms[slot], terms.noll
