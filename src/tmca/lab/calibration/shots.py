"""Which frames a step of a calibration needs: under which light, with which codes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from tmca.cameras import Camera
from tmca.data import metres_to_nm
from tmca.errors import SettingError, check_range
from tmca.lab.acquisition.captures import CaptureFrame
from tmca.lab.cameras import lab_camera
from tmca.lab.cameras.base import Light
from tmca.lab.display.manifest import buckets_of, exposed_whole, frame_time

PATTERNS, OPEN, CODES = "patterns", "open", "codes"
BUCKET, IN_TURN = "bucket_", "in_turn"
REFLECTANCE = 0.5
_EXPOSURES = (0.1, 0.25, 0.4, 0.6, 0.8, 1.0, 1.2, 1.5, 1.8, 2.2)
_APART = 2
"""Slots that aperture and shutter may be apart: farther ones are as dark as these."""
Manifest = dict[str, Any]


@dataclass(frozen=True)
class Asked:
    """What a step is asked for.

    Args:
        frames: of each kind for dark, flat and white.
        wavelengths: metres, of registration (the first), dispersion and point.
        depths: metres, of the point.
        pattern: that dispersion and shear show.
        count: of coded patterns.
        reflectance: of the white reference.
        exposures: of the linearity, as multiples of a frame's.
    """

    frames: int = 16
    wavelengths: tuple[float, ...] = ()
    depths: tuple[float, ...] = ()
    pattern: int = 3
    count: int = 2
    reflectance: float = REFLECTANCE
    exposures: tuple[float, ...] = _EXPOSURES

    def __post_init__(self) -> None:
        if not 0 < self.reflectance <= 1:
            raise SettingError("--reflectance", f"{self.reflectance:g}", "a share of white, above 0 and up to 1")
        check_range("--frames", self.frames, 2, whole=True)
        check_range("--pattern", self.pattern, 0, self.count + 1, whole=True)

    def waves(self, step: str) -> tuple[float, ...]:
        """The wavelengths, of which the step needs one."""
        if not self.wavelengths:
            raise SettingError("--wavelength", "none", f"that of the light for {step}, in nm")
        return self.wavelengths


@dataclass(frozen=True)
class Shot:
    """One frame.

    Args:
        name: of its file.
        light: before the camera.
        shown: name of the codes on the devices: ``patterns``, ``open`` (all slots in the first bucket), ``bucket_R``
            (in another), ``in_turn`` (in one after the other), ``aperture_I_shutter_J``, or ``codes``, those of the
            export.
        slot: of them; None for all shut, or for a whole exposure.
        whole: whether it is a whole exposure, in which the sensor codes its shutter.
    """

    name: str
    light: Light
    shown: str
    slot: int | None
    whole: bool = False

    @property
    def frame(self) -> CaptureFrame:
        """As a frame of a capture."""
        return CaptureFrame(self.name, self.slot, self.name)


def dark(camera: Camera, manifest: Manifest, asked: Asked, slot: int) -> Iterable[Shot]:
    shown = OPEN if lab_camera(camera).masked else CODES
    return [Shot(f"dark_{n}", Light("none"), shown, None) for n in range(asked.frames)]


def flat(camera: Camera, manifest: Manifest, asked: Asked, slot: int) -> Iterable[Shot]:
    light, how = Light("even", reflectance=REFLECTANCE), _as_a_frame(manifest)
    if (count := buckets_of(manifest)) == 1:
        return [Shot(f"flat_{n}", light, OPEN, *how) for n in range(asked.frames)]
    shown = [f"{BUCKET}{bucket}" for bucket in range(count)]
    return [Shot(f"flat_{name}_{n}", light, name, *how) for name in shown for n in range(asked.frames)]


def white(camera: Camera, manifest: Manifest, asked: Asked, slot: int) -> Iterable[Shot]:
    light, how = Light("white", reflectance=asked.reflectance), _as_a_frame(manifest)
    return [Shot(f"white_{n}", light, OPEN, *how) for n in range(asked.frames)]


def linearity(camera: Camera, manifest: Manifest, asked: Asked, slot: int) -> Iterable[Shot]:
    usual, how = frame_time(manifest) * 1e3, _as_a_frame(manifest)
    lights = [(usual * one, Light("even", reflectance=REFLECTANCE, exposure=one)) for one in asked.exposures]
    return [Shot(f"even_{time:.6g}ms_{n}", light, OPEN, *how) for time, light in lights for n in range(2)]


def registration(camera: Camera, manifest: Manifest, asked: Asked, slot: int) -> Iterable[Shot]:
    light = lab_camera(camera).registration_light(asked.wavelengths)
    return [Shot(f"pattern_{k}", light, PATTERNS, k) for k in range(2 + asked.count)]


def timing(camera: Camera, manifest: Manifest, asked: Asked, slot: int) -> Iterable[Shot]:
    slots = range(manifest["slots"])
    pairs = [(i, j) for i in slots for j in slots if min((i - j) % len(slots), (j - i) % len(slots)) <= _APART]
    return [Shot(name, Light("white"), name, None, True) for name in (pair_name(*pair) for pair in pairs)]


def buckets(camera: Camera, manifest: Manifest, asked: Asked, slot: int) -> Iterable[Shot]:
    light, slots = Light("even", reflectance=REFLECTANCE), int(manifest["slots"])
    names = {f"{BUCKET}{bucket}": f"{BUCKET}{bucket}" for bucket in range(buckets_of(manifest))}
    names |= {IN_TURN: f"{IN_TURN}_{slots}"} if slots > 1 else {}
    return [Shot(f"{name}_{n}", light, shown, None, True) for shown, name in names.items() for n in range(2)]


def pair_name(aperture: int, shutter: int) -> str:
    """Of the frame with one slot of each open."""
    return f"aperture_{aperture}_shutter_{shutter}"


def dispersion(camera: Camera, manifest: Manifest, asked: Asked, slot: int) -> Iterable[Shot]:
    return [
        Shot(f"band_{metres_to_nm(wave):g}nm", Light("white", wavelength=wave), PATTERNS, asked.pattern)
        for wave in asked.waves("dispersion")
    ]


def shear(camera: Any, manifest: Manifest, asked: Asked, slot: int) -> Iterable[Shot]:
    rows, columns = (range(-(n // 2), n - n // 2) for n in camera.views)
    places = [(v, u) for v in rows for u in columns]
    return [Shot(f"view_{v}_{u}", Light("white", view=(v, u)), PATTERNS, asked.pattern) for v, u in places]


def psf(camera: Camera, manifest: Manifest, asked: Asked, slot: int) -> Iterable[Shot]:
    if len(asked.depths) < 2:
        raise SettingError("--depth", f"{len(asked.depths)} of them", "two or more for psf, metres, METRES,METRES")
    return [
        Shot(f"point_{z:.6g}m_{metres_to_nm(wave):g}nm", Light("point", wavelength=wave, depth=z), CODES, slot)
        for z in asked.depths
        for wave in asked.waves("psf")
    ]


def _as_a_frame(manifest: Manifest) -> tuple[int | None, bool]:
    """Slot, and whether it is whole, as a frame of a capture is exposed."""
    return (None, True) if exposed_whole(manifest) else (0, False)
