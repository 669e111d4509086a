"""A calibration applied: does it fit the camera, the camera as it was measured, and snapshots on its planes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tmca.cameras import Camera, LightFieldCamera, Snapshot, SpectralCamera, SpectralDepthCamera
from tmca.errors import DataError, SettingError
from tmca.lab.calibration.calibration_file import Calibration, load_calibration
from tmca.lab.calibration.measured_cameras import (
    columns_of,
    light_field_camera,
    spectral_camera,
    spectral_depth_camera,
)
from tmca.lab.calibration.order import check_order
from tmca.lab.calibration.sensor_scale import captured_sensor, from_digital_numbers, measured_sensor
from tmca.lab.captured_notes import AVERAGED, GAIN, WHITE
from tmca.lab.codes_date import CODES_DATE, parsed_date

RAW = "digital numbers"
"""Attribute ``values`` of a snapshot that is not yet relative irradiance."""
_OTHERS = {
    "spectral": ("shear", "wavefront"),
    "light-field": ("dispersion", "wavefront"),
    "spectral-depth": ("shear", "dispersion", "registration", "timing"),
}
"""Parts that a kind of camera does not have."""


def check_fits(camera: Camera, calibration: Calibration, notes: dict[str, Any] | None = None) -> None:
    """Refuse a calibration of another camera, or one that is older than the codes.

    Args:
        camera: the nominal one.
        calibration: to apply.
        notes: of a snapshot; ``camera_name`` and ``codes_date`` (ISO 8601) are checked where they are there.

    Raises:
        DataError: another name, sensor, mask or kind of camera, a calibration before the date of the codes, or see
            `tmca.lab.calibration.order.check_order`.
    """
    own, said = calibration.about["camera"], notes or {}
    if own.get("name") and said.get("camera_name") and own["name"] != said["camera_name"]:
        _refuse(calibration, f"a calibration of camera {own['name']}", f"one of {said['camera_name']}")
    for part in calibration.parts:
        if part.rstrip("0123456789") in _OTHERS[camera.kind]:
            _refuse(calibration, f"a calibration with {part}", f"one of a {camera.kind} camera")
    sizes = {"sensor": tuple(camera.snapshot_shape[-2:])}
    if not isinstance(camera, SpectralDepthCamera):
        sizes["codes"] = tuple(camera.codes.aperture.size)  # type: ignore[union-attr, arg-type]
    for what, size in sizes.items():
        if own.get(what) and tuple(own[what]) != size:
            found, known = ("×".join(map(str, n)) for n in (own[what], size))
            _refuse(calibration, f"{what} of {found} pixels", f"{known}, those of the snapshot's camera")
    check_order(calibration)
    _check_date(calibration, said.get(CODES_DATE))


def _refuse(calibration: Calibration, found: str, expected: str) -> None:
    raise DataError(calibration.where, found, expected, "name the calibration of this camera")


def _check_date(calibration: Calibration, stated: object) -> None:
    measured = calibration.codes_seen
    if stated is None or measured is None:
        return
    date = parsed_date(stated)
    if measured < date:
        found = f"a calibration of {measured:%Y-%m-%d %H:%M}"
        known = f"one after the codes, which are of {date:%Y-%m-%d %H:%M}"
        raise DataError(calibration.where, found, known, "calibrate again with the device as it is now")


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
    sensor = measured_sensor(camera, calibration)
    if isinstance(camera, SpectralCamera):
        return spectral_camera(camera, calibration, sensor)
    if isinstance(camera, LightFieldCamera):
        return light_field_camera(camera, calibration, sensor)
    if isinstance(camera, SpectralDepthCamera):
        return spectral_depth_camera(camera, calibration, sensor)
    raise SettingError("camera", type(camera).__name__, "a spectral, light-field or spectral-depth camera")


def calibrated_snapshot(snapshot: Snapshot[Any], calibration: Calibration) -> Snapshot[Any]:
    """A capture on the planes of its calibrated camera.

    Values in digital numbers (attribute ``values = "digital numbers"``) become relative irradiance by dark, flat and
    the level of white. So do captures of ``tmca capture``, in the place of their own gain, where both were measured;
    the white scene is to be exposed as the frames are. Defective pixels, and columns that the sensor does not have, are
    0 where the shutter is closed all the time.

    Raises:
        DataError: digital numbers without dark and flat, a snapshot that is on these planes already, or see
            ``calibrated``.
    """
    if "calibration" in snapshot.notes:
        found = f"a snapshot that {snapshot.notes['calibration']} was applied to"
        raise DataError(calibration.where, found, "one of the camera as it was designed", "name no calibration")
    camera = calibrated(snapshot.camera, calibration, snapshot.notes)
    values = snapshot.values
    if snapshot.notes.get("values") == RAW:
        values = from_digital_numbers(values, calibration, camera.full_scale)
    elif _by_frames(snapshot, calibration):
        gain, white = float(snapshot.notes[GAIN]), float(snapshot.notes[WHITE])
        values = from_digital_numbers(values / gain, calibration, white, above_dark=True)
        frames = float(snapshot.notes[AVERAGED])
        camera.sensor = captured_sensor(snapshot.camera, calibration, gain, white, frames)
    if isinstance(camera, SpectralCamera):
        values = columns_of(snapshot.camera, camera).laid(values)
    if not isinstance(camera, SpectralDepthCamera):
        values = values * (camera.codes()[1].amax(0) > 0)
    notes = {k: v for k, v in snapshot.notes.items() if k != "values"}
    return Snapshot(values, camera, {**notes, "calibration": calibration.where})


def _by_frames(snapshot: Snapshot[Any], calibration: Calibration) -> bool:
    """Whether frames of a device were joined, and are measured by this calibration."""
    known = {GAIN, WHITE, AVERAGED} <= snapshot.notes.keys()
    return known and all(calibration.part(name) is not None for name in ("dark", "flat"))


def load_snapshot(path: str | Path, calibration: str | Path | None = None) -> Snapshot[Any]:
    """A snapshot file, with its calibration if one is named.

    Raises:
        DataError: digital numbers and no calibration, or see ``calibrated_snapshot``.
    """
    taken = Snapshot.load(path)
    if calibration is not None:
        return calibrated_snapshot(taken, load_calibration(calibration))
    if taken.notes.get("values") == RAW:
        remedy = "name the calibration of its camera (--calibration)"
        raise DataError(path, "a snapshot in digital numbers", "relative irradiance", remedy)
    return taken
