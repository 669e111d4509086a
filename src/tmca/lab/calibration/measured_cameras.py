"""Cameras as they were measured: sensor, codes where they fall on it with their leaks, optics, timing, mask."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tmca.cameras import Camera, LightFieldCamera, SpectralCamera, SpectralDepthCamera
from tmca.codes import leaked
from tmca.errors import DataError, SettingError
from tmca.lab.calibration.captures import corrected, defects
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.pattern_image import moved, seen_patterns
from tmca.lab.calibration.registration import nominal_matrix
from tmca.lab.frames import Array, check_size
from tmca.optics import FreeForm, ViewShear
from tmca.optics.zernike import zernike_modes
from tmca.sensor import Sensor


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
        values: digital numbers.
        calibration: with dark and flat.
        full_scale: of the camera.
        above_dark: values are without a dark frame of their own already.

    Raises:
        DataError: see ``white_level``, or values of another size than the dark.
    """
    level = white_level(calibration)
    check_size(calibration.where, "a dark", calibration.part("dark").mean.shape, values.shape[-2:])
    raw = values.double().numpy() + (calibration.part("dark").mean if above_dark else 0)
    shares = corrected(raw, calibration) / level
    return torch.from_numpy(shares * full_scale).to(values)


def measured_sensor(camera: Camera, calibration: Calibration) -> Sensor:
    """The camera's sensor with read noise and full well as they were measured.

    Read noise needs dark and flat, the full well linearity too; else the nominal sensor stays.
    """
    dark, flat, linearity = (calibration.part(name) for name in ("dark", "flat", "linearity"))
    if dark is None or flat is None:
        return camera.sensor
    level = white_level(calibration)
    read = dark.noise * camera.full_scale / level
    if linearity is None:
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
    if linearity is not None:
        settings["full_well"] = linearity.gain * level * frames * camera.white / white
    return Sensor(**settings)


def _mixed(codes: Tensor, calibration: Calibration) -> tuple[Array, float]:
    """(K, h, w) what the aperture shows during every slot of the shutter, and the light by which a slot is longer."""
    registration, timing = calibration.part("registration"), calibration.part("timing")
    closed = 0.0 if registration is None else registration.closed_light
    planes = leaked(codes.detach().double(), closed).numpy()
    if timing is None:
        return planes, 1.0
    if timing.slots != len(planes):
        where, wanted = calibration.where, f"{len(planes)}, those of the codes"
        raise DataError(where, f"a timing of {timing.slots} slots", wanted, "measure the timing of these codes")
    overlap = timing.overlap()
    longest = max(1.0, float(overlap.sum(axis=0).max()))
    return np.tensordot(overlap.T / longest, planes, 1), longest


def _open_shutter(shutter: Tensor, calibration: Calibration) -> Array:
    """(K, H, W) the shutter with its leakage, closed over defective pixels."""
    timing, bad = calibration.part("timing"), defects(calibration)
    planes = leaked(shutter.detach().double(), 0.0 if timing is None else timing.leakage).numpy()
    return planes if bad is None else np.where(bad, 0.0, planes)


@dataclass(frozen=True)
class Columns:
    """Columns of the calibrated camera's snapshot that the nominal one's are."""

    first: int
    width: int

    def laid(self, values: Any) -> Any:
        """(…, W) values on the wider or narrower snapshot, 0 where the sensor has no pixel."""
        tensor = torch.as_tensor(values)
        found = tensor.new_zeros(*tensor.shape[:-1], self.width)
        start, stop = max(0, self.first), min(self.width, self.first + tensor.shape[-1])
        found[..., start:stop] = tensor[..., start - self.first : stop - self.first]
        return found

    def cut(self, values: Any, nominal: int) -> Any:
        """(…, nominal) the columns of the nominal snapshot of values (…, W) on the calibrated one; 0 where it has none.

        The sensor has no other columns: what ``laid`` lays."""
        return Columns(-self.first, nominal).laid(values)


def columns_of(nominal: SpectralCamera, camera: SpectralCamera) -> Columns:
    return Columns(nominal.dispersion.origin - camera.dispersion.origin, camera.snapshot_shape[2])


def spectral_camera(camera: SpectralCamera, calibration: Calibration, sensor: Sensor) -> SpectralCamera:
    if camera.disperser == "dual" or camera.coloured is not None:
        raise SettingError("camera", "a dual disperser or coloured aperture", "a single disperser to calibrate")
    aperture, shutter = camera.codes()
    planes, light = _mixed(aperture, calibration)
    registration, start = calibration.part("registration"), reference_shift(camera, calibration)
    if registration is not None:
        # scene column n falls on sensor column n + start - origin at the registration's wavelength
        matrix = moved(registration.matrix, (0.0, camera.dispersion.origin - start))
        planes = seen_patterns(planes, matrix, camera.size, 0.0 if camera.blurred else registration.blur)
    measured = calibration.part("dispersion")
    dispersion = camera.dispersion if measured is None else measured.dispersion(camera.wavelengths, start)
    response = camera.response.detach().double().numpy() * light
    if measured is not None:
        own = measured.response_at(camera.wavelengths)
        response = own * response.sum() / own.sum()
    place = Columns(camera.dispersion.origin - dispersion.origin, camera.size[1] + dispersion.extent)
    return SpectralCamera(
        camera.wavelengths, camera.size, camera.slots, aperture=_codes(planes),
        shutter=_codes(place.laid(_open_shutter(shutter, calibration))), exposure=camera.exposure,
        dispersion=dispersion, response=_codes(response), relay_blur=camera.relay_blur, sensor=sensor,
    )  # fmt: skip


def reference_shift(camera: SpectralCamera, calibration: Calibration) -> float:
    """Nominal displacement at the wavelength of the registration, pixels."""
    registration = calibration.part("registration")
    if registration is None:
        measured = calibration.part("dispersion")
        return (
            0.0
            if measured is None
            else camera.dispersion.displacement[0] - float(measured.at(camera.wavelengths)[0, 1])
        )
    if registration.wavelength is None:
        remedy = "measure it under monochromatic light and give tmca calibrate registration --wavelength"
        raise DataError(calibration.where, "a registration of unknown wavelength", "one for a disperser", remedy)
    by_wave = np.argsort(camera.wavelengths)
    waves, shifts = np.array(camera.wavelengths)[by_wave], np.array(camera.dispersion.displacement)[by_wave]
    return float(np.interp(registration.wavelength, waves, shifts))


def _codes(values: Any) -> Tensor:
    """Single-precision codes without the rounding that leaves [0, 1]."""
    found = torch.as_tensor(np.asarray(values))
    return found.clamp(min=0).to(torch.get_default_dtype()) if found.ndim < 2 else found.clamp(0, 1).float()


def light_field_camera(camera: LightFieldCamera, calibration: Calibration, sensor: Sensor) -> LightFieldCamera:
    aperture, shutter = camera.codes()
    planes, light = _mixed(aperture, calibration)
    registration, shear = calibration.part("registration"), calibration.part("shear")
    vignetting = camera.vignetting.detach().double().numpy() * light
    step, scale = camera.shear.step, camera.shear.scale
    if shear is not None:
        own = shear.vignetting(camera.views)
        vignetting = own * vignetting.sum() / own.sum()
    if registration is not None or shear is not None:
        # the mask is laid on the sensor's own grid, on which a step is one of sensor pixels
        own_step = (step[0] / scale, step[1] / scale) if shear is None else shear.step
        step = (float(own_step[0]), float(own_step[1]))
        reach = ViewShear(camera.views, step, 1.0)
        nominal = nominal_matrix(camera.mask_size, camera.size, 1 / scale)
        matrix = nominal if registration is None else registration.matrix
        blur = 0.0 if registration is None else registration.blur
        border, scale = reach.border(camera.size), 1.0
        planes = seen_patterns(planes, moved(matrix, border), reach.mask_size(camera.size), blur)
    return LightFieldCamera(
        camera.views, camera.size, camera.slots, aperture=_codes(planes),
        shutter=_codes(_open_shutter(shutter, calibration)), exposure=camera.exposure, shear=step, mask_scale=scale,
        vignetting=torch.as_tensor(vignetting).float(), sensor=sensor,
    )  # fmt: skip


def spectral_depth_camera(camera: SpectralDepthCamera, calibration: Calibration, sensor: Sensor) -> SpectralDepthCamera:
    heights = camera.codes()[0].detach().double()
    fits = {name: part for name, part in calibration.parts.items() if name.startswith("wavefront")}
    if fits and set(fits) != {f"wavefront{k}" for k in range(camera.slots)}:
        found = f"wavefronts of {len(fits)} slots"
        raise DataError(calibration.where, found, f"{camera.slots}, those of the codes", "measure every slot")
    for name, fit in fits.items():
        modes = zernike_modes(fit.modes, camera.bench.mask_size)
        heights[int(name.removeprefix("wavefront"))] += torch.tensordot(torch.from_numpy(fit.coefficients), modes, 1)
    return SpectralDepthCamera(
        camera.wavelengths, camera.size, camera.slots, depth=(camera.planes.near, camera.planes.far),
        planes=camera.planes.count, bench=camera.bench, mask=FreeForm(heights.float()),
        shutter=camera.shutter.tile().detach(), filters=camera.filters.filters, cells=camera.filters.cells(),
        period=camera.period, channels=camera.response, exposure=camera.exposure, energy=camera.point_spread.energy,
        image_formation=camera.image_formation, sensor=sensor,
    )  # fmt: skip
