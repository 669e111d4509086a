"""A calibration applied: does it fit the camera, and snapshots on the planes of the camera as it was measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from warnings import warn

import numpy as np
import torch
from torch import Tensor

from tmca.cameras import Camera, Snapshot
from tmca.errors import DataError, SettingError
from tmca.lab.calibration.file import Calibration, load_calibration
from tmca.lab.calibration.parts import kind_of
from tmca.lab.calibration.steps import not_measured
from tmca.lab.cameras import lab_camera
from tmca.lab.display.devices import DeviceDescription
from tmca.lab.display.placement import Affine
from tmca.lab.frames import check_size
from tmca.lab.notes import AVERAGED, CODES_DATE, GAIN, WHITE, date_of_codes, now, parsed_date
from tmca.lab.quality import NotMeasured
from tmca.sensor import Sensor

RAW = "digital numbers"
"""Attribute ``values`` of a snapshot that is not yet relative irradiance."""


def check_fits(camera: Camera, calibration: Calibration, notes: dict[str, Any] | None = None) -> None:
    """Refuse a calibration of another camera, or one that is older than the codes.

    Args:
        camera: the nominal one.
        calibration: to apply.
        notes: of a snapshot; ``camera_name`` and ``codes_date`` (ISO 8601) are checked where they are there.

    Raises:
        DataError: another name, sensor, mask or kind of camera, or a calibration before the date of the codes.
    """
    about, said = calibration.about["camera"], notes or {}
    if about.get("name") and said.get("camera_name") and about["name"] != said["camera_name"]:
        _refuse(calibration, f"a calibration of camera {about['name']}", f"one of {said['camera_name']}")
    lab = lab_camera(camera)
    for part in calibration.parts:
        if kind_of(part) in lab.unmeasured:
            _refuse(calibration, f"a calibration with {part}", f"one of a {camera.kind} camera")
    sizes = {"sensor": _sensor_of(camera)}
    if lab.masked:
        sizes["codes"] = tuple(camera.codes.aperture.size)  # type: ignore[union-attr, arg-type]
    for what, size in sizes.items():
        if about.get(what):
            check_size(calibration.where, what, about[what], size, "name the calibration of this camera")
    stated, measured = said.get(CODES_DATE), calibration.codes_seen
    if stated is not None and measured is not None and measured < (date := parsed_date(stated)):
        found = f"a calibration of {measured:%Y-%m-%d %H:%M}"
        expected = f"one after the codes, which are of {date:%Y-%m-%d %H:%M}"
        raise DataError(calibration.where, found, expected, "calibrate again with the device as it is now")


def _sensor_of(camera: Camera) -> tuple[int, ...]:
    """(H, W) of the sensor, (R, H, W) of one with several buckets a pixel."""
    buckets = (camera.buckets,) if camera.buckets > 1 else ()
    return (*buckets, *camera.snapshot_shape[-2:])


def _refuse(calibration: Calibration, found: str, expected: str) -> None:
    raise DataError(calibration.where, found, expected, "name the calibration of this camera")


def calibrated(camera: Camera, calibration: Calibration, notes: dict[str, Any] | None = None) -> Any:
    """The camera with what was measured of it; what was not measured stays nominal.

    Codes become grey: shares of light that a registered mask leaves open over every pixel, mixed over slots by the
    timing. Where dispersion or shear need other planes than the nominal ones, see ``calibrated_snapshot``.

    Args:
        camera: the nominal one.
        calibration: of it.
        notes: of a snapshot, see ``check_fits``.

    Raises:
        DataError: see ``check_fits``; a registration of unknown wavelength for a disperser.
        SettingError: optics for which there is no calibration (dual disperser, coloured aperture), or bands beyond
            the wavelengths that were measured.
    """
    check_fits(camera, calibration, notes)
    return lab_camera(camera).calibrated(camera, calibration, measured_sensor(camera, calibration))


def calibrated_snapshot(snapshot: Snapshot[Any], calibration: Calibration) -> Snapshot[Any]:
    """A capture on the planes of its calibrated camera.

    Values in digital numbers (attribute ``values = "digital numbers"``) become relative irradiance by dark, flat and
    the level of white. So do captures of ``tmca capture``, in the place of their own gain, where both were measured;
    the white scene is to be exposed as the frames are. Defective pixels, and columns that the sensor does not have, are
    0 where the shutter is closed all the time.

    Raises:
        DataError: digital numbers without dark and flat, a snapshot that is on these planes already, or see
            ``calibrated``.

    Warns:
        NotMeasured: a calibration that lacks steps of this camera.
    """
    if "calibration" in snapshot.notes:
        found = f"a snapshot that {snapshot.notes['calibration']} was applied to"
        raise DataError(calibration.where, found, "one of the camera as it was designed", "name no calibration")
    camera, correct = correction(snapshot.camera, calibration, snapshot.notes)
    notes = {k: v for k, v in snapshot.notes.items() if k != "values"}
    warn_of_missing(calibration, snapshot.camera, snapshot.notes)
    return Snapshot(correct(snapshot.values), camera, {**notes, "calibration": calibration.where})


def correction(
    camera: Camera, calibration: Calibration, notes: dict[str, Any]
) -> tuple[Any, Callable[[Tensor], Tensor]]:
    """The calibrated camera, and what brings captures of the nominal one with these notes onto its planes, see
    ``calibrated_snapshot``: (…, C, H, W') → (…, C, H, W').

    Raises:
        DataError: digital numbers without dark and flat, or see ``calibrated``.
        SettingError: see ``calibrated``.
    """
    measured = calibrated(camera, calibration, notes)
    raw = notes.get("values") == RAW
    joined = not raw and {GAIN, WHITE, AVERAGED} <= notes.keys() and {"dark", "flat"} <= calibration.parts.keys()
    gain, white = 1.0, measured.full_scale
    if joined:
        gain, white, frames = (float(notes[name]) for name in (GAIN, WHITE, AVERAGED))
        measured.sensor = captured_sensor(camera, calibration, gain, white, frames)

    def correct(values: Tensor) -> Tensor:
        if raw or joined:
            values = from_digital_numbers(values / gain, calibration, white, above_dark=joined)
        return lab_camera(camera).on_camera(values, camera, measured)

    return measured, correct


def load_snapshot(path: str | Path, calibration: str | Path | None = None) -> Snapshot[Any]:
    """A snapshot file, with its calibration if one is named.

    Raises:
        DataError: digital numbers and no calibration, or see ``calibrated_snapshot``.

    Warns:
        NotMeasured: a calibration that lacks steps of this camera.
    """
    taken = Snapshot.load(path)
    if calibration is not None:
        measured = load_calibration(calibration)
        return calibrated_snapshot(taken, measured)
    if taken.notes.get("values") == RAW:
        remedy = "name the calibration of its camera (--calibration)"
        raise DataError(path, "a snapshot in digital numbers", "relative irradiance", remedy)
    return taken


def warn_of_missing(calibration: Calibration, camera: Camera, notes: dict[str, Any]) -> None:
    """Warn of steps that a calibration lacks; frames of slots that were masked afterwards have no timing to measure."""
    whole = float(notes.get(WHITE, camera.full_scale)) == camera.full_scale
    if missing := not_measured(calibration, camera, whole):
        text = f"{calibration.where}: not measured: {missing}; what was drawn is used"
        warn(text, NotMeasured, stacklevel=3)


def white_level(calibration: Calibration) -> float:
    """Digital numbers above the dark of a white scene with everything open.

    Raises:
        DataError: dark or flat were not measured.
    """
    if calibration.part("dark") is None or calibration.part("flat") is None:
        remedy = "measure both with tmca calibrate dark and flat"
        raise DataError(calibration.where, "no dark and flat", "both, for a snapshot in digital numbers", remedy)
    stated = calibration.settings("flat").get("white_level")
    return float(stated or calibration.part("flat").level)


def from_digital_numbers(
    values: Tensor, calibration: Calibration, full_scale: float, *, above_dark: bool = False
) -> Tensor:
    """Relative irradiance of raw values (…, H, W): ``(raw - dark) / flat · full_scale / white level``.

    Args:
        values: digital numbers; (…, R·C, H, W) of R buckets.
        calibration: with dark and flat.
        full_scale: of the camera.
        above_dark: values are without a dark frame of their own already.

    Raises:
        DataError: see ``white_level``, or values of another size than the dark.
    """
    level = white_level(calibration)
    dark = calibration.part("dark").mean
    check_size(calibration.where, "a dark", dark.shape[-2:], values.shape[-2:])
    raw = values.double().numpy()
    if dark.ndim == 3:
        raw = raw.reshape(*raw.shape[:-3], len(dark), -1, *raw.shape[-2:]).swapaxes(-3, -4)  # (…, C, R, H, W)
    light = calibration.corrected(raw + (dark if above_dark else 0))
    light = light.swapaxes(-3, -4).reshape(values.shape) if dark.ndim == 3 else light
    return torch.from_numpy(light / level * full_scale).to(values)


def measured_sensor(camera: Camera, calibration: Calibration) -> Sensor:
    """The camera's sensor with read noise and full well as they were measured.

    Read noise needs dark and flat, the full well linearity too; else the nominal sensor stays.
    """
    dark, flat, linearity = (calibration.part(name) for name in ("dark", "flat", "linearity"))
    if dark is None or flat is None:
        return camera.sensor
    level = white_level(calibration)
    read = dark.noise * camera.full_scale / level
    if linearity is None or not linearity.gain_is_known:
        return Sensor(**{**camera.sensor.settings(), "read_noise": read, "read_noise_electrons": 0.0})
    # electrons of a white scene: there the sensor counts its full well
    return Sensor(read_noise=read, full_well=linearity.gain * level / camera.exposures, saturates=False)


def captured_sensor(camera: Camera, calibration: Calibration, gain: float, white: float, frames: float) -> Sensor:
    """The sensor of joined frames: the noise that they were told, rescaled as they are; electrons from the linearity.

    Args:
        camera: of the joined snapshot, with its noise.
        calibration: with dark and flat.
        gain: snapshot units of a digital number, before.
        white: snapshot units of a white scene in one frame.
        frames: whose mean an open pixel is.
    """
    level, linearity = white_level(calibration), calibration.part("linearity")
    scaled = white / (level * gain)
    settings: dict[str, Any] = {
        **camera.sensor.settings(),
        "read_noise": camera.sensor.read_noise * scaled,
        "saturates": False,
    }
    if linearity is not None and linearity.gain_is_known:
        settings["full_well"] = linearity.gain * level * frames * camera.white / white
    return Sensor(**settings)


SIMULATED = "simulated_calibration"
"""Attribute of a snapshot that a calibrated camera took in simulation: the calibration's file."""


@dataclass(frozen=True)
class CalibratedBench:
    """A camera as it is known, and the one that takes snapshots.

    Args:
        nominal: as it was designed; snapshot files hold this one, like those of captures.
        camera: with what was measured of it; ``nominal`` without a calibration.
        notes: of its snapshots: date of the codes, name of the camera, calibration.
    """

    nominal: Camera
    camera: Any
    notes: dict[str, Any]

    def recorded(self, taken: Snapshot[Any]) -> Snapshot[Any]:
        """A snapshot of ``camera`` as the sensor's pixels record it, with the nominal camera.

        Columns of the sensor that no light reaches are 0.
        """
        values = taken.values
        if self.camera is not self.nominal:
            values = lab_camera(self.nominal).on_sensor(values, self.nominal, self.camera)
        return Snapshot(values, self.nominal, {**taken.notes, **self.notes})


def bench_of(
    camera: Camera, calibration: str | Path | None = None, codes: Sequence[str | Path] = ()
) -> CalibratedBench:
    """A bench for simulated snapshots.

    Codes that are drawn for the simulation have no date of their own: it is that of the calibration under which they
    are shown, or now.

    Args:
        camera: nominal, with the codes.
        calibration: of the camera; None for the camera as it was designed.
        codes: files that the codes come from.

    Raises:
        DataError: a calibration of another camera, or one that is older than the codes.
        SettingError: optics for which there is no calibration.
    """
    date = date_of_codes(codes)
    if calibration is None:
        return CalibratedBench(camera, camera, {CODES_DATE: date or now()})
    measured = load_calibration(calibration)
    notes = {
        CODES_DATE: date or (now() if measured.codes_seen is None else measured.codes_seen.isoformat()),
        SIMULATED: measured.where,
    }
    if name := measured.about["camera"].get("name"):
        notes["camera_name"] = name
    return CalibratedBench(camera, calibrated(camera, measured, notes), notes)


def registered_affine(source: str | Path, calibration: Calibration, device: DeviceDescription) -> Affine:
    """The map from code to device pixels, (row, column, 1) each, that undoes how the device is mounted.

    The registration says on which sensor pixel every device pixel falls, the camera on which one every code pixel
    should: behind a disperser at the wavelength of the registration.

    Args:
        source: snapshot file of a spectral or light-field camera, whose codes are exported.
        calibration: with a registration of patterns of the device's own pixels.
        device: that shows the aperture.

    Raises:
        DataError: no snapshot, no registration, or one of another device or camera.
        SettingError: a device whose pixels lie on no square lattice, or a camera without a mask to register.
    """
    registration = calibration.part("registration")
    if registration is None:
        raise DataError(calibration.where, "no registration", "one", "measure it: tmca calibrate registration")
    if device.lattice != "square":
        raise SettingError("--calibration", f"a device with a {device.lattice} lattice", "a square one")
    remedy = f"register patterns of the pixels of {device.name}: tmca calibrate patterns"
    check_size(calibration.where, "a registration", registration.codes, device.size or (), remedy)
    camera = _camera(source)
    sensor = calibration.about["camera"].get("sensor")
    if sensor and tuple(sensor) != _sensor_of(camera):
        check_fits(camera, calibration.without("registration"))
    wanted = lab_camera(camera).code_map(camera, calibration)
    back = np.linalg.inv(registration.matrix[:, :2])
    affine = np.hstack([back @ wanted[:, :2], back @ (wanted[:, 2:] - registration.matrix[:, 2:])])
    (a, b, c), (d, e, f) = affine.tolist()
    return (a, b, c), (d, e, f)


def _camera(source: str | Path) -> Any:
    try:
        return Snapshot.load(source).camera
    except (DataError, OSError):
        remedy = "simulate one with these codes: tmca simulate … --codes, --out sim.nc"
        raise DataError(source, "no snapshot", "one, whose camera says where codes fall", remedy) from None
