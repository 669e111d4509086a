"""Frames for a step of a calibration, taken by a bench and kept as soon as they are there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from tmca.cameras import Camera, SpectralCamera
from tmca.data import metres_to_nm
from tmca.errors import DataError, SettingError
from tmca.lab.calibrating.shots import Asked, Shot, lights_of, shots_of
from tmca.lab.calibrating.shown import ShownCodes
from tmca.lab.calibration.captures import RED_WIDER
from tmca.lab.calibration.measurements.dispersion import spreads_red_wider
from tmca.lab.devices.captures import going_on, keep, kept_so_far
from tmca.lab.devices.frame_checks import check_saturated
from tmca.lab.devices.joining import check_camera
from tmca.lab.devices.light import Lamp
from tmca.lab.devices.protocol import Device, Recorded, saturation_of
from tmca.lab.devices.reading import check_export
from tmca.lab.devices.session import calls_of, frame_of
from tmca.lab.devices.time_limit import Calls

Progress = Callable[[int, int, str], None]


def capture_step(
    step: str,
    export: str | Path,
    device: Device,
    out: str | Path,
    camera: Camera,
    asked: Asked | None = None,
    *,
    bench: Mapping[str, Any] | None = None,
    timeout: float | None = None,
    progress: Progress | None = None,
) -> Path:
    """Capture the frames of a step into ``OUT/STEP``, 16-bit TIFF named as `tmca calibrate` reads them.

    What is there already stays. The codes that are shown lie on the devices as those of the export do, so that a
    registration holds for them; ``OUT/patterns`` keeps the patterns as pictures.

    Args:
        step: of ``steps_of``.
        export: folder of `tmca export` with the codes that are to be captured afterwards.
        device: the bench; one that is a ``Lamp`` is told the light of every frame.
        out: folder of all steps.
        camera: whose codes were exported.
        asked: how many frames and which light.
        bench: what frames depend on beside the export, as JSON values; kept with them.
        timeout: see `tmca.lab.devices.capture`.
        progress: told (frames done, all, name).

    Returns:
        The folder of the step.

    Raises:
        SettingError: a step that this camera does not have, several lights before a bench that sets none, or frames
            that were taken before in the place of a bench.
        DeviceError: the bench does not answer; frames so far are kept.
        DataError: another camera's export, or saturated frames of a step that may have none.
        OutputError: the folder holds something else, or frames of another bench.
    """
    how = asked or Asked()
    if isinstance(device, Recorded):
        refuse_recorded(type(device).__name__)
    manifest = check_export(export)
    check_camera(export, camera)
    shots = shots_of(step, camera, manifest, how)
    lights = lights_of(shots)
    if len(lights) > 1 and not isinstance(device, Lamp):
        remedy = "take them one after the other (--wavelength), or give the driver illuminate(light)"
        raise SettingError(f"frames of {step}", f"{len(lights)} lights", "one, where the bench sets none", remedy)
    shown, folder = ShownCodes(export, Path(out), how), Path(out) / step
    loaded = ""
    with calls_of(device, manifest, timeout) as calls:
        saturation = calls.of(lambda: saturation_of(device))
        about = {"saturation": saturation, "gain": 1.0, **(bench or {}), **told(step, how, camera)}
        kept = going_on(kept_so_far(folder, export), about, folder)
        for done, shot in enumerate(shots):
            if shot.name not in kept["frames"]:
                loaded = _loaded(calls, shot, shown, loaded)
                keep(_frame(calls, shot, folder, step, camera.snapshot_shape), shot.step, kept, folder)
            if progress:
                progress(done + 1, len(shots), shot.name)
    return folder


def refuse_recorded(name: str) -> NoReturn:
    """Raises SettingError for frames of other software in the place of a bench."""
    found = f"{name}, frames that were taken before"
    remedy = "name other frames as docs/calibration.md says, and measure their folder: tmca calibrate STEP FOLDER"
    raise SettingError("--device", found, "simulated or a driver, which takes the frames of a calibration", remedy)


def told(step: str, asked: Asked, camera: Camera) -> dict[str, Any]:
    """What measuring a step has to know of its frames."""
    if step == "white":
        return {"reflectance": asked.reflectance}
    if step == "registration" and asked.wavelengths:
        return {"wavelength_nm": round(float(metres_to_nm(asked.wavelengths[0])), 6)}
    found: dict[str, Any] = {"pattern": asked.pattern} if step in ("dispersion", "shear") else {}
    if step == "dispersion" and isinstance(camera, SpectralCamera):
        drawn = spreads_red_wider(camera.wavelengths, camera.dispersion.displacement)
        found |= {RED_WIDER: True} if drawn else {}
    return found


def _loaded(calls: Calls, shot: Shot, shown: ShownCodes, loaded: str) -> str:
    """Codes and light as a frame wants them."""
    device = calls.device
    if shot.shown != loaded:
        export = shown.export(shot.shown)
        calls.of(lambda: device.load(export))
    if isinstance(device, Lamp):
        lamp = device
        calls.of(lambda: lamp.illuminate(shot.light))
    return shot.shown


def _frame(calls: Calls, shot: Shot, folder: Path, step: str, shape: tuple[int, ...]) -> Any:
    """(H, W); of a sensor with channels their mean, as `tmca calibrate` reads colours."""
    frame = frame_of(calls, shot.slot, shot.whole, f"{step}/{shot.name}")
    if tuple(frame.shape[-2:]) != tuple(shape[1:]) or frame.ndim != (2 if shape[0] == 1 else 3):
        found, known = ("×".join(map(str, one)) for one in (frame.shape, shape if shape[0] > 1 else shape[1:]))
        raise DataError(folder / shot.name, f"a frame of {found}", f"{known} pixels", "set the sensor's region to that")
    if step != "linearity":
        check_saturated(frame, calls.of(lambda: saturation_of(calls.device)), folder / shot.name)
    return frame if frame.ndim == 2 else np.rint(frame.mean(0)).astype(np.uint16)
