"""Where codes have to lie on a device so that they fall on the sensor pixels that the camera was drawn with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera
from tmca.errors import DataError, SettingError
from tmca.lab.calibration.apply import check_fits
from tmca.lab.calibration.calibration_file import Calibration
from tmca.lab.calibration.measured_cameras import reference_shift
from tmca.lab.calibration.measurements.pattern_image import moved
from tmca.lab.calibration.measurements.registration import nominal_matrix
from tmca.lab.devices.descriptions import DeviceDescription
from tmca.lab.devices.placement import Affine


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
    if device.size is None or tuple(registration.codes) != tuple(device.size):
        found, known = ("×".join(map(str, size or ("?",))) for size in (registration.codes, device.size))
        remedy = f"register patterns of its own pixels: tmca calibrate patterns --device {known.replace('×', 'x')}"
        raise DataError(calibration.where, f"a registration of {found} pixels", f"{device.name}'s {known}", remedy)
    wanted = _drawn(_camera(source), calibration)
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


def _drawn(camera: Any, calibration: Calibration) -> Any:
    """(2, 3) map from code to sensor pixels of the camera as it was drawn."""
    sensor = calibration.about["camera"].get("sensor")
    if sensor and tuple(sensor) != tuple(camera.snapshot_shape[-2:]):
        check_fits(camera, calibration.without("registration"))
    if isinstance(camera, SpectralCamera):
        shift = reference_shift(camera, calibration) - camera.dispersion.origin
        return moved(np.eye(2, 3), (0.0, shift))
    if isinstance(camera, LightFieldCamera):
        return nominal_matrix(camera.mask_size, camera.size, 1 / camera.shear.scale)
    raise SettingError("--calibration", f"a {camera.kind} camera", "one with a coded aperture")
