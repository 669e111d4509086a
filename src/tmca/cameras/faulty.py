"""A camera on a bench with faults, beside the one that is known: wrappers around its codes, optics and sensor."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

from tmca.cameras.camera import Camera
from tmca.cameras.light_field import LightFieldCamera
from tmca.cameras.spectral import SpectralCamera
from tmca.cameras.spectral_depth import PhaseCodes, SpectralDepthCamera
from tmca.codes import Outside, leaked, misplaced, slot_overlap, through_time
from tmca.codes.buckets import bucket_shutters, changing, mixed_buckets
from tmca.errors import SettingError
from tmca.optics import Dispersion, ViewShear, gaussian_psf
from tmca.optics.zernike import noll, zernike_modes
from tmca.sensor import Sensor
from tmca.specs.hardware import Hardware

COLOURED = ("misregistration", "magnification", "rotation", "dispersion_error", "hot_pixels", "dead_pixels")
"""Faults of a coloured aperture, which neither changes nor has a shutter."""
_ABERRATIONS = range(4, 16)
"""Noll's numbers of the modes of a drawn wavefront: defocus to the fourth order, no piston and no tilt."""
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
    hardware.check(camera.kind, camera.buckets)
    if not set(hardware.faults()) - {"motion"}:  # of the scene, not of the camera
        return camera
    faults = ShutterFaults(hardware, camera.slots, camera.size[0], seed, camera.buckets)
    parts: dict[str, Any] = {}
    if isinstance(camera, SpectralCamera):
        parts = _spectral(camera, hardware, faults, outside)
    elif isinstance(camera, LightFieldCamera):
        parts = _light_field(camera, hardware, faults, outside)
    elif isinstance(camera, SpectralDepthCamera):
        parts = _spectral_depth(camera, hardware, faults, seed)
    return camera.replace(**parts, sensor=defective(camera.sensor, hardware, seed, camera.buckets))


def defective(sensor: Sensor, hardware: Hardware, seed: int = 0, buckets: int = 1) -> Sensor:
    """The sensor with its hot and dead pixels and unequal buckets; itself without any.

    Args:
        sensor: as it is known.
        hardware: shares of hot and dead pixels, gain and offset of later buckets.
        seed: of the defects' places.
        buckets: R of a pixel.
    """
    if not (hardware.hot_pixels or hardware.dead_pixels or hardware.bucket_gain or hardware.bucket_offset):
        return sensor
    return DefectiveSensor(hardware, seed, buckets, **sensor.settings())


def _spectral(camera: SpectralCamera, hardware: Hardware, faults: ShutterFaults, outside: Outside) -> dict[str, Any]:
    for name in ("dispersion_error", "blur"):
        if camera.disperser == "dual" and getattr(hardware, name):
            raise SettingError(name, f"{getattr(hardware, name):g}", "0 with a dual disperser")
    parts: dict[str, Any] = {}
    if hardware.dispersion_error:
        parts |= _dispersed(camera.dispersion, hardware.dispersion_error)
    if hardware.blur:
        blurs = camera.relay_blur
        sigmas = [blurs] * camera.bands if isinstance(blurs, float) else blurs
        parts["relay_blur"] = [(sigma**2 + hardware.blur**2) ** 0.5 for sigma in sigmas]
    if camera.coloured is not None:
        _check_coloured(hardware)
        coloured = misplaced(camera.coloured, hardware.shift, hardware.magnification, hardware.rotation)
        return {**parts, "coloured": coloured}
    rows, columns = camera.codes()[0].shape[1:]
    return {**parts, "codes": FaultyCodes(camera.codes, faults, hardware, (rows, columns), outside=outside)}


def _dispersed(dispersion: Dispersion, error: float) -> dict[str, Any]:
    """A dispersion that is stretched about its middle, on the sensor that was laid out for the right one."""
    middle = (min(dispersion.displacement) + max(dispersion.displacement)) / 2
    stretched = Dispersion(tuple(middle + (d - middle) * (1 + error) for d in dispersion.displacement))
    ends = [(one.origin, one.origin + one.extent) for one in (dispersion, stretched)]
    first, last = min(begin for begin, _ in ends), max(end for _, end in ends)
    wide = WideDispersion(stretched.displacement, first, last - first)
    return {"dispersion": wide, "beside": (ends[0][0] - first, last - ends[0][1])}


def _check_coloured(hardware: Hardware) -> None:
    for name, value in hardware.faults().items():
        if name not in COLOURED:
            raise SettingError(name, str(value), f"none of a coloured aperture, which has {', '.join(COLOURED)}")


def _light_field(
    camera: LightFieldCamera, hardware: Hardware, faults: ShutterFaults, outside: Outside
) -> dict[str, Any]:
    y, x = (step * (1 + hardware.shear_error) for step in camera.shear.step)
    size = ViewShear(camera.views, (y, x), camera.shear.scale).mask_size(camera.size)
    codes = FaultyCodes(camera.codes, faults, hardware, size, blur=hardware.blur, outside=outside)
    return {"shear": (y, x), "codes": codes}


def _spectral_depth(
    camera: SpectralDepthCamera, hardware: Hardware, faults: ShutterFaults, seed: int
) -> dict[str, Any]:
    optics = camera.point_spread
    if hardware.height_error or hardware.wavefront_error:
        path = aberration(hardware.wavefront_error, optics.heights.size, seed)
        waves = aberrated(optics.waves, path, camera.wavelengths)
        optics = optics.behind(FaultyHeights(optics.heights, hardware.height_error), waves)
    return {"codes": PhaseCodes(optics, FaultyShutter(camera.shutter, faults))}


def in_turn(steps: Tensor) -> Tensor:
    """Times (…, K) of a shutter's steps, none before the one ahead of it, none in the next exposure.

    A pattern whose successor is already due is left out: no time is recorded twice.
    """
    return torch.minimum(steps.cummax(-1).values, steps[..., :1] + steps.shape[-1])


class ShutterFaults(nn.Module):
    """What becomes of shutter patterns (K, H, W): leakage, everything that is not in time, and light between buckets.

    Args:
        hardware: faults.
        slots: K.
        rows: of the sensor.
        seed: of the jitter.
        buckets: R of a pixel.
    """

    overlap: Tensor
    lost: Tensor

    def __init__(self, hardware: Hardware, slots: int, rows: int, seed: int = 0, buckets: int = 1) -> None:
        super().__init__()
        self.leakage, self.transfer, self.slots, self.buckets = hardware.leakage, hardware.transfer, slots, buckets
        late = hardware.delay + hardware.rolling * torch.linspace(0, 1, rows, dtype=torch.float64)[:, None]
        source = torch.Generator().manual_seed(seed)
        drawn = torch.arange(slots) + late + hardware.jitter * torch.randn(slots, generator=source).double()
        steps = in_turn(drawn)
        ends = torch.cat((steps[:, 1:], steps[:, :1] + slots), 1)
        starts = torch.minimum(steps + hardware.dead_time, ends)
        self.register_buffer("overlap", slot_overlap(slots, starts, ends, hardware.switching))
        moved = torch.minimum(starts + hardware.transfer, ends)
        self.register_buffer("lost", slot_overlap(slots, starts, moved, hardware.switching))
        self.timed = bool((self.overlap - torch.eye(slots)).abs().max() > 1e-12)

    def forward(self, shutter: Tensor) -> Tensor:
        """(K, H, W) → (K, H, W), grey; of several buckets → (R·K, H, W), what each of them collects."""
        if self.buckets == 1:
            return self._in_time(leaked(shutter, self.leakage))
        collected = bucket_shutters(shutter, self.slots, self.buckets)
        parts = [self._in_time(part) for part in collected]
        if self.transfer:
            moved = [through_time(part, self.lost) for part in changing(collected)]
            parts = [part - lost for part, lost in zip(parts, moved, strict=True)]
        return mixed_buckets(torch.stack(parts), self.leakage).flatten(0, 1)

    def _in_time(self, leaking: Tensor) -> Tensor:
        return through_time(leaking, self.overlap) if self.timed else leaking


class FaultyCodes(nn.Module):
    """Codes of both planes as a bench shows them.

    Args:
        codes: the module that gives (aperture, shutter).
        shutter: faults of the shutter.
        hardware: those of the aperture.
        size: (H, W) of the aperture plane that is seen.
        blur: standard deviation by which the aperture's image is blurred, pixels.
        outside: what is beside the aperture.
    """

    def __init__(
        self,
        codes: nn.Module,
        shutter: ShutterFaults,
        hardware: Hardware,
        size: tuple[int, int],
        *,
        blur: float = 0.0,
        outside: Outside = "edge",
    ) -> None:
        super().__init__()
        self.codes, self.faults, self.hardware, self.size, self.outside = codes, shutter, hardware, size, outside
        self.kernel = gaussian_psf(blur, 1) if blur else None

    @property
    def learnable(self) -> bool:
        """Whether either plane is learned."""
        return bool(self.codes.learnable)

    def forward(self) -> tuple[Tensor, Tensor]:
        """(aperture (K, H, Wa), shutter (K, H, W') or (R·K, H, W')), grey."""
        aperture, shutter = self.codes()
        hardware = self.hardware
        shift = hardware.shift
        placed = misplaced(aperture, shift, hardware.magnification, hardware.rotation, self.size, self.outside)
        return self._blurred(leaked(placed, 1 / hardware.contrast_ratio)), self.faults(shutter)

    def _blurred(self, aperture: Tensor) -> Tensor:
        if self.kernel is None:
            return aperture
        reach = self.kernel.shape[-1] // 2
        edged = torch.nn.functional.pad(aperture[:, None], (reach,) * 4, mode="replicate")
        return torch.nn.functional.conv2d(edged, self.kernel[:, None].to(edged))[:, 0].clamp(0, 1)


class FaultyShutter(nn.Module):
    """A shutter plane as a sensor shows it.

    Args:
        plane: (K, H, W) patterns.
        faults: of the shutter.
    """

    period = None

    def __init__(self, plane: nn.Module, faults: ShutterFaults) -> None:
        super().__init__()
        self.plane, self.faults = plane, faults

    def forward(self) -> Tensor:
        """(K, H, W), grey."""
        shown: Tensor = self.faults(self.plane())
        return shown

    def part(self, rows: slice, columns: slice) -> Tensor:
        """(K, h, w) over some pixels."""
        return self()[:, rows, columns]


class FaultyHeights(nn.Module):
    """Height maps of a device whose scale is not the one that is known.

    Args:
        heights: (K, H, W) metres.
        error: share by which all differ.
    """

    def __init__(self, heights: nn.Module, error: float) -> None:
        super().__init__()
        self.heights, self.error, self.size = heights, error, heights.size

    def forward(self) -> Tensor:
        """(K, H, W) metres."""
        scaled: Tensor = self.heights() * (1 + self.error)
        return scaled


def aberration(rms: float, size: tuple[int, int], seed: int) -> Tensor:
    """(H, W) metres of path, drawn, of this root mean square over the pupil."""
    modes = zernike_modes([noll(index) for index in _ABERRATIONS], size).double()
    drawn = torch.randn(len(modes), generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return torch.tensordot(rms * drawn / drawn.norm(), modes, 1)


def aberrated(waves: Tensor, path: Tensor, wavelengths: tuple[float, ...]) -> Tensor:
    """Fields (D, L, H, W) after a path (H, W) in metres."""
    turns = path.to(waves.device) / torch.tensor(wavelengths, dtype=path.dtype, device=waves.device)[:, None, None]
    return waves * torch.polar(torch.ones_like(turns), 2 * pi * turns).to(waves)


@dataclass(frozen=True)
class WideDispersion(Dispersion):
    """A dispersion on a sensor that is wider than it needs.

    Args:
        displacement: one value per band, pixels.
        first: scene column on which snapshot column 0 lies.
        wider: columns that the snapshot is wider than the scene.
    """

    first: int
    wider: int

    @property
    def origin(self) -> int:
        return self.first

    @property
    def extent(self) -> int:
        return self.wider


class DefectiveSensor(Sensor):
    """A sensor some of whose pixels are stuck at full scale or at zero, and whose buckets differ.

    Args:
        hardware: shares of hot and dead pixels; gain and offset of the second and later buckets.
        seed: of the defects' places, which every snapshot has alike.
        buckets: R of a pixel, whose channels come one bucket after the other.
        settings: of the sensor.
    """

    def __init__(self, hardware: Hardware, seed: int = 0, buckets: int = 1, **settings: Any) -> None:
        super().__init__(**settings)
        self.hardware, self.seed, self.buckets = hardware, seed, buckets

    def forward(
        self,
        irradiance: Tensor,
        full_scale: float,
        generator: torch.Generator | int | None = None,
        exposures: int = 1,
    ) -> Tensor:
        recorded, hardware = super().forward(irradiance, full_scale, generator, exposures), self.hardware
        first, later = recorded.tensor_split([recorded.shape[1] // self.buckets], 1)
        read = later * (1 + hardware.bucket_gain) + hardware.bucket_offset * full_scale * exposures
        recorded = torch.cat((first, read), 1)
        drawn = torch.rand(recorded.shape[1:], generator=torch.Generator().manual_seed(self.seed)).to(recorded.device)
        hot, dead = hardware.hot_pixels, hardware.dead_pixels
        recorded = torch.where(drawn < hot, full_scale * exposures, recorded)
        return torch.where((drawn >= hot) & (drawn < hot + dead), 0.0, recorded)
