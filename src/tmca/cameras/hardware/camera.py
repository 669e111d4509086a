"""A camera on a bench with faults, beside the one that the decoder knows."""

from __future__ import annotations

from typing import Any, TypeVar

from tmca.cameras.camera import Camera, sharing
from tmca.cameras.coded import CodedCamera
from tmca.cameras.hardware.codes import ImperfectCodes, ImperfectPlane, ShutterFaults
from tmca.cameras.hardware.dispersion import DisplacedCamera, beyond, over
from tmca.cameras.hardware.faults import Hardware
from tmca.cameras.hardware.mask import ImperfectHeights, aberrated, aberration
from tmca.cameras.hardware.sensor import DefectiveSensor
from tmca.cameras.light_field import LightFieldCamera
from tmca.cameras.spectral import SpectralCamera
from tmca.cameras.spectral_depth import SpectralDepthCamera
from tmca.codes import Outside, misplaced
from tmca.errors import SettingError
from tmca.optics import Dispersion, ViewShear
from tmca.sensor import Sensor

COLOURED = ("misregistration", "magnification", "rotation", "dispersion_error", "hot_pixels", "dead_pixels")
"""Faults of a coloured aperture, which neither changes nor has a shutter."""
SomeCamera = TypeVar("SomeCamera", bound=Camera)


def imperfect(camera: SomeCamera, hardware: Hardware, seed: int = 0, outside: Outside = "edge") -> SomeCamera:
    """The camera as its bench really is: it images and records with the faults, in the same units and sizes.

    Codes are shared, so that both follow them while they are learned. What it records is for the camera itself, as it
    is known, to decode.

    Args:
        camera: as it is known.
        hardware: its faults.
        seed: of jitter, aberration, hot and dead pixels.
        outside: what is seen beside a coded aperture that is displaced: its edge continued, or nothing.

    Raises:
        SettingError: a fault that this camera cannot have (a coloured aperture has those of ``COLOURED`` alone).
    """
    hardware.check(camera.kind)
    if not set(hardware.faults()) - {"motion"}:  # of the scene, not of the camera
        return camera
    found: Any = sharing(camera)
    if isinstance(camera, SpectralCamera):
        _spectral(found, hardware, seed, outside)
    elif isinstance(camera, LightFieldCamera):
        _light_field(found, hardware, seed, outside)
    elif isinstance(camera, SpectralDepthCamera):
        _spectral_depth(found, hardware, seed)
    found.sensor = defective(camera.sensor, hardware, seed)
    return found


def defective(sensor: Sensor, hardware: Hardware, seed: int = 0) -> Sensor:
    """The sensor with its hot and dead pixels; itself without any.

    Args:
        sensor: as it is known.
        hardware: shares of hot and dead pixels.
        seed: of their places.
    """
    if not (hardware.hot_pixels or hardware.dead_pixels):
        return sensor
    return DefectiveSensor(hardware.hot_pixels, hardware.dead_pixels, seed, **sensor.settings())


def _spectral(camera: SpectralCamera, hardware: Hardware, seed: int, outside: Outside) -> None:
    if camera.coloured is not None:
        _check_coloured(hardware)
    for name in ("dispersion_error", "blur"):
        if camera.disperser == "dual" and getattr(hardware, name):
            raise SettingError(name, f"{getattr(hardware, name):g}", "0 with a dual disperser")
    beside = (0, 0)
    if hardware.dispersion_error:
        known = camera.dispersion
        camera.dispersion = over(_stretched(known, hardware.dispersion_error), known)
        beside = beyond(camera.dispersion, known)
        camera.__class__, camera.beside = DisplacedCamera, beside  # type: ignore[assignment]
    if hardware.blur:
        known_blur = camera.relay_blur if isinstance(camera.relay_blur, list) else [camera.relay_blur] * camera.bands
        camera.relay_blur = [(one**2 + hardware.blur**2) ** 0.5 for one in known_blur]
    if camera.coloured is not None:
        camera.coloured = misplaced(camera.coloured, hardware.shift, hardware.magnification, hardware.rotation)
        return
    _coded(camera, hardware, seed, tuple(camera.codes()[0].shape[1:]), beside=beside, outside=outside)


def _check_coloured(hardware: Hardware) -> None:
    for name, value in hardware.faults().items():
        if name not in COLOURED:
            raise SettingError(name, str(value), f"none of a coloured aperture, which has {', '.join(COLOURED)}")


def _stretched(known: Dispersion, error: float) -> Dispersion:
    middle = (min(known.displacement) + max(known.displacement)) / 2
    return Dispersion(tuple(middle + (d - middle) * (1 + error) for d in known.displacement))


def _light_field(camera: LightFieldCamera, hardware: Hardware, seed: int, outside: Outside) -> None:
    y, x = (one * (1 + hardware.shear_error) for one in camera.shear.step)
    camera.shear = ViewShear(camera.shear.views, (y, x), camera.shear.scale)
    _coded(camera, hardware, seed, camera.mask_size, blur=hardware.blur, outside=outside)


def _coded(camera: CodedCamera, hardware: Hardware, seed: int, size: Any, **how: Any) -> None:
    camera._fixed = None
    faults = ShutterFaults(hardware, camera.slots, camera.size[0], seed)
    camera.codes = ImperfectCodes(camera.codes, faults, hardware, size, **how)  # type: ignore[assignment]


def _spectral_depth(camera: SpectralDepthCamera, hardware: Hardware, seed: int) -> None:
    camera._kept = None
    faults = ShutterFaults(hardware, camera.slots, camera.size[0], seed)
    camera.shutter = ImperfectPlane(camera.shutter, faults)  # type: ignore[assignment]
    if hardware.height_error or hardware.wavefront_error:
        spread = camera.spread = sharing(camera.spread)
        path = aberration(hardware.wavefront_error, spread.heights.size, seed)
        spread.waves = aberrated(spread.waves, path, camera.wavelengths)
        spread.heights = ImperfectHeights(spread.heights, hardware.height_error)
