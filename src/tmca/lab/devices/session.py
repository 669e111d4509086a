"""A capture: every frame of an export on a bench, kept as soon as it is there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.cameras import Camera
from tmca.errors import DeviceError, SettingError
from tmca.lab.devices.captures import DARK, WHOLE, Step, going_on, keep, kept_so_far, steps
from tmca.lab.devices.export import Export
from tmca.lab.devices.frame_checks import FrameChecks
from tmca.lab.devices.frame_sources import SOURCE, Sources, sources_of, still_current
from tmca.lab.devices.joining import check_camera
from tmca.lab.devices.manifest import exposed_whole
from tmca.lab.devices.protocol import Device, Named, Recorded, saturation_of, units_of
from tmca.lab.devices.reading import check_export
from tmca.lab.devices.simulated import SimulatedBench
from tmca.lab.devices.time_limit import Calls, time_limit

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
        DataError: an export or a kept frame that was changed, a saturated or a dark capture, another camera's codes, a
            frame that repeats another value by value, files that are not the frames that are wanted.
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
        wanted, sources = _recorded(calls, wanted)
        kept = still_current(kept, sources, folder) if sources else kept
        checks = FrameChecks(folder, camera, saturation, noisy=not isinstance(device, SimulatedBench))
        checks.known(kept["frames"])
        for done, step in enumerate(wanted):
            if step.name not in kept["frames"]:
                frame = frame_of(calls, step.slot, step.of == WHOLE, step.name)
                checks.check(frame, step)
                keep(frame, step, kept, folder, {SOURCE: sources[step.name]} if sources else None)
            if progress:
                progress(done + 1, len(wanted), step.name)
    checks.remark()
    return folder


def _recorded(calls: Calls, wanted: list[Step]) -> tuple[list[Step], Sources]:
    """Frames that are wanted, and the files of those that were taken before, with further dark ones among them."""
    device, names = calls.device, [step.name for step in wanted]
    if not isinstance(device, Recorded):
        return wanted, {}
    recorded = device
    files = calls.of(lambda: recorded.files_of_frames(names))
    return wanted + [Step(name, None, DARK) for name in files if name not in names], sources_of(files)


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
