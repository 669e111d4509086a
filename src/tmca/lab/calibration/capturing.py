"""Frames that the steps of a calibration need, taken by a bench and kept as soon as they are there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tmca.cameras import Camera
from tmca.data import make_folder, metres_to_nm
from tmca.errors import DataError, OutputError, SettingError, check_choice
from tmca.lab.acquisition.captures import captured_so_far, check_frame, in_use, keep, resumed
from tmca.lab.acquisition.drivers import Device, Lamp, Recorded, number_of
from tmca.lab.acquisition.session import Progress, calls_of, check_camera, frame_of
from tmca.lab.calibration.captures import calibration_patterns, read_patterns, write_patterns
from tmca.lab.calibration.fits import DRAWN
from tmca.lab.calibration.shots import BUCKET, CODES, IN_TURN, OPEN, PATTERNS, Asked, Shot, pair_name
from tmca.lab.calibration.steps import step_of, steps_of, why_without
from tmca.lab.cameras import lab_camera
from tmca.lab.display.codes import Planes, by_slot
from tmca.lab.display.export import Export, export_like
from tmca.lab.display.manifest import buckets_of, check_export, device_of, placement_of, read_manifest


def shots_of(step: str, camera: Camera, manifest: dict[str, Any], asked: Asked) -> list[Shot]:
    """Frames of a step, named as `tmca calibrate` knows them.

    Raises:
        SettingError: a step that this camera does not have, or needs a wavelength.
    """
    steps = steps_of(camera, manifest)
    if step not in steps and (why := why_without(step, camera, manifest)):
        raise SettingError("step", f"{step!r}, but {why}", f"one of {', '.join(steps)}")
    check_choice("step", step, steps)
    slot = int(step.removeprefix("psf")) if step.startswith("psf") else 0
    return list(step_of(step).acquire(camera, manifest, asked, slot))


def check_lights(
    steps: Iterable[str], camera: Camera, manifest: dict[str, Any], asked: Asked, device: Device | None
) -> dict[str, list[Shot]]:
    """Frames of steps, before the first of them is taken; a device of None sets its light.

    Raises:
        SettingError: a step that this camera does not have, a light that is not said, several lights before a bench
            that sets none, or frames that were taken before in the place of a bench.
    """
    if isinstance(device, Recorded):
        found = f"{type(device).__name__}, frames that were taken before"
        remedy = "name them as docs/calibration.md says, and measure their folder: tmca calibrate STEP FOLDER"
        raise SettingError("--device", found, "simulated, or a driver that takes frames", remedy)
    shots = {step: shots_of(step, camera, manifest, asked) for step in steps}
    if device is None or isinstance(device, Lamp):
        return shots
    for step, each in shots.items():
        if (lights := len({shot.light for shot in each})) > 1:
            remedy = "take them one after the other (--wavelength), or give the driver illuminate(light)"
            raise SettingError(f"frames of {step}", f"{lights} lights", "one, where the bench sets none", remedy)
    return shots


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
        timeout: see `tmca.lab.acquisition.capture`.
        progress: called with (frames done, all, name).

    Returns:
        The folder of the step.

    Raises:
        SettingError: a step that this camera does not have, several lights before a bench that sets none, or frames
            that were taken before in the place of a bench.
        DeviceError: the bench does not answer; frames so far are kept.
        DataError: another camera's export, or saturated frames of a step that may have none.
        OutputError: the folder holds something else, or frames of another bench, or another process captures into it.
    """
    asked = asked or Asked()
    manifest = check_export(export)
    check_camera(export, camera)
    shots = check_lights([step], camera, manifest, asked, device)[step]
    shown, folder, loaded = ShownCodes(export, Path(out), asked), Path(out) / step, ""
    with in_use(Path(out)), calls_of(device, manifest, timeout) as calls:
        saturation = calls.of(lambda: number_of(device, "saturation"))
        about = {"saturation": saturation, "gain": 1.0, **(bench or {}), **_notes(step, shots[0], camera, asked)}
        record = resumed(captured_so_far(folder, export), about, folder)
        for done, shot in enumerate(shots):
            if shot.name not in record["frames"]:
                if shot.shown != loaded:
                    calls.of(partial(device.load, shown.export(shot.shown)))
                    loaded = shot.shown
                if isinstance(device, Lamp):
                    calls.of(partial(device.illuminate, shot.light))
                values = frame_of(calls, shot.slot, shot.whole, f"{step}/{shot.name}")
                most = np.inf if step == "linearity" else saturation
                check_frame(values, folder / shot.name, tuple(camera.snapshot_shape), most)
                keep(_grey(values, camera.buckets), shot.frame, record, folder)
            if progress:
                progress(done + 1, len(shots), shot.name)
    return folder


def _grey(values: Any, buckets: int) -> Any:
    """(H, W), of several buckets (R, H, W): of a sensor with channels their mean, as colours are read."""
    if values.ndim == 2 or len(values) == buckets > 1:
        return values
    mean = np.rint(values.reshape(buckets, -1, *values.shape[1:]).mean(1)).astype(np.uint16)
    return mean if buckets > 1 else mean[0]


def _notes(step: str, shot: Shot, camera: Camera, asked: Asked) -> dict[str, Any]:
    """What measuring a step has to know of its frames."""
    if step == "white":
        return {"reflectance": asked.reflectance}
    if step == "registration":
        wave, drawn = shot.light.wavelength, lab_camera(camera).drawn_map(camera, shot.light.wavelength)
        lit = {} if wave is None else {"wavelength_nm": round(float(metres_to_nm(wave)), 6)}
        return lit | ({} if drawn is None else {DRAWN: np.asarray(drawn).round(9).tolist()})
    return {"pattern": asked.pattern} if step in ("dispersion", "shear") else {}


class ShownCodes:
    """Exports of what a calibration shows, for the devices of a capture, placed as its own codes are; written into
    ``FOLDER/shown`` when they are asked for.

    Args:
        export: of the codes that are to be captured afterwards.
        folder: of the calibration's frames; ``FOLDER/patterns`` holds the patterns as pictures.
        asked: how many of them.
    """

    def __init__(self, export: str | Path, folder: Path, asked: Asked) -> None:
        self.source, self.manifest, self.folder, self.asked = Path(export), read_manifest(export), folder, asked
        # the shutter of other devices than a coded exposure is laid on the frames afterwards
        planes = {about["plane"]: (device_of(about, export), about) for about in self.manifest["planes"]}
        self.placed = {
            plane: (device, placement_of(about, export))
            for plane, (device, about) in planes.items()
            if plane == "aperture" or device.kind == "coded-exposure"
        }

    def export(self, name: str) -> Export:
        """The codes of a ``Shot`` for the devices.

        Raises:
            DataError: an export without an aperture of pixels.
            OutputError: other patterns in their place.
        """
        if name == CODES:
            return Export(self.source, self.manifest)
        if "aperture" not in self.placed:
            found = f"an export of {', '.join(self.placed) or 'masks'}"
            raise DataError(self.source, found, "an aperture of pixels", "export it to the device that shows it")
        planes = self._patterns() if name == PATTERNS else self._slots(name)
        placed = {plane: self.placed[plane] for plane in planes}
        buckets = buckets_of(self.manifest) if "shutter" in planes else 1
        settings = self.manifest["settings"]
        codes = Planes("codes of a calibration", self.manifest["camera"], planes, settings=settings, buckets=buckets)
        slot = float(self.manifest["exposure_s"]) / int(self.manifest["slots"])
        return export_like(codes, placed, self.folder / "shown" / name, slot)

    def _patterns(self) -> dict[str, torch.Tensor]:
        size, place = self.placed["aperture"][1].code, self.folder / "patterns"
        patterns = calibration_patterns(size, self.asked.count)
        if not place.exists():
            make_folder(self.folder)
            write_patterns(place, size, self.asked.count)
        if not np.array_equal(read_patterns(place), patterns):
            raise OutputError(place, "other patterns", "those of this calibration", "choose another folder")
        return {"aperture": torch.from_numpy(patterns).float()}

    def _slots(self, name: str) -> dict[str, torch.Tensor]:
        """Planes of which the aperture is open in all slots, or in one, and every slot is in one bucket, or in none."""
        slots, buckets = int(self.manifest["slots"]), buckets_of(self.manifest)
        pairs = {pair_name(i, j): (i, j) for i in range(slots) for j in range(slots)}
        opened, bucket = torch.ones(slots), torch.zeros(slots)
        if name in pairs:
            opened, bucket = torch.eye(slots)[pairs[name][0]], 1 - torch.eye(slots)[pairs[name][1]]
        elif name == IN_TURN:
            bucket = torch.arange(slots) % buckets
        elif name != OPEN:
            bucket = torch.full((slots,), int(name.removeprefix(BUCKET)))
        shares = {"aperture": opened, "shutter": (bucket == torch.arange(buckets)[:, None]).flatten().float()}
        planes = {
            plane: shares[plane][:, None, None].expand(-1, *place.code).contiguous()
            for plane, (_, place) in self.placed.items()
        }
        return planes | ({"shutter": by_slot(planes["shutter"], slots, buckets)} if "shutter" in planes else {})
