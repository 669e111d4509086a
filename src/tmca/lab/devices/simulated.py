"""A bench that is computed: a scene, the camera as it really is, and its sensor's digital numbers."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.cameras import Camera, Hardware, imperfect, moving_scenes
from tmca.cameras.motion import check_displacement
from tmca.errors import DeviceError, SettingError
from tmca.lab.devices.export import Export
from tmca.lab.devices.light import Light
from tmca.lab.devices.lit import lit_scene
from tmca.lab.devices.manifest import exposed_whole
from tmca.lab.devices.reading import read_export
from tmca.lab.devices.shown_camera import of_one_slot, seen_in_frame, showing, sub_exposed


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
