"""A camera of a scene that changes within the exposure: frame by frame, in the form of a camera of more channels."""

from __future__ import annotations

from typing import TypeVar

import torch
from torch import Tensor, nn

from tmca.cameras.coded import CodedCamera
from tmca.codes import Codes, bucket_shutters
from tmca.errors import SettingError, check_choice, check_range
from tmca.operators import Taps

AnyCoded = TypeVar("AnyCoded", bound=CodedCamera)


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


def in_finer_time(camera: AnyCoded, parts: int, dead: int = 0) -> AnyCoded:
    """The same codes, every slot of which lasts for some shorter ones; in the last of these no bucket collects light,
    as while a frame of a burst is read.

    Args:
        camera: whose slots share one exposure.
        parts: of every slot.
        dead: how many of them collect nothing.

    Raises:
        SettingError: less than one part, as many dead ones, or slots that are whole exposures.
    """
    check_choice("exposure", camera.exposure, ("equal",))
    check_range("parts", parts, 1, 1000, whole=True)
    check_range("dead", dead, 0, parts - 1, whole=True)
    aperture, shutter = camera.codes.aperture, camera.codes.shutter
    collected = bucket_shutters(shutter.tile(), camera.slots, camera.buckets).repeat_interleave(parts, 1)
    read = (torch.arange(parts) >= parts - dead).repeat(camera.slots)
    collected[:, read] = 0
    shown = aperture.tile().repeat_interleave(parts, 0)
    codes = Codes(aperture=shown, shutter=collected.flatten(0, 1), period=aperture.period)
    return camera.replace(slots=camera.slots * parts, codes=codes)
