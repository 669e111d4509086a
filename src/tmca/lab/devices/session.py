"""A capture: every frame of an export on a bench, kept as soon as it is there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.cameras import Camera
from tmca.errors import DataError, DeviceError, SettingError
from tmca.lab.devices.captures import DARK, WHOLE, Step, going_on, keep, kept_so_far, read_tif, steps
from tmca.lab.devices.export import Export
from tmca.lab.devices.joining import check_camera
from tmca.lab.devices.manifest import exposed_whole
from tmca.lab.devices.protocol import Device, Named, saturation_of, units_of
from tmca.lab.devices.reading import check_export
from tmca.lab.devices.simulated import SimulatedBench
from tmca.lab.devices.time_limit import Calls, time_limit

_SATURATED, _DARK = 0.5, 3.0
"""Share of saturated pixels, and mean above the dark frame in its standard deviations, that are refused."""
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
) -> Path:
    """Capture every frame of an export; what is there already stays.

    Writes ``dark.tif``, ``slot_NNN.tif`` or ``exposure.tif`` (16 bits), repeats as ``…_r1.tif`` and so on, and
    ``captures.json`` with their checksums.

    Args:
        export: its folder.
        device: the bench.
        out: folder of the capture; a capture that was stopped goes on there.
        gain: snapshot units of a digital number, for files; None for those of the bench (``units_of``), which needs the
            camera.
        repeats: times that every frame is captured; more of them later add to those that are there.
        camera: as it is known; where it is given, other codes and frames of another size are refused at once.
        bench: what frames depend on beside the export (driver, its settings, scene), as JSON values; kept with them.
        timeout: seconds that a driver has for each of its answers, which then run in a thread of their own; 0 for as
            long as it takes; 30 s or three exposures, whichever is longer, without. A simulated bench has no limit.
        progress: told (frames done, all, name).

    Raises:
        DeviceError: the bench does not answer, not in time, or with something that is no frame; frames so far are kept.
        DataError: an export or a kept frame that was changed, a saturated or a dark capture, another camera's codes.
        OutputError: the folder holds something else, or frames of another bench, gain or saturation.
        SettingError: no repeat, or a time below 0.
    """
    if repeats < 1:
        raise SettingError("--repeat", str(repeats), "1 or more")
    manifest, folder = check_export(export), Path(out)
    if camera is not None:
        check_camera(export, camera)
    wanted = steps(manifest, repeats)
    with calls_of(device, manifest, timeout) as calls:
        saturation = calls.of(lambda: saturation_of(device))
        units = calls.of(lambda: _units(device, camera, manifest)) if gain is None else gain
        about = {"gain": units, "saturation": saturation, **(bench or {})}
        kept = going_on(kept_so_far(folder, export), about, folder)
        calls.of(lambda: device.load(Export(Path(export), manifest)))
        for done, step in enumerate(wanted):
            if step.name not in kept["frames"]:
                frame = frame_of(calls, step.slot, step.of == WHOLE, step.name)
                _check_size(frame, step, folder, camera)
                _check_light(frame, step, saturation, folder)
                keep(frame, step, kept, folder)
            if progress:
                progress(done + 1, len(wanted), step.name)
    return folder


def _units(device: Device, camera: Camera | None, manifest: dict[str, Any]) -> float:
    if camera is None:
        raise SettingError("gain", "None", "snapshot units of a digital number where no camera is known")
    return units_of(device, camera.full_scale if exposed_whole(manifest) else camera.white)


def calls_of(device: Device, manifest: dict[str, Any], timeout: float | None) -> Calls:
    """A context of calls of a bench; a simulated one takes as long as it computes."""
    return Calls(device, None if isinstance(device, SimulatedBench) else time_limit(manifest, timeout))


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
    found: NDArray[Any] = calls.of(lambda: np.asarray(device.capture(whole=whole)))
    whole_numbers = np.issubdtype(found.dtype, np.integer)
    if not whole_numbers or found.ndim not in (2, 3) or found.size == 0 or found.min() < 0 or found.max() > 65535:
        said = f"{found.dtype} values of shape {found.shape}"
        said += f", {found.min()} to {found.max()}" if whole_numbers and found.size else ""
        name = type(device).__name__
        raise DeviceError(f"device {name}", said, "(H, W) or (C, H, W) whole numbers, 0 to 65535", "mend its driver")
    return found


def _check_size(frame: NDArray[np.integer], step: Step, folder: Path, camera: Camera | None) -> None:
    wanted = tuple(frame.shape) if step.name == DARK else tuple(read_tif(folder / f"{DARK}.tif").shape)
    if camera is not None:
        shape = camera.snapshot_shape
        wanted = shape if frame.ndim == 3 or shape[0] > 1 else shape[1:]
    if tuple(frame.shape) != wanted:
        found, known = ("×".join(map(str, size)) for size in (frame.shape, wanted))
        raise DataError(folder / step.name, f"a frame of {found}", f"{known} pixels", "set the sensor's region to that")


def _check_light(frame: NDArray[np.integer], step: Step, saturation: float, folder: Path) -> None:
    check_saturated(frame, saturation, folder / step.name)
    if step.of == DARK:
        return
    dark = read_tif(folder / f"{DARK}.tif").astype(np.float64)
    above = float(frame.mean() - dark.mean())
    if above <= _DARK * float(dark.std()) / np.sqrt(frame.size):
        found = f"a frame {above:.3g} digital numbers above the dark one"
        raise DataError(folder / step.name, found, "light", "check lamp, shutter and lens cap")


def check_saturated(frame: NDArray[np.integer], saturation: float, where: Path) -> None:
    """Raises DataError where more than half of a frame's pixels are saturated."""
    share = float((frame >= saturation).mean())
    if share > _SATURATED:
        remedy = "open the aperture of the lens less, or expose shorter"
        raise DataError(where, f"{share:.0%} saturated pixels", f"{_SATURATED:.0%} at most", remedy)
