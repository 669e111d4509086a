"""A capture: every frame of an export on a bench, kept as soon as it is there, and joined to a snapshot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from tmca.cameras import Camera, Snapshot
from tmca.data import checksum_of, read_array
from tmca.errors import DataError, DeviceError, SettingError, check_range
from tmca.lab.acquisition.captures import (
    DARK,
    SOURCE,
    WHOLE,
    CaptureFrame,
    captured_so_far,
    check_frame,
    frames_of,
    in_use,
    is_of,
    keep,
    read_captures,
    resumed,
)
from tmca.lab.acquisition.drivers import Calls, Device, Named, Recorded, number_of, time_limit
from tmca.lab.acquisition.simulated import SimulatedBench
from tmca.lab.display.codes import Planes, planes_of, terms_of
from tmca.lab.display.devices import DeviceDescription, step_of
from tmca.lab.display.export import Export
from tmca.lab.display.manifest import buckets_of, check_export, device_of, exposed_whole, read_export, read_manifest
from tmca.lab.frames import check_size
from tmca.lab.notes import AVERAGED, CODES_DATE, DRIVER, GAIN, SATURATED, WHITE
from tmca.lab.quality import warn_of_saturation
from tmca.sensor import Sensor

_SAME_SURFACE = 1e-10
"""Metres by which Zernike terms of the same masks may differ."""
Progress = Callable[[int, int, str], None]


def capture(
    export: str | Path,
    device: Device,
    out: str | Path,
    *,
    gain: float | None = 1.0,
    repeats: int = 1,
    camera: Camera | None = None,
    bench: Mapping[str, Any] | None = None,
    timeout: float | None = None,
    progress: Progress | None = None,
    finish: Callable[[], None] | None = None,
) -> Path:
    """Capture every frame of an export; what is there already stays, but of frames that are files.

    Writes ``dark.tif``, ``slot_NNN.tif`` or ``exposure.tif`` (16 bits), repeats as ``…_r1.tif`` and so on, and
    ``captures.json`` with their checksums.

    Args:
        export: its folder.
        device: the bench.
        out: folder of the capture; a capture that was stopped goes on there.
        gain: snapshot units of a digital number, for files; None for those of the bench, which needs the camera.
        repeats: times that every frame is captured; more of them later add to those that are there.
        camera: as it is known; where it is given, other codes and frames of another size are refused at once.
        bench: what frames depend on beside the export (driver, its settings, scene), as JSON values; kept with them.
        timeout: seconds that a driver has for each of its answers, which then run in a thread of their own; 0 for as
            long as it takes; 30 s or three exposures, whichever is longer, without. A simulated bench has no limit.
        progress: called with (frames done, all, name), the name with ``(cached)`` of one that was there.
        finish: called when all frames are there, while other processes are still kept out of the folder.

    Raises:
        DeviceError: the bench does not answer, not in time, or with something that is no frame; frames so far are kept.
        DataError: an export or a kept frame that was changed, a saturated capture, another camera's codes, files that
            are not the frames that are wanted.
        OutputError: the folder holds something else, or frames of another bench, gain or saturation, or another
            process captures into it.
        SettingError: no repeat, or a time below 0.
    """
    check_range("--repeat", repeats, 1, whole=True)
    manifest, folder = check_export(export), Path(out)
    if camera is not None:
        check_camera(export, camera)
    wanted = frames_of(manifest, repeats)
    files: Mapping[str, Path] = {}
    with in_use(folder), calls_of(device, manifest, timeout) as calls:
        saturation = calls.of(lambda: number_of(device, "saturation"))
        units = calls.of(lambda: units_of(device, camera, manifest, saturation)) if gain is None else gain
        about = {"gain": units, "saturation": saturation, **(bench or {})}
        record = resumed(captured_so_far(folder, export), about, folder)
        calls.of(lambda: device.load(Export(Path(export), manifest)))
        if isinstance(device, Recorded):
            names = [frame.name for frame in wanted]
            files, record["frames"] = calls.of(partial(device.files_of_frames, names)), {}
            wanted += [CaptureFrame(name, None, DARK) for name in files if name not in names]
        size = None if camera is None else tuple(camera.snapshot_shape)
        _take(calls, wanted, files, record, folder, size, saturation, progress)
        if finish:
            finish()
    return folder


def _take(
    calls: Calls, wanted: list[CaptureFrame], files: Mapping[str, Path], record: dict[str, Any], folder: Path,
    size: tuple[int, ...] | None, saturation: float, progress: Progress | None,
) -> None:  # fmt: skip
    """Keep the frames that are not there yet; of those that are ``files`` none before all of them are checked."""
    places = {frame.name: files.get(frame.name, folder / frame.name) for frame in wanted}
    for frame in wanted if files else ():
        _, size = checked_frame(calls, frame, places[frame.name], size, saturation)
    for done, frame in enumerate(wanted, 1):
        cached = frame.name in record["frames"]
        if not cached:
            values, size = checked_frame(calls, frame, places[frame.name], size, saturation)
            file = files.get(frame.name)
            source = {} if file is None else {SOURCE: {"file": file.name, "sha256": checksum_of(file)}}
            keep(values, frame, record, folder, source)
        if progress:
            progress(done, len(wanted), f"{frame.name} (cached)" if cached else frame.name)


def units_of(device: Device, camera: Camera | None, manifest: dict[str, Any], saturation: float) -> float:
    """Snapshot units of a digital number: what the driver says, else those by which saturation is white."""
    if camera is None:
        raise SettingError("gain", "None", "snapshot units of a digital number where no camera is known")
    white = camera.full_scale if exposed_whole(manifest) else camera.white
    return number_of(device, "snapshot_units_per_dn", white / saturation)


def calls_of(device: Device, manifest: dict[str, Any], timeout: float | None) -> Calls:
    """A context of calls of a bench; a simulated one takes as long as it computes."""
    return Calls(device, None if isinstance(device, SimulatedBench) else time_limit(manifest, timeout))


def checked_frame(
    calls: Calls, frame: CaptureFrame, where: Path, size: tuple[int, ...] | None, saturation: float
) -> tuple[NDArray[np.integer], tuple[int, ...]]:
    """Digital numbers of a frame, and its size (C, H, W): this one where it is given.

    Raises:
        DeviceError, DataError: as ``frame_of`` and ``check_frame``.
    """
    values = frame_of(calls, frame.slot, frame.of == WHOLE, frame.name)
    size = size or (values.shape if values.ndim == 3 else (1, *values.shape))
    check_frame(values, where, size, saturation)
    return values, size


def frame_of(calls: Calls, slot: int | None, whole: bool, name: str) -> NDArray[np.integer]:
    """(H, W) or (C, H, W) digital numbers of a slot, or of a whole exposure, and its name for benches that ask for it.

    Raises:
        DeviceError: no answer, or something that is no frame.
    """
    device = calls.device
    if isinstance(device, Named):
        named = device
        calls.of(lambda: named.name_frame(name))
    calls.of(lambda: device.show(slot))
    values: NDArray[Any] = calls.of(lambda: np.asarray(device.capture(whole=whole)))
    whole_numbers = np.issubdtype(values.dtype, np.integer)
    if not whole_numbers or values.ndim not in (2, 3) or values.size == 0 or values.min() < 0 or values.max() > 65535:
        said = f"{values.dtype} values of shape {values.shape}"
        said += f", {values.min()} to {values.max()}" if whole_numbers and values.size else ""
        name = type(device).__name__
        raise DeviceError(f"device {name}", said, "(H, W) or (C, H, W) whole numbers, 0 to 65535", "mend its driver")
    return values


def joined(folder: str | Path, export: str | Path, camera: Camera) -> Snapshot[Any]:
    """The snapshot of a capture: frames less the dark one, masked by the shutter's codes and averaged.

    Repeats of a frame are averaged first. A shutter that was not exported is that of the camera. The share of pixels
    that saturate in any frame is a note: behind the dark frame and the mask nobody can tell.

    Args:
        folder: of the capture.
        export: that was captured.
        camera: as it is known.

    Raises:
        DataError: frames that are missing or changed, of another size than the camera's, or of another export; codes
            that are not the camera's.

    Warns:
        Doubtful: saturated pixels.
    """
    record, place = read_captures(folder), Path(folder)
    if not is_of(record, export):
        raise DataError(folder, f"a capture of {record['export']}", f"one of {export}", "name the export it is of")
    check_camera(export, camera)
    manifest, how = read_manifest(export), record["taken_with"]
    wanted = frames_of(manifest)
    if missing := [frame.name for frame in wanted if frame.name not in record["frames"]]:
        raise DataError(folder, f"no frame {', '.join(missing[:3])}", "all of the export", "go on with `tmca capture`")
    series = _series(place, record, camera)
    reached = torch.stack([(frames >= float(how["saturation"])).any(1).any(0) for frames in series.values()]).any(0)
    names = [frame.name for frame in wanted if frame.of != DARK]
    opened = opened_of(export, camera)
    values = _light([series[name] for name in names], series[DARK], opened, float(how["gain"]), camera)
    repeats = torch.tensor([float(len(series[name])) for name in names])
    alike = _repeats(repeats, opened)
    camera = with_noise(camera, float(how["gain"]) * read_noise(series[DARK], repeats, opened, camera), alike)
    about: dict[str, Any] = {"device": ", ".join(plane["device"]["name"] for plane in manifest["planes"])}
    about |= {"capture": str(folder), "export": str(export), DRIVER: how.get(DRIVER, "")}
    share = float(reached.double().mean())
    warn_of_saturation(folder, share, "what they say is wrong; expose for less time")
    about |= {SATURATED: share, **notes_of_frames(manifest, camera, how["gain"], alike)}
    return Snapshot(values[None].float(), camera, about)


def notes_of_frames(manifest: dict[str, Any], camera: Camera, gain: float, repeats: float = 1.0) -> dict[str, Any]:
    """What a calibration has to know of frames that were joined: their units, how many of them a pixel averages, and
    the date of the codes."""
    whole = exposed_whole(manifest)
    each = 1 if whole or camera.exposure == "per-slot" else camera.slots
    notes = {GAIN: gain, WHITE: camera.full_scale if whole else camera.white, AVERAGED: repeats * each}
    return notes | ({CODES_DATE: manifest[CODES_DATE]} if CODES_DATE in manifest else {})


def _series(folder: Path, record: dict[str, Any], camera: Camera) -> dict[str, torch.Tensor]:
    """(R, C, H, W) digital numbers of every frame, with its repeats."""
    series: dict[str, list[torch.Tensor]] = {}
    for name, about in record["frames"].items():
        values = read_array(folder / f"{name}.tif").astype(np.float64)
        values = values[None] if values.ndim == 2 else values
        check_size(folder / f"{name}.tif", "a frame", values.shape, camera.snapshot_shape)
        series.setdefault(about["of"], []).append(torch.from_numpy(values))
    return {of: torch.stack(frames) for of, frames in series.items()}


def _light(
    frames: list[torch.Tensor], dark: torch.Tensor, opened: torch.Tensor, gain: float, camera: Camera
) -> torch.Tensor:
    """(C, H, W) of an exposure, in snapshot units: of its frames through the shutter, each a mean of its repeats."""
    black = dark.mean(0)
    light = torch.stack([repeats.mean(0) - black for repeats in frames]) * gain
    light = light * opened.to(light)[:, None]
    return light.sum(0) if camera.exposure == "per-slot" else light.mean(0)


def _repeats(taken: torch.Tensor, opened: torch.Tensor) -> float:
    """Of every slot alike, that leave as much shot noise of even light as those that were taken of each; whole numbers
    where all are alike, else less than their mean."""
    left = (opened / taken[:, None, None]).sum()
    return float(taken[0]) if bool((taken == taken[0]).all()) or not left else float(opened.sum() / left)


def read_noise(darks: torch.Tensor, repeats: torch.Tensor, opened: torch.Tensor, camera: Camera) -> float:
    """Root mean square over the pixels of what reading leaves in a joined snapshot, digital numbers.

    Frames of the open slots k, each the mean of R_k repeats, less for each the mean of D dark ones, n times in all:
    ``σ² (Σ 1 / R_k + n² / D)``, over K² where they are averaged.
    """
    opened = opened.to(darks)
    share = ((opened / repeats.to(darks)[:, None, None]).sum(0) + opened.sum(0) ** 2 / len(darks)).mean()
    over = 1 if camera.exposure == "per-slot" else len(opened)
    return float((darks.var(0).mean() * share).sqrt()) / over


def with_noise(camera: Camera, read: float, repeats: float) -> Camera:
    """The camera, whose sensor reads with this noise in snapshot units, and collects the light of all repeats."""
    settings: dict[str, Any] = {**camera.sensor.settings(), "read_noise": read, "read_noise_electrons": 0.0}
    if settings["full_well"] is not None:
        settings["full_well"] *= repeats
    return camera.replace(sensor=Sensor(**settings))


def opened_of(export: str | Path, camera: Camera) -> torch.Tensor:
    """(K, H, W) the shutter by which frames of slots are masked; (1, H, W) ones of a whole exposure."""
    if exposed_whole(read_manifest(export)):
        return torch.ones(1, *camera.snapshot_shape[1:])
    shown = read_export(export)
    codes = shown if "shutter" in shown.planes else planes_of(camera, str(export))
    return codes.full("shutter", camera.snapshot_shape[1:])


def check_camera(export: str | Path, camera: Camera) -> None:
    """Raises DataError unless an export shows the codes of a camera: else its snapshot would name codes that were not
    shown."""
    shown, expected = read_export(export), planes_of(camera, str(export))
    described = {plane["plane"]: plane for plane in read_manifest(export)["planes"]}
    remedy = "name a snapshot of the camera with these codes (--like)"
    if shown.slots != camera.slots:
        raise DataError(export, f"{shown.slots} slots", f"the camera's {camera.slots}", remedy)
    if (seen := buckets_of(read_manifest(export))) != camera.buckets:
        own = "export to a device that has them, such as coded-exposure-two-bucket"
        raise DataError(export, f"buckets of a sensor: {seen}", f"the camera's {camera.buckets}", own)
    for name, plane in expected.planes.items():
        if name in described:
            _check_plane(export, name, device_of(described[name], export), shown, expected, remedy)
        elif name != "shutter" and not torch.equal(plane, plane[:1].expand_as(plane)):
            raise DataError(export, f"no {name}", "one, which changes from slot to slot", "export it to a device too")


def _check_plane(
    export: str | Path, name: str, device: DeviceDescription, shown: Planes, expected: Planes, remedy: str
) -> None:
    if device.kind == "deformable-mirror":
        assert shown.modes is not None
        codes, wanted = shown.modes["coefficients"], torch.from_numpy(terms_of(expected, device).rms).float()
        allowed = _SAME_SURFACE
    else:
        codes, wanted = shown.planes[name], expected.planes[name]
        allowed = step_of(device) if device.kind == "lcos" else 0.0
    if codes.shape != wanted.shape:
        size = f"{name} of {tuple(codes.shape)}"
        raise DataError(export, size, f"the camera's {tuple(wanted.shape)}", f"export it for that size, or {remedy}")
    if float((codes - wanted).abs().max()) > allowed:
        raise DataError(export, f"other codes in the {name}", "those of the camera", remedy)
