"""Cameras as they were measured: codes where they fall on the sensor, dispersion, response, shear, timing, mask."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tmca.cameras import Camera, LightFieldCamera, Snapshot, SpectralCamera, SpectralDepthCamera
from tmca.errors import DataError, SettingError
from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.calibration_file import Calibration, load_calibration
from tmca.lab.calibration.captures import defects
from tmca.lab.calibration.pattern_image import moved, seen_patterns
from tmca.lab.calibration.registration import nominal_matrix
from tmca.lab.calibration.sensor_scale import from_digital_numbers, measured_sensor
from tmca.optics import FreeForm, ViewShear
from tmca.optics.zernike import zernike_modes

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
        DataError: another name, sensor, mask or kind of camera, or a calibration before the date of the codes.
    """
    own, said = calibration.about["camera"], notes or {}
    if own.get("name") and said.get("camera_name") and own["name"] != said["camera_name"]:
        _refuse(calibration, f"a calibration of camera {own['name']}", f"one of {said['camera_name']}")
    for part in calibration.parts:
        if part.rstrip("0123456789") in _OTHERS[camera.application]:
            _refuse(calibration, f"a calibration with {part}", f"one of a {camera.application} camera")
    sizes = {"sensor": tuple(camera.snapshot_shape[-2:])}
    if not isinstance(camera, SpectralDepthCamera):
        sizes["codes"] = tuple(camera.multiplexed.aperture.size)  # type: ignore[union-attr, arg-type]
    for what, size in sizes.items():
        if own.get(what) and tuple(own[what]) != size:
            found, known = ("×".join(map(str, n)) for n in (own[what], size))
            _refuse(calibration, f"{what} of {found} pixels", f"{known}, those of the snapshot's camera")
    _check_date(calibration, said.get("codes_date"))


def _refuse(calibration: Calibration, found: str, expected: str) -> None:
    raise DataError(calibration.where, found, expected, "name the calibration of this camera")


def _check_date(calibration: Calibration, stated: object) -> None:
    if stated is None or calibration.created is None:
        return
    try:
        date = datetime.fromisoformat(str(stated))
    except ValueError:
        raise DataError("codes_date", repr(stated), "a date such as 2026-03-31T12:00:00+00:00") from None
    date = date if date.tzinfo else date.replace(tzinfo=UTC)
    if calibration.created < date:
        found = f"a calibration of {calibration.created:%Y-%m-%d %H:%M}"
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
        return _spectral(camera, calibration, sensor)
    if isinstance(camera, LightFieldCamera):
        return _light_field(camera, calibration, sensor)
    if isinstance(camera, SpectralDepthCamera):
        return _spectral_depth(camera, calibration, sensor)
    raise SettingError("camera", type(camera).__name__, "a spectral, light-field or spectral-depth camera")


def calibrated_snapshot(snapshot: Snapshot[Any], calibration: Calibration) -> Snapshot[Any]:
    """A capture on the planes of its calibrated camera.

    Values in digital numbers (attribute ``values = "digital numbers"``) become relative irradiance by dark, flat and
    the level of white. Defective pixels, and columns that the sensor does not have, are 0 where the shutter is closed
    all the time.

    Raises:
        DataError: digital numbers without dark and flat, or see ``calibrated``.
    """
    camera = calibrated(snapshot.camera, calibration, snapshot.notes)
    values = snapshot.values
    if snapshot.notes.get("values") == RAW:
        values = from_digital_numbers(values, calibration, camera.full_scale)
    if isinstance(camera, SpectralCamera):
        place = _columns(snapshot.camera, camera)
        values = place.laid(values)
    if not isinstance(camera, SpectralDepthCamera):
        values = values * (camera.codes()[1].amax(0) > 0)
    notes = {k: v for k, v in snapshot.notes.items() if k != "values"}
    return Snapshot(values, camera, {**notes, "calibration": calibration.where})


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


def _mixed(codes: Tensor, calibration: Calibration) -> tuple[Array, float]:
    """(K, h, w) what the aperture shows during every slot of the shutter, and the light by which a slot is longer."""
    planes, timing = codes.detach().double().numpy(), calibration.part("timing")
    if timing is None:
        return planes, 1.0
    if timing.slots != len(planes):
        where, wanted = calibration.where, f"{len(planes)}, those of the codes"
        raise DataError(where, f"a timing of {timing.slots} slots", wanted, "measure the timing of these codes")
    overlap = timing.overlap()
    longest = max(1.0, float(overlap.sum(axis=0).max()))
    return np.tensordot(overlap.T / longest, planes, 1), longest


def _open_shutter(shutter: Tensor, calibration: Calibration) -> Array:
    """(K, H, W) the shutter, closed over defective pixels."""
    planes, bad = shutter.detach().double().numpy(), defects(calibration)
    return planes if bad is None else np.where(bad, 0.0, planes)


@dataclass(frozen=True)
class _Columns:
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


def _columns(nominal: SpectralCamera, camera: SpectralCamera) -> _Columns:
    return _Columns(nominal.dispersion.origin - camera.dispersion.origin, camera.snapshot_shape[2])


def _spectral(camera: SpectralCamera, calibration: Calibration, sensor: Any) -> SpectralCamera:
    if camera.disperser == "dual" or camera.coloured is not None:
        raise SettingError("camera", "a dual disperser or coloured aperture", "a single disperser to calibrate")
    aperture, shutter = camera.codes()
    planes, light = _mixed(aperture, calibration)
    registration, start = calibration.part("registration"), _reference(camera, calibration)
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
    place = _Columns(camera.dispersion.origin - dispersion.origin, camera.size[1] + dispersion.spread)
    return SpectralCamera(
        camera.wavelengths, camera.size, camera.slots, aperture=_codes(planes),
        shutter=_codes(place.laid(_open_shutter(shutter, calibration))), exposure=camera.exposure,
        dispersion=dispersion, response=_codes(response), relay_blur=camera.relay_blur, sensor=sensor,
    )  # fmt: skip


def _reference(camera: SpectralCamera, calibration: Calibration) -> float:
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


def _light_field(camera: LightFieldCamera, calibration: Calibration, sensor: Any) -> LightFieldCamera:
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


def _spectral_depth(camera: SpectralDepthCamera, calibration: Calibration, sensor: Any) -> SpectralDepthCamera:
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
        period=camera.period, channels=camera.response, exposure=camera.exposure, energy=camera.spread.energy,
        image_formation=camera.image_formation, sensor=sensor,
    )  # fmt: skip
