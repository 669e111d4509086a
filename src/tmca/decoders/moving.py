"""Patch LMMSE of scenes that change within the exposure: every frame of a spectral or light-field video at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from tmca.cameras import Camera
from tmca.cameras.frames import frame_shares, frame_taps
from tmca.decoders.decoder import Progress
from tmca.decoders.lmmse import PatchDecoder, PatchEstimator
from tmca.errors import check_range
from tmca.priors import find_prior
from tmca.priors.moving import moving_block, moving_prior, reach_of

_FRAMES = 4


@dataclass
class SpaceTimeLMMSE(PatchDecoder):
    """The best linear estimate of all frames under the Gaussian prior of blocks of a scene that moves, blended.

    The prior is that of still scenes, moved by every displacement alike: a scene of L channels in G frames is one of
    G·L channels, and the camera one of as many codes.

    Args:
        uncertainty: also predict the standard deviation of every entry.
        frames: how many, of equal length, a divisor or a multiple of the slots; up to four if None.
        motion: largest displacement over the exposure along each axis that is expected, pixels.
    """

    name, label, moving = "space-time-lmmse", "space-time LMMSE", True
    room: ClassVar[int] = 0
    """Pixels by which blocks of the prior are larger than those that move."""
    frames: int | None = None
    motion: float = 4.0

    def __post_init__(self) -> None:
        if self.frames is not None:
            check_range("frames", self.frames, 1, whole=True)
        check_range("motion", self.motion, 0, 100, unit="pixels")

    def scene_shape(self, camera: Any) -> tuple[int, ...]:
        return (self._frames(camera), *camera.scene_shape)

    def _frames(self, camera: Any) -> int:
        return self.frames or max(n for n in range(1, _FRAMES + 1) if camera.slots % n == 0)

    def find_prior(self, camera: Camera, given: Any, progress: Progress | None = None) -> Any:
        """That of still scenes: given, a file's, or that of the rendered ones, of blocks that leave room to move."""
        frames = self._frames(camera)
        frame_shares(frames, camera.slots)  # refused before a prior is learned
        rows, columns = moving_block(camera, frames)
        room = reach_of(self.motion) + self.room
        block = (rows + room, columns + room)
        return find_prior(camera, given, "gaussian", progress, block=block)

    def setup(self, camera: Any, prior: Any) -> PatchEstimator:
        frames = self._frames(camera)
        moved = moving_prior(prior, frames, self.motion, moving_block(camera, frames))
        return PatchEstimator(moved, frame_taps(camera, frames), camera.noise)
