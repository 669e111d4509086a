"""The spectral camera on the table: bands one by one, and columns that a measured dispersion displaces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tmca.cameras import SpectralCamera
from tmca.data import metres_to_nm
from tmca.errors import DataError, SettingError
from tmca.lab.calibration.displacement import REGISTERED_AT, MeasuredDispersion
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.pattern_image import moved, seen_patterns
from tmca.lab.cameras.base import BRIGHT, Light, check_light
from tmca.lab.cameras.coded import MASK_STEPS, CodedLab, grey_codes, leaking_shutter, mixed_aperture
from tmca.lab.frames import Array
from tmca.optics.spectral import on_columns
from tmca.sensor import Sensor

_NEAR = 1e-10
"""Metres between a wavelength and its band."""


class SpectralLab(CodedLab):
    """Cubes behind a single disperser."""

    kind = "spectral"
    steps = MASK_STEPS | {"dispersion"}
    unmeasured = frozenset({"shear", "wavefront"})

    def brightness(self, camera: SpectralCamera, light: Light) -> Array:
        check_light(light.view is None, "one view", "none of a spectral camera")
        return band_brightness(camera, light.wavelength)

    def wavelengths(self, camera: SpectralCamera) -> Sequence[float]:
        return middle_first(camera.wavelengths)

    def calibrated(self, camera: SpectralCamera, calibration: Calibration, sensor: Sensor) -> SpectralCamera:
        if camera.disperser == "dual" or camera.coloured is not None:
            raise SettingError("camera", "a dual disperser or coloured aperture", "a single disperser to calibrate")
        planes, light = mixed_aperture(camera.codes()[0], calibration)
        registration, start = calibration.part("registration"), _reference_shift(camera, calibration)
        if registration is not None:
            # scene column n falls on sensor column n + start - origin at the registration's wavelength
            matrix = moved(registration.matrix, (0.0, camera.dispersion.origin - start))
            planes = seen_patterns(planes, matrix, camera.size, 0.0 if camera.blurred else registration.blur)
        measured = calibration.part("dispersion")
        dispersion = camera.dispersion
        if measured is not None:
            dispersion = measured.dispersion(camera.wavelengths, start - _registered_since(calibration))
        response = _response(camera, light, measured)
        first, width = camera.dispersion.origin - dispersion.origin, camera.size[1] + dispersion.extent
        wide = on_columns(torch.from_numpy(leaking_shutter(camera, calibration)), first, width)
        kappa = torch.from_numpy(response).clamp(min=0).to(torch.get_default_dtype())
        return camera.replace(
            codes=grey_codes(planes, wide), dispersion=dispersion, response=kappa, sensor=sensor, beside=(0, 0)
        )

    def on_camera(self, values: Tensor, nominal: Any, measured: Any) -> Tensor:
        """See ``LabCamera``; 0 in columns where the sensor has no pixel."""
        first = nominal.dispersion.origin - measured.dispersion.origin
        return super().on_camera(on_columns(values, first, measured.snapshot_shape[2]), nominal, measured)

    def on_sensor(self, values: Tensor, nominal: Any, measured: Any) -> Tensor:
        """See ``LabCamera``; 0 in columns that no light reaches."""
        return on_columns(values, measured.dispersion.origin - nominal.dispersion.origin, nominal.snapshot_shape[2])

    def drawn_map(self, camera: SpectralCamera, wavelength: float | None) -> Array | None:
        if wavelength is None:
            return None
        return moved(np.eye(2, 3), (0.0, _drawn_shift(camera, wavelength) - camera.dispersion.origin))

    def code_map(self, camera: SpectralCamera, calibration: Calibration) -> Array:
        """See ``LabCamera``; at the wavelength of the registration."""
        return moved(np.eye(2, 3), (0.0, _reference_shift(camera, calibration) - camera.dispersion.origin))


def band_brightness(camera: Any, wavelength: float | None) -> Array:
    """(L,) of a white surface in all bands, or in the one of a wavelength (metres), as bright as the sensor bears.

    Raises:
        DeviceError: no band of the camera.
    """
    if wavelength is None:
        return np.ones(len(camera.wavelengths))
    chosen = np.abs(np.array(camera.wavelengths) - wavelength) < _NEAR
    bands = ", ".join(f"{metres_to_nm(one):g}" for one in camera.wavelengths)
    check_light(bool(chosen.any()), f"{metres_to_nm(wavelength):g} nm", f"a band of the camera: {bands} nm")
    response = camera.response.detach()
    return chosen * BRIGHT * camera.white / float(response.sum(0).max() if response.ndim == 2 else response.max())


def middle_first(bands: Sequence[float]) -> Sequence[float]:
    """Bands by their distance from the middle one."""
    middle = sorted(bands)[len(bands) // 2]
    return tuple(sorted(bands, key=lambda one: abs(one - middle)))


def _registered_since(calibration: Calibration) -> float:
    """Displacement, in the measured dispersion, of the light of a registration that was measured after it at another
    wavelength; pixels."""
    known, registration = calibration.settings("dispersion").get(REGISTERED_AT), calibration.part("registration")
    if known is None or registration is None or registration.wavelength is None:
        return 0.0
    if abs(known - registration.wavelength) < _NEAR:
        return 0.0
    return float(calibration.part("dispersion").at([registration.wavelength])[0, 1])


def _response(camera: SpectralCamera, light: float, measured: MeasuredDispersion | None) -> Array:
    """Of the bands, in all that of the camera by this light; as it was measured, where it was."""
    response = camera.response.detach().double().numpy() * light
    if measured is None:
        return response
    relative = measured.response_at(camera.wavelengths)
    return relative * response.sum() / relative.sum()


def _reference_shift(camera: SpectralCamera, calibration: Calibration) -> float:
    """Nominal displacement at the wavelength of the registration, pixels; DataError where that is unknown."""
    registration, measured = calibration.part("registration"), calibration.part("dispersion")
    if registration is None and measured is None:
        return 0.0
    if registration is None:
        return camera.dispersion.displacement[0] - float(measured.at(camera.wavelengths)[0, 1])
    if registration.wavelength is None:
        remedy = "measure it under monochromatic light and give tmca calibrate registration --wavelength"
        raise DataError(calibration.where, "a registration of unknown wavelength", "one for a disperser", remedy)
    return _drawn_shift(camera, registration.wavelength)


def _drawn_shift(camera: SpectralCamera, wavelength: float) -> float:
    """Nominal displacement of a wavelength (metres), pixels."""
    by_wave = np.argsort(camera.wavelengths)
    waves, shifts = np.array(camera.wavelengths)[by_wave], np.array(camera.dispersion.displacement)[by_wave]
    return float(np.interp(wavelength, waves, shifts))
