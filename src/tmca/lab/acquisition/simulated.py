"""A bench that is computed: a scene or a lamp, the camera as it really is, its sensor's digital numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from tmca.cameras import Camera, Hardware, imperfect, moving_scenes
from tmca.cameras.faulty import FaultyCodes, FaultyShutter
from tmca.cameras.motion import check_displacement
from tmca.codes.buckets import bucket_shutters
from tmca.errors import DeviceError, SettingError, check_range
from tmca.lab.cameras import lab_camera
from tmca.lab.cameras.base import Light
from tmca.lab.display.export import Export
from tmca.lab.display.manifest import exposed_whole, read_export

_UNSEEN = 1e-12
"""Share of a slot below which a pattern is not seen: rounding."""
_FARTHEST = 1e6
"""Pixels by which a scene may drift from exposure to exposure."""


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
        stops_after: frames after which it does not answer any more; never without.
        drift: rows and columns by which the scene, which goes round at its edges, is elsewhere in the next exposure.

    Raises:
        SettingError: bits or black level that leave no range, or a drift that is no number.
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
        stops_after: int | None = None,
        drift: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        if not 1 <= bits <= 16 or (black is not None and not 0 <= black < 2**bits - 1):
            said = f"{bits} bits" + ("" if black is None else f", black at {black}")
            raise SettingError("simulated bench", said, "1 to 16 bits, black below its top")
        for step in drift:
            check_range("drift", step, -_FARTHEST, _FARTHEST, unit="pixels an exposure")
        self.known, self.hardware, self.seed = camera, hardware or Hardware(), seed
        self.hardware.check(camera.kind, camera.buckets)
        self.camera, self.scene = self._on_bench(camera), tuple(scene)
        self.saturation = float(2**bits - 1)
        # noise does not fall below it, nor a bucket's offset
        level = max(1 / 64, 6 * camera.noise.read * camera.slots / camera.full_scale)
        level += max(0.0, -self.hardware.bucket_offset)
        self.black = int(level * self.saturation / (1 + level)) if black is None else black
        white = camera.full_scale if whole else camera.white
        self.gain = self.snapshot_units_per_dn = float(white / (self.saturation - self.black))
        self.loaded, self.coded = False, False
        self.shown: int | None = None
        self.light: Light | None = None
        self.name: str | None = None
        self.taken, self.stops_after, self.drift, self.exposures = 0, stops_after, drift, 0

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
            found, expected = (
                f"{self.hardware.leakage:g}",
                "none where frames of an ordinary camera are masked afterwards",
            )
            raise SettingError("leakage", found, expected, "export to coded-exposure, or leave it")
        for scene in self.scene[:1]:
            check_displacement(self.hardware.movement, scene.shape[-2:])
        self.camera = self._on_bench(lab_camera(self.known).showing(self.known, codes))
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
        if self.stops_after is not None and self.taken >= self.stops_after:
            raise DeviceError("simulated bench", f"no answer after {self.taken} frames", "a frame", "run it again")
        self.taken += 1
        with torch.no_grad():
            light = self._seen(whole)
        numbers = (self.black + light / self.gain)[0]
        # that of the converter, whatever the exposure
        numbers[len(numbers) // self.known.buckets :] += self.hardware.bucket_offset * (self.saturation - self.black)
        frame = numbers.round().clamp(0, self.saturation).numpy().astype(np.uint16)
        self.exposures += whole or self.shown == self.camera.slots - 1
        return frame[0] if len(frame) == 1 else frame

    def _on_bench(self, camera: Camera) -> Camera:
        """The camera with all faults but the offset of buckets."""
        return imperfect(camera, replace(self.hardware, bucket_offset=0.0), self.seed, "dark")

    def _seen(self, whole: bool) -> Tensor:
        """(1, C, H, W) what the sensor reads, snapshot units."""
        if self.light is not None and self.light.kind in ("none", "even"):
            bright = self.light.reflectance * self.light.exposure if self.light.kind == "even" else 0.0
            return self._even(bright)
        if not whole and self.shown is None:
            return self._even(0)
        shown, camera, patterns = None if whole else self.shown, self.camera, None
        if shown is not None:
            patterns, shares = seen_in_frame(camera, shown, settled=self.light is not None)
            camera = of_one_slot(camera, patterns, shares, self.known.slots)
        scene = self._moved(patterns) if self.light is None else lab_camera(camera).lit(camera, self.light)
        recorded: Tensor = camera(*scene, generator=self._noise())
        return recorded

    def _moved(self, seen: list[int] | None) -> tuple[Tensor, ...]:
        """The scene as it is in some slots, in all of them without: (1, n, …) where it moves."""
        scene = self.scene
        if any(self.drift):
            rows, columns = (round(self.exposures * step) for step in self.drift)
            scene = tuple(part.roll((rows, columns), (-2, -1)) for part in scene)
        if not any(self.hardware.movement):
            return scene
        moved = moving_scenes(scene[0], self.hardware.movement, self.camera.slots)
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
        if self.known.buckets > 1 and self.coded:
            irradiance *= self._collected()
        sensor = self.camera.sensor if self.coded else sub_exposed(self.camera, self.known.slots)
        recorded: Tensor = sensor(irradiance, self.known.white, self._noise(), exposures)
        return recorded

    def _collected(self) -> Tensor:
        """(R·C, H, W) share of the exposure in which every bucket collects."""
        shown: Tensor = self.camera.codes()[1]  # type: ignore[operator]
        shutters = bucket_shutters(shown, self.known.slots, self.known.buckets).mean(1)
        return shutters.repeat_interleave(self.camera.snapshot_shape[0] // len(shutters), 0)


def seen_in_frame(camera: Any, slot: int, settled: bool = False) -> tuple[list[int], Tensor]:
    """Patterns that a frame sees which an ordinary camera takes for one slot, and how long.

    Its shutter is open for all pixels while shutter pattern ``slot`` would be shown: late, row after row, while the
    aperture still turns to its next pattern, as the faults of the camera say; not where a frame waits for a pattern
    that is ``settled``. Indices of n patterns, and (n, H) shares of a slot for every row of the sensor.
    """
    timed = [part.faults for part in camera.modules() if isinstance(part, FaultyCodes | FaultyShutter)]
    if settled or not timed or not timed[0].timed:
        return [slot], torch.ones(1, camera.size[0])
    shares = timed[0].overlap[:, slot].T.float()
    seen = [pattern for pattern, share in enumerate(shares) if float(share.abs().max()) > _UNSEEN] or [slot]
    return seen, shares[seen]


def of_one_slot(camera: Any, patterns: Sequence[int], shares: Tensor, slots: int) -> Any:
    """The camera in the frame of one slot, one of the ``slots`` of an exposure, its shutter open.

    A slot of an equal exposure lasts the K-th part of it: the sensor collects a K-th of the light, and what it reads is
    K-fold, so that snapshots of all slots, masked, average to that of the exposure, shot and read noise as they are.
    The n patterns and their (n, H) shares of a slot are those of ``seen_in_frame``.
    """
    parts: dict[str, Any] = {"sensor": sub_exposed(camera, slots), "slots": len(patterns), "exposure": "equal"}
    # a mean over these patterns is then their sum
    return lab_camera(camera).opened(camera, patterns, shares * len(patterns), **parts)


def sub_exposed(camera: Any, share: int) -> nn.Module:
    """The camera's sensor in one of the ``share`` exposures that emulate a coded one."""
    return camera.sensor if camera.exposure == "per-slot" else _SubExposure(camera.sensor, share)


class _SubExposure(nn.Module):
    """A sensor that is exposed for a share of the time and read with as much more gain."""

    def __init__(self, sensor: nn.Module, share: int) -> None:
        super().__init__()
        self.sensor, self.share = sensor, share

    def forward(self, irradiance: Tensor, full_scale: float, generator: Any = None, exposures: int = 1) -> Tensor:
        recorded: Tensor = self.sensor(irradiance / self.share, full_scale, generator, exposures)
        return recorded * self.share
