"""Which frames a step of a calibration needs: under which light, with which codes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from tmca.cameras import Camera, LightFieldCamera, SpectralCamera, SpectralDepthCamera
from tmca.data import metres_to_nm
from tmca.errors import SettingError
from tmca.lab.devices.captures import Step
from tmca.lab.devices.light import Light
from tmca.lab.devices.manifest import exposed_whole, frame_time

PATTERNS, OPEN, CODES = "patterns", "open", "codes"
REFLECTANCE = 0.5
_EXPOSURES = (0.1, 0.25, 0.4, 0.6, 0.8, 1.0, 1.2, 1.5, 1.8, 2.2)
_APART = 2
"""Slots that aperture and shutter may be apart: farther ones are as dark as these."""


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
        if self.frames < 2:
            raise SettingError("--frames", str(self.frames), "2 or more, for the noise")
        if not 0 <= self.pattern < self.count + 2:
            raise SettingError("--pattern", str(self.pattern), f"0 to {self.count + 1}")


@dataclass(frozen=True)
class Shot:
    """One frame.

    Args:
        name: of its file.
        light: before the camera.
        shown: name of the codes on the devices: ``patterns``, ``open``, ``aperture_I_shutter_J``, or ``codes``, those
            of the export.
        slot: of them; None for all shut, or for a whole exposure.
        whole: whether it is a whole exposure, in which the sensor codes its shutter.
    """

    name: str
    light: Light
    shown: str
    slot: int | None
    whole: bool = False

    @property
    def step(self) -> Step:
        """As a frame of a capture."""
        return Step(self.name, self.slot, self.name)


def steps_of(camera: Camera, manifest: dict[str, Any]) -> tuple[str, ...]:
    """Steps of a camera behind the devices of an export, in their order.

    One slot has no timing: no other one says when it begins and ends.
    """
    if isinstance(camera, SpectralDepthCamera):
        return ("dark", *(f"psf{slot}" for slot in range(camera.slots)))
    timed = ("timing",) if exposed_whole(manifest) and camera.slots > 1 else ()
    last = "dispersion" if isinstance(camera, SpectralCamera) else "shear"
    return ("dark", "flat", "white", "linearity", "registration", *timed, last)


def shots_of(step: str, camera: Camera, manifest: dict[str, Any], asked: Asked) -> list[Shot]:
    """Frames of a step, named as `tmca calibrate` knows them.

    Raises:
        SettingError: a step that this camera does not have, or needs a wavelength.
    """
    known = steps_of(camera, manifest)
    if step not in known:
        raise SettingError("step", repr(step), f"one of this camera behind these devices: {', '.join(known)}")
    if step.startswith("psf"):
        return _psf(int(step.removeprefix("psf")), asked)
    return _MADE[step](camera, manifest, asked)


def _repeated(name: str, light: Light, asked: Asked, **shown: Any) -> list[Shot]:
    return [Shot(f"{name}_{n}", light, OPEN, **shown) for n in range(asked.frames)]


def _dark(camera: Camera, manifest: dict[str, Any], asked: Asked) -> list[Shot]:
    shown = CODES if isinstance(camera, SpectralDepthCamera) else OPEN
    return [Shot(f"dark_{n}", Light("none"), shown, None) for n in range(asked.frames)]


def _flat(camera: Camera, manifest: dict[str, Any], asked: Asked) -> list[Shot]:
    return _repeated("flat", Light("even", reflectance=REFLECTANCE), asked, **_as_a_frame(manifest))


def _white(camera: Camera, manifest: dict[str, Any], asked: Asked) -> list[Shot]:
    return _repeated("white", Light("white", reflectance=asked.reflectance), asked, **_as_a_frame(manifest))


def _as_a_frame(manifest: dict[str, Any]) -> dict[str, Any]:
    """Exposed as a frame of a capture is."""
    return {"slot": None, "whole": True} if exposed_whole(manifest) else {"slot": 0}


def _linearity(camera: Camera, manifest: dict[str, Any], asked: Asked) -> list[Shot]:
    usual, how = frame_time(manifest) * 1e3, _as_a_frame(manifest)
    lights = [(usual * one, Light("even", reflectance=REFLECTANCE, exposure=one)) for one in asked.exposures]
    return [Shot(f"even_{time:.6g}ms_{n}", light, OPEN, **how) for time, light in lights for n in range(2)]


def _registration(camera: Camera, manifest: dict[str, Any], asked: Asked) -> list[Shot]:
    if isinstance(camera, LightFieldCamera):
        light = Light("white", view=(0, 0))
    else:
        light = Light("white", wavelength=_wavelengths(asked, "registration")[0])
    return [Shot(f"pattern_{k}", light, PATTERNS, k) for k in range(2 + asked.count)]


def _timing(camera: Camera, manifest: dict[str, Any], asked: Asked) -> list[Shot]:
    slots = range(manifest["slots"])
    pairs = [(i, j) for i in slots for j in slots if min((i - j) % len(slots), (j - i) % len(slots)) <= _APART]
    return [Shot(name, Light("white"), name, None, True) for name in (pair_name(*pair) for pair in pairs)]


def pair_name(aperture: int, shutter: int) -> str:
    """Of the frame with one slot of each open."""
    return f"aperture_{aperture}_shutter_{shutter}"


def _dispersion(camera: Camera, manifest: dict[str, Any], asked: Asked) -> list[Shot]:
    lights = [(wave, Light("white", wavelength=wave)) for wave in _wavelengths(asked, "dispersion")]
    return [Shot(f"band_{metres_to_nm(wave):g}nm", light, PATTERNS, asked.pattern) for wave, light in lights]


def _shear(camera: Camera, manifest: dict[str, Any], asked: Asked) -> list[Shot]:
    assert isinstance(camera, LightFieldCamera)
    rows, columns = (range(-(n // 2), n - n // 2) for n in camera.views)
    places = [(v, u) for v in rows for u in columns]
    return [Shot(f"view_{v}_{u}", Light("white", view=(v, u)), PATTERNS, asked.pattern) for v, u in places]


def _psf(slot: int, asked: Asked) -> list[Shot]:
    if len(asked.depths) < 2:
        raise SettingError("--depth", f"{len(asked.depths)} of them", "two or more for psf, metres, METRES,METRES")
    pairs = [(z, wave) for z in asked.depths for wave in _wavelengths(asked, "psf")]
    return [
        Shot(f"point_{z:.6g}m_{metres_to_nm(wave):g}nm", Light("point", wavelength=wave, depth=z), CODES, slot)
        for z, wave in pairs
    ]


def _wavelengths(asked: Asked, step: str) -> Sequence[float]:
    if not asked.wavelengths:
        raise SettingError("--wavelength", "none", f"that of the light for {step}, in nm")
    return asked.wavelengths


_MADE: dict[str, Callable[[Camera, dict[str, Any], Asked], list[Shot]]] = {
    "dark": _dark, "flat": _flat, "white": _white, "linearity": _linearity, "registration": _registration,
    "timing": _timing, "dispersion": _dispersion, "shear": _shear,
}  # fmt: skip


def lights_of(shots: Sequence[Shot]) -> list[Light]:
    """Different lights of some frames, in their order."""
    return list(dict.fromkeys(shot.light for shot in shots))
