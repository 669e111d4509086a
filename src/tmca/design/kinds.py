"""Cameras of one period, whose codes can be designed, and how much light they let through."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any

import torch
from torch import Tensor, nn

from tmca.cameras import CodedCamera, SpectralCamera
from tmca.codes import BURST
from tmca.errors import SettingError, check_choice

KINDS: dict[str, dict[str, Any]] = {
    "static": {"aperture": "random", "shutter": "open"},
    "free": {"aperture": "random", "shutter": "random"},
    "one-hot": {"aperture": "random", "shutter": "one-hot"},
    "open-shutter": {"aperture": "random", "shutter": "open"},
    "static-aperture": {"aperture": "static", "shutter": "random"},
    "complementary": {"aperture": "complementary", "shutter": "random"},
    "blue-noise": {"aperture": "blue-noise", "shutter": "blue-noise"},
    "s-matrix": {"aperture": "random", "shutter": "s-matrix"},
    "two-bucket": {"aperture": "random", "shutter": "balanced", "buckets": 2},
    "burst": {"aperture": "random", "shutter": "burst", "buckets": 2},
}
"""Structure of codes by name: what the optimiser starts from and, where planes are no random, balanced, blue-noise or
S-matrix ones, keeps. ``"two-bucket"`` needs pixels with two buckets; ``"burst"`` is a frame in each slot, one
after the other, each read on its own, which any sensor gives: the rival of both."""
_JITTER, _BISECTIONS = 0.9, 24


def buckets_of(kind: str, slots: int) -> int:
    """R that codes of a kind with so many slots need: of a burst one for each frame, two at least."""
    least = int(KINDS[kind].get("buckets", 1))
    return max(slots, least) if kind == BURST else least


def designable(
    kind: str,
    slots: int,
    period: tuple[int, int],
    *,
    seed: int = 0,
    start: CodedCamera | None = None,
    camera_type: Callable[..., CodedCamera] = SpectralCamera,
    **camera: Any,
) -> CodedCamera:
    """A camera as large as one period of its learnable codes.

    Args:
        kind: name in ``KINDS``.
        slots: number of time slots K; 1 for ``"static"``, of a burst its frames.
        period: (rows, columns) of the tile, pixels.
        seed: of the codes.
        start: a camera of the same period whose codes are started from; of one with fewer slots, each is shown in
            several slots in a row: the same camera in finer time, a burst read more often. Of all buckets of a burst
            the first one's are taken, the rest is the second's.
        camera_type: ``SpectralCamera`` or ``LightFieldCamera``.
        camera: its further arguments.

    Raises:
        SettingError: unknown kind, a static camera with slots, a burst of one frame, a start whose slots do not divide
            these, or whose codes are not of this kind.
    """
    check_choice("kind", kind, KINDS)
    if kind == "static" and slots != 1:
        raise SettingError("slots", f"{slots} of a static code", "1", "choose another kind")
    settings: dict[str, Any] = {"jitter": _JITTER, "seed": seed}
    shown = KINDS[kind] | ({"buckets": buckets_of(kind, slots)} if kind == BURST else {})
    made = camera_type(size=period, period=period, slots=slots, learnable=True, **settings, **shown, **camera)
    if start is None:
        return made
    if slots % start.slots:
        raise SettingError("start", f"{start.slots} slots", f"a divisor of {slots}")
    names = ["aperture", "shutter"]
    if kind == BURST and slots != start.slots:  # a longer burst has more frames: of a shorter one it has the apertures
        designable(kind, start.slots, period, start=start, camera_type=camera_type, **camera)  # refuses other codes
        names = ["aperture"]
    for name in names:
        codes = getattr(start.codes, name).tile().detach().repeat_interleave(slots // start.slots, 0)
        plane = getattr(made.codes, name)
        plane.show(codes[: len(plane.tile())], **settings)
    return made


def learnable(camera: CodedCamera) -> list[nn.Parameter]:
    """The latent values of a camera's learnable codes.

    Raises:
        SettingError: there are none.
    """
    latents = [p for p in camera.codes.parameters() if p.requires_grad]
    if not latents:
        raise SettingError("camera", "fixed codes", "learnable=True, 'aperture' or 'shutter'")
    return latents


def throughput_of(camera: CodedCamera) -> Tensor:
    """Mean of T̂ as a differentiable scalar, share of a white scene's light under equal exposure."""
    return camera.code_cube().mean() * camera.buckets / camera.exposures


@torch.no_grad()
def hold_throughput(camera: CodedCamera, target: float) -> None:
    """Shift the latent values of the learned planes together until the throughput is as near to ``target`` as the
    codes allow: the pixels that were nearest to changing change.

    Planes whose family fixes their own share (one-hot, complementary) are left as they are, and so is the shutter of
    several buckets, which lose no light.
    """
    fixed = ("one-hot", "complementary")
    codes = (camera.codes.aperture, camera.codes.shutter)[: 1 if camera.buckets > 1 else 2]
    planes = [plane for plane in codes if plane.learnable and plane.family not in fixed]
    if not planes:
        return
    latents = [plane.latent.clone() for plane in planes]
    reach = max(float(latent.abs().max()) for latent in latents) * 1.01 + 1e-3
    shares: dict[Hashable, float] = {}  # by the numbers of open pixels: a larger shift only opens more of them

    def show(shift: float) -> None:
        for plane, latent in zip(planes, latents, strict=True):
            plane.latent.copy_(latent + shift)

    def share_of(shift: float) -> float:
        show(shift)
        binary = not any(plane.grey or plane.relaxed for plane in planes)
        shown = tuple(int((plane.latent > 0).sum()) for plane in planes) if binary else shift
        if shown not in shares:
            shares[shown] = camera.throughput()
        return shares[shown]

    show(_nearest(share_of, target, reach))


def _nearest(share_of: Callable[[float], float], target: float, reach: float) -> float:
    """The shift within ``reach`` whose share, which grows with it, is nearest to the target."""
    low, high, best = -reach, reach, (float("inf"), 0.0)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        share = share_of(middle)
        best = min(best, (abs(share - target), middle))
        low, high = (middle, high) if share < target else (low, middle)
    return best[1]
