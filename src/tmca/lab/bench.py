"""An optical table from Python: codes go onto its devices, snapshots and a calibration come back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.cameras import Camera, Hardware, Snapshot
from tmca.data import read_scene
from tmca.errors import SettingError
from tmca.lab.acquisition.drivers import Device, Lamp, find_device
from tmca.lab.acquisition.session import capture, check_camera, joined
from tmca.lab.calibration.captured import StepSettings
from tmca.lab.calibration.capturing import capture_step, check_lights
from tmca.lab.calibration.displacement import Curve
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.shots import Asked as Frames
from tmca.lab.calibration.steps import measure_all, steps_of
from tmca.lab.cameras import lab_camera
from tmca.lab.display.codes import read_planes
from tmca.lab.display.devices import DeviceDescription, device_named
from tmca.lab.display.export import Export, export_codes
from tmca.lab.display.manifest import check_export, exposed_whole
from tmca.lab.exported_camera import camera_shown, exported_snapshot
from tmca.progress import Asked, Report, reporting
from tmca.summaries import Summary

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr
    from torch import Tensor

    Scene = str | Path | xr.DataArray | xr.Dataset | np.ndarray | Tensor
else:
    Scene = Any

SIMULATED = "simulated"


def export(
    source: str | Path,
    devices: Sequence[str],
    out: str | Path,
    *,
    exposure: float | None = None,
    macro_pixel: float | None = None,
    mounting_angle: float | None = None,
    code_size: tuple[int, int] | None = None,
    sensor_size: tuple[int, int] | None = None,
    overwrite: bool = False,
) -> Export:
    """Write what devices show of codes: pictures or Zernike terms in the order of the slots, with a manifest.

    Args:
        source: a snapshot file, a file of `tmca design`, a run of `tmca.train` or its weights, or codes that come with
            tmca: ``"default"`` (spectral, K = 8), ``"default-light-field"``, ``"default-spectral-depth"``.
        devices: names of presets or YAML files, one for each plane of the codes that is shown; see docs/devices.md.
        out: folder, written whole or not at all.
        exposure: of all slots together, seconds; that which the codes were designed for without, else 0.1 s.
        macro_pixel: device pixels along the side of a code pixel of the aperture, instead of the description's.
        mounting_angle: of the aperture's device, degrees.
        code_size: (H, W) of the aperture's code; its own, or as many pixels of a tile as the device shows.
        sensor_size: the same of the shutter; a sensor whose description says no size needs it for a tile.
        overwrite: replace an export.

    Raises:
        DataError: no codes.
        SettingError: an unknown device, or codes that it cannot show.
        OutputError: something is in the folder's place.
    """
    changes = {"macro_pixel": macro_pixel, "mounting_angle_deg": mounting_angle}
    shown = [aperture_changed(name, changes) for name in devices]
    return export_codes(
        read_planes(source),
        shown,
        out,
        exposure=exposure,
        code_size=code_size,
        sensor_size=sensor_size,
        overwrite=overwrite,
    )


def aperture_changed(name: str, changes: Mapping[str, Any]) -> DeviceDescription:
    """A device by its name; ``changes`` hold where it shows the aperture."""
    plain = device_named(name)
    return device_named(name, **changes) if plain.plane == "aperture" else plain


def steps_before(camera: Camera, manifest: dict[str, Any], simulated: bool) -> tuple[list[str], list[str]]:
    """Steps of a calibration that a bench takes frames for, and why others are left out.

    A simulated sensor without shot noise has no electrons to count; one slot has no timing.
    """
    steps, whole = steps_of(camera, manifest), exposed_whole(manifest)
    silent = simulated and camera.sensor.full_well is None
    left_out = []
    if silent:
        left_out.append("linearity: left out, the simulated sensor has no shot noise (tmca simulate … --full-well)")
    if camera.slots == 1 and whole and "registration" in steps:
        left_out.append("timing: left out, one slot alone has none")
    return [one for one in steps if not (silent and one == "linearity")], left_out


def usual_frames(camera: Camera, lit: bool, **asked: Any) -> Frames:
    """What a calibration asks for; a bench that sets its light (``lit``) takes a camera's own wavelengths and depths
    where none are named."""
    if lit:
        lab = lab_camera(camera)
        asked["wavelengths"] = asked.get("wavelengths") or tuple(lab.wavelengths(camera))
        asked["depths"] = asked.get("depths") or tuple(lab.depths(camera))
    return Frames(**asked)


def sets_light(driver: Device | None) -> bool:
    """Whether a bench sets its light itself: the simulated one (None), or a driver with ``illuminate``."""
    return driver is None or isinstance(driver, Lamp)


class Bench(Summary):
    """An optical table on which an export is shown: it takes snapshots, and is calibrated.

    Args:
        folder: of an `export`.
        device: ``"simulated"``, the name of a driver or its ``FILE.py:Class``, which runs the file.
        snapshot: of the camera as it was drawn; that of the export, where it was made from a snapshot file.
        hardware: faults of the simulated bench, which nobody is told of.
        seed: of the simulated bench's noise and faults.
        timeout: seconds that a driver has for each answer, 0 for no limit; 30 s or three exposures without, whichever
            is longer.
        settings: of a driver, by name.

    Raises:
        DataError: a damaged export, or one of other codes than the camera's.
        SettingError: no driver of this name, settings that it does not have, or no snapshot file of the camera.
        DeviceError: a driver that cannot be loaded.
    """

    def __init__(
        self,
        folder: str | Path,
        *,
        device: str = SIMULATED,
        snapshot: Snapshot[Any] | None = None,
        hardware: Hardware | None = None,
        seed: int = 0,
        timeout: float | None = None,
        **settings: Any,
    ) -> None:
        self.folder, self.name, self.timeout = Path(folder), device, timeout
        self.manifest = check_export(self.folder)
        self.camera: Camera = camera_shown(snapshot or exported_snapshot(self.manifest), self.manifest).camera
        check_camera(self.folder, self.camera)
        self.simulated = device == SIMULATED
        faults = hardware or Hardware()
        if faults.faults() and not self.simulated:
            raise SettingError("hardware", "faults", f"none before {device}: they are of the simulated bench")
        own = {"hardware": faults, "seed": seed, "whole": exposed_whole(self.manifest)}
        self.settings = own if self.simulated else settings
        self.driver = None if self.simulated else find_device(device, **settings)
        said = {"hardware": faults.described(), "seed": seed} if self.simulated else settings
        self.about: dict[str, Any] = {"driver": device, "settings": {key: str(value) for key, value in said.items()}}

    def _device(self, scene: Sequence[Tensor] = ()) -> Device:
        """The driver, or the simulated bench with a scene before it."""
        return self.driver or find_device(SIMULATED, camera=self.camera, scene=scene, **self.settings)

    def capture(
        self, out: str | Path, scene: Scene | None = None, *, repeats: int = 1, progress: Asked = None
    ) -> Snapshot[Any]:
        """Take every frame of the export, and join them into a snapshot.

        Args:
            out: folder of the frames, 16-bit TIFF; a capture that was stopped goes on there.
            scene: before the simulated bench: as `tmca.read` gives it, what it reads, or an array of the camera's
                scenes; of a larger scene the middle.
            repeats: of each frame, which are averaged.
            progress: called with the share that is done; True for a bar, False for none; None for one that is shown
                after a second in a terminal or a notebook.

        Raises:
            SettingError: a scene before a real bench, or none before the simulated one.
            DeviceError: the bench does not answer; frames so far are kept.
            DataError, ShapeError: a scene that the camera cannot image, or a saturated capture.
            OutputError: the folder holds something else, or frames of another bench or scene.
        """
        if (scene is None) == self.simulated:
            found, expected = ("none", "one before the simulated bench") if self.simulated else ("one", "none")
            raise SettingError("scene", found, expected)
        parts, about = self._placed(scene) if scene is not None else ((), {})
        with reporting(progress, f"capture {Path(out).name}") as report:
            capture(
                self.folder, self._device(parts), out, gain=None, repeats=repeats, camera=self.camera,
                bench=self.about | about, timeout=self.timeout, progress=_of_frames(report),
            )  # fmt: skip
        taken = joined(out, self.folder, self.camera)
        taken.notes |= {"scene": about.get("scene", "")}
        return taken

    def _placed(self, scene: Scene) -> tuple[tuple[Tensor, ...], dict[str, str]]:
        """Tensors of a scene, and what frames of it are known by."""
        named = read_scene(scene, self.camera.kind) if isinstance(scene, str | Path) else scene  # type: ignore[arg-type]
        light, depth = self.camera.imaged(named)
        parts = tuple(part[:1] for part in (light, depth) if part is not None)
        name = str(getattr(named, "attrs", {}).get("name", ""))
        return parts, {"scene": name, "scene_digest": " ".join(f"{float(part.double().sum()):.12g}" for part in parts)}

    def calibrate(
        self,
        out: str | Path,
        *,
        name: str = "",
        frames: int = 16,
        wavelengths: Sequence[float] = (),
        depths: Sequence[float] = (),
        curve: Curve = "cauchy",
        progress: Asked = None,
    ) -> Calibration:
        """Take the frames of every step of a calibration, and measure them.

        A real bench has to set its light itself (``illuminate``); else take the steps one by one: docs/calibration.md.

        Args:
            out: folder of the frames, one folder for each step; steps that were stopped go on there.
            name: of the camera, kept in the calibration; that of the folder if empty.
            frames: of dark, flat and white.
            wavelengths: metres, of dispersion and point spread functions; the first is that of the registration. Those
                of the camera's bands without, the middle one first.
            depths: metres, of the point before a spectral-depth camera; three of its planes without.
            curve: of the dispersion over the wavelength; ``"measured"``: straight lines.
            progress: see `capture`.

        Returns:
            The calibration, to be saved by its ``save``.

        Raises:
            SettingError: a driver that does not set its light; before the first frame.
            DeviceError, OutputError: as of `capture`.
            DataError: frames that do not fit, or a fit that failed.

        Warns:
            Doubtful: a step that left more than good captures leave.
        """
        steps, _ = steps_before(self.camera, self.manifest, self.simulated)
        lights = {"wavelengths": tuple(wavelengths), "depths": tuple(depths)}
        asked = usual_frames(self.camera, sets_light(self.driver), frames=frames, **lights)
        check_lights(steps, self.camera, self.manifest, asked, self.driver)
        with reporting(progress, f"calibrate {Path(out).name}") as report:
            for place, step in enumerate(steps):
                capture_step(
                    step, self.folder, self._device(), out, self.camera, asked, bench=self.about, timeout=self.timeout,
                    progress=_of_frames(report, place, 2 * len(steps)),
                )  # fmt: skip
            calibration = Calibration.empty(name or Path(out).name)
            for place, (part, measured) in enumerate(measure_all(out, calibration, StepSettings(curve=curve))):
                calibration = measured
                if report:
                    report(0.5 + (place + 1) / (2 * len(steps)), part)
        return calibration

    def _facts(self) -> dict[str, str]:
        devices = ", ".join(plane["device"]["name"] for plane in self.manifest["planes"])
        return {
            "bench": self.name,
            "shows": f"{self.folder}, on {devices}",
            "camera": f"{self.camera.kind}, K = {self.camera.slots}",
            "faults": self.about["settings"]["hardware"] if self.simulated else "",
        }


def _of_frames(report: Report | None, first: int = 0, parts: int = 1) -> Any:
    """What frames report to, the ``first`` of so many parts of the work."""
    if report is None:
        return None
    return lambda done, total, name: report((first + done / total) / parts, name)
