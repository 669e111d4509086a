"""A bench that is computed: a scene or a lamp, the camera as it really is, its sensor's digital numbers."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.cameras import (
    Camera,
    Hardware,
    LightFieldCamera,
    SpectralCamera,
    SpectralDepthCamera,
    imperfect,
    moving_scenes,
)
from tmca.cameras.motion import check_displacement
from tmca.data import metres_to_nm
from tmca.errors import DeviceError, SettingError
from tmca.lab.acquisition.drivers import Light
from tmca.lab.acquisition.shown_camera import of_one_slot, seen_in_frame, showing, sub_exposed
from tmca.lab.display.export import Export
from tmca.lab.display.manifest import exposed_whole, read_export

_BRIGHT = 0.8
"""Of the full scale, that the brightest single wavelength or view reaches."""
_NEAR = 1e-10
"""Metres between a wavelength and its band."""


def lit_scene(camera: Any, light: Light) -> tuple[Tensor, ...]:
    """What a camera images: (1, …) of a white surface under a light, one wavelength or view as bright as the sensor
    bears; (1, L, H, W) of a point and its depth (1, 1, H, W).

    Raises:
        DeviceError: a camera, wavelength or view that is not simulated.
    """
    if light.kind == "point":
        return _point(camera, light)
    shares = _shares(camera, light)
    shape = tuple(camera.scene_shape)
    share = torch.from_numpy(shares).float().reshape(1, *shares.shape, *(1 for _ in shape[shares.ndim :]))
    return (share.expand(1, *shape) * light.reflectance * light.exposure,)


def _point(camera: Any, light: Light) -> tuple[Tensor, Tensor]:
    """A point in the middle, in the plane of a depth; its image reaches the same peak in every frame."""
    _check(isinstance(camera, SpectralDepthCamera), f"a point before a {camera.kind} camera", "a white scene")
    _check(float(camera.filters.filters.min()) == 1, "a point behind colour filters", "clear ones (--filters clear)")
    planes = [float(one) for one in camera.planes.metres]
    nearest = min(planes, key=lambda one: abs(one - (light.depth or 0.0)))
    known = ", ".join(f"{one:.4g}" for one in planes)
    _check(abs(nearest - (light.depth or 0.0)) < 1e-4 * nearest, f"a point at {light.depth} m", f"a plane: {known} m")
    scene = torch.zeros(1, *camera.scene_shape)
    scene[..., camera.size[0] // 2, camera.size[1] // 2] = torch.from_numpy(_of_bands(camera, light.wavelength)).float()
    depth = torch.full((1, 1, *camera.size), nearest)
    return scene * _BRIGHT * camera.white / float(camera.exact(scene, depth).max()), depth


def _shares(camera: Any, light: Light) -> NDArray[np.floating[Any]]:
    """Brightness of every band, or view."""
    if isinstance(camera, SpectralCamera):
        _check(light.view is None, "one view", "none of a spectral camera")
        return _of_bands(camera, light.wavelength)
    if isinstance(camera, LightFieldCamera):
        _check(light.wavelength is None, "one wavelength", "none of a light-field camera, which sees white")
        return _of_views(camera, light.view)
    _check(False, f"a {camera.kind} camera", "a spectral or light-field one")
    raise AssertionError


def _of_bands(camera: SpectralCamera | SpectralDepthCamera, wavelength: float | None) -> NDArray[np.floating[Any]]:
    if wavelength is None:
        return np.ones(len(camera.wavelengths))
    chosen = np.abs(np.array(camera.wavelengths) - wavelength) < _NEAR
    bands = ", ".join(f"{metres_to_nm(one):g}" for one in camera.wavelengths)
    _check(bool(chosen.any()), f"{metres_to_nm(wavelength):g} nm", f"a band of the camera: {bands} nm")
    response = camera.response.detach()
    return chosen * _BRIGHT * camera.white / float(response.sum(0).max() if response.ndim == 2 else response.max())


def _of_views(camera: LightFieldCamera, view: tuple[int, int] | None) -> NDArray[np.floating[Any]]:
    shares = np.ones(camera.views)
    if view is None:
        return shares
    row, column = (one + n // 2 for one, n in zip(view, camera.views, strict=True))
    inside = 0 <= row < camera.views[0] and 0 <= column < camera.views[1]
    _check(inside, f"view {view[0]}, {view[1]}", f"one of {camera.views[0]}×{camera.views[1]}, from the middle")
    shares[:] = 0
    shares[row, column] = _BRIGHT * camera.white / float(camera.response.detach().max())
    return shares


def _check(fine: bool, found: str, expected: str) -> None:
    if not fine:
        raise DeviceError("simulated bench", found, expected, "render such frames with `tmca calibrate render`")


class SimulatedBench:
    """A bench with a scene before it.

    Args:
        camera: as it is known; it images the codes that are loaded.
        scene: what the camera takes: (1, L, H, W), or light field, or cube and depth.
        hardware: faults that nobody is told of.
        bits: of the digital numbers.
        black: digital number of no light; without, 1/64 of the range, or six standard deviations of a dark frame.
        whole: digital numbers reach up to white in a whole exposure; else up to that in a frame of one slot.
        seed: of noise and faults.
        taken: frames that it took before, whose noise is not drawn again; of frames without a name.
        stops_after: frames after which it does not answer any more; never without.

    Raises:
        SettingError: bits or black level that leave no range.
    """

    def __init__(
        self,
        camera: Camera,
        scene: Sequence[Tensor],
        *,
        hardware: Hardware | None = None,
        bits: int = 16,
        black: int | None = None,
        whole: bool = True,
        seed: int = 0,
        taken: int = 0,
        stops_after: int | None = None,
    ) -> None:
        if not 1 <= bits <= 16 or (black is not None and not 0 <= black < 2**bits - 1):
            said = f"{bits} bits" + ("" if black is None else f", black at {black}")
            raise SettingError("simulated bench", said, "1 to 16 bits, black below its top")
        self.known, self.hardware, self.seed = camera, hardware or Hardware(), seed
        self.camera, self.scene = imperfect(camera, self.hardware, seed, "dark"), tuple(scene)
        self.saturation = float(2**bits - 1)
        self.black = _black(camera, self.saturation) if black is None else black
        self._top = camera.full_scale if whole else camera.white
        self.loaded, self.coded = False, False
        self.shown: int | None = None
        self.light: Light | None = None
        self.name: str | None = None
        self.taken, self.first, self.stops_after = taken, taken, stops_after

    @property
    def gain(self) -> float:
        """Snapshot units of a digital number."""
        return float(self._top / (self.saturation - self.black))

    @property
    def snapshot_units_per_dn(self) -> float:
        """See ``Device``."""
        return self.gain

    def name_frame(self, name: str) -> None:
        """See ``Named``: a frame has the noise of its name, whenever it is taken."""
        self.name = name

    def load(self, export: Export) -> None:
        """See ``Device``; from then on it images what was exported, a mirror's own terms among it.

        Raises:
            DeviceError: codes of another camera.
            SettingError: faults that this scene or these devices cannot have.
        """
        codes, self.coded = read_export(export.folder), exposed_whole(export.manifest)
        if codes.slots != self.known.slots and ("shutter" in codes.planes or codes.modes):
            raise DeviceError("simulated bench", f"{codes.slots} slots", f"the camera's {self.known.slots}")
        if self.scene and self.hardware.leakage and not self.coded:
            expected = "none where frames of an ordinary camera are masked afterwards"
            raise SettingError(
                "leakage", f"{self.hardware.leakage:g}", expected, "export to coded-exposure, or leave it"
            )
        for scene in self.scene[:1]:
            check_displacement(self.hardware.movement, scene.shape[-2:])
        self.camera = imperfect(showing(self.known, codes), self.hardware, self.seed, "dark")
        self.loaded = True

    def illuminate(self, light: Light) -> None:
        """See ``Lamp``; the scene is away from then on."""
        self.light = light

    def show(self, slot: int | None) -> None:
        """See ``Device``."""
        if not self.loaded:
            raise DeviceError("simulated bench", "no patterns", "those of an export", "load one first")
        if slot is not None and not 0 <= slot < self.camera.slots:
            raise DeviceError("simulated bench", f"slot {slot}", f"0 to {self.camera.slots - 1}")
        self.shown = slot

    def capture(self, whole: bool = False) -> NDArray[np.integer]:
        """See ``Device``."""
        done = self.taken - self.first
        if self.stops_after is not None and done >= self.stops_after:
            raise DeviceError("simulated bench", f"no answer after {done} frames", "a frame", "run it again")
        self.taken += 1
        with torch.no_grad():
            light = self._seen(whole)
        numbers = (self.black + light / self.gain).round().clamp(0, self.saturation)[0]
        found = numbers.numpy().astype(np.uint16)
        return found[0] if len(found) == 1 else found

    def _seen(self, whole: bool) -> Tensor:
        """(1, C, H, W) what the sensor reads, snapshot units."""
        if self.light is not None and self.light.kind in ("none", "even"):
            bright = self.light.reflectance * self.light.exposure if self.light.kind == "even" else 0.0
            return self._even(bright)
        if not whole and self.shown is None:
            return self._even(0)
        shown = None if whole else self.shown
        seen, shares = seen_in_frame(self.camera, shown or 0, settled=self.light is not None)
        camera = self.camera if shown is None else of_one_slot(self.camera, seen, shares, self.known.slots)
        scene = self._moved(None if shown is None else seen) if self.light is None else lit_scene(camera, self.light)
        found: Tensor = camera(*scene, generator=self._noise())
        return found

    def _moved(self, seen: list[int] | None) -> tuple[Tensor, ...]:
        """The scene as it is in some slots, in all of them without: (1, n, …) where it moves."""
        if not any(self.hardware.movement):
            return self.scene
        moved = moving_scenes(self.scene[0], self.hardware.movement, self.camera.slots)
        return (moved if seen is None else moved[:, seen],)

    def _noise(self) -> torch.Generator:
        if self.name is None:
            return torch.Generator().manual_seed(1000 * self.seed + self.taken)
        drawn = sha256(f"{self.seed} {self.name}".encode()).digest()
        return torch.Generator().manual_seed(int.from_bytes(drawn[:6], "big"))

    def _even(self, share: float) -> Tensor:
        """Of the same light on every pixel, a share of white's."""
        exposures = self.known.exposures if self.coded else 1
        irradiance = torch.full((1, *self.camera.snapshot_shape), share * self.known.white * exposures)
        sensor = self.camera.sensor if self.coded else sub_exposed(self.camera, self.known.slots)
        found: Tensor = sensor(irradiance, self.known.white, self._noise(), exposures)
        return found


def _black(camera: Camera, top: float) -> int:
    """Digital number of no light below which noise does not fall."""
    level = max(1 / 64, 6 * camera.noise.read * camera.slots / camera.full_scale)
    return int(level * top / (1 + level))
