"""A camera of a scene that changes within the exposure: frame by frame, in the form of a camera of more channels."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from tmca.cameras.camera import CodedCamera
from tmca.codes import bucket_shutters
from tmca.errors import SettingError, check_range
from tmca.operators import Taps


class ExposedPart(nn.Module):
    """Codes whose shutter passes only a share of every slot, into whatever bucket.

    Args:
        codes: the module that gives (aperture, shutter).
        shares: (K,) of the slots, 0 to 1.
        buckets: R of a pixel.
    """

    learnable = False

    def __init__(self, codes: nn.Module, shares: Tensor, buckets: int) -> None:
        super().__init__()
        self.codes, self.shares, self.buckets = codes, shares, buckets

    def forward(self) -> tuple[Tensor, Tensor]:
        """(aperture (K, H, Wa), shutter (R·K, H, W'))."""
        aperture, shutter = self.codes()
        shutters = bucket_shutters(shutter, len(self.shares), self.buckets)
        return aperture, (shutters * self.shares.to(shutter)[:, None, None]).flatten(0, 1)


def frame_shares(frames: int, slots: int) -> Tensor:
    """(G, K) share of every slot that lies within each of G frames of equal length.

    Raises:
        SettingError: numbers of which neither divides the other.
    """
    check_range("frames", frames, 1, whole=True)
    if frames % slots and slots % frames:
        raise SettingError("frames", str(frames), f"a divisor or a multiple of the {slots} slots")
    frame, slot = torch.arange(frames)[:, None] / frames, torch.arange(slots) / slots
    within = torch.minimum(frame + 1 / frames, slot + 1 / slots) - torch.maximum(frame, slot)
    return (within * slots).clamp_min(0)


def frame_taps(camera: CodedCamera, frames: int) -> Taps:
    """The taps of a camera whose scene changes from frame to frame: channel g·L + l is channel l in frame g.

    Args:
        camera: whose codes are those of all slots.
        frames: G of equal length in the exposure, a divisor or a multiple of the slots.

    Raises:
        SettingError: other frames, or optics that keep the slots apart or have a coloured aperture.
    """
    if getattr(camera, "coloured", None) is not None:
        raise SettingError("coloured", "a coloured aperture", "binary codes for a moving scene")
    shares = frame_shares(frames, camera.slots)
    parts = [ExposedPart(camera.codes, part, camera.buckets) for part in shares]
    return Taps.of_frames([camera.replace(codes=part).taps() for part in parts])
