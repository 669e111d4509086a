"""Light throughput of learned codes: as a penalty in the loss, or held at a target after every step."""

from __future__ import annotations

import torch
from torch import Tensor

from tmca.cameras import CodedCamera
from tmca.codes import CodePlane

_BISECTIONS = 24


def throughput_of(camera: CodedCamera) -> Tensor:
    """Mean of T̂ as a differentiable scalar, share of a white scene's light under equal exposure."""
    share = camera.code_cube().mean()
    return share / camera.slots if camera.exposure == "per-slot" else share


@torch.no_grad()
def hold_throughput(camera: CodedCamera, target: float) -> None:
    """Shift the latent values of the learned planes together until the throughput is as near to ``target`` as the
    codes allow: the pixels that were nearest to changing change.

    Planes whose family fixes their own share (one-hot, complementary) are left as they are.
    """
    codes = camera.codes
    planes = [plane for plane in (codes.aperture, codes.shutter) if _free(plane)]
    if not planes:
        return
    latents = [plane.latent.clone() for plane in planes]
    reach = max(float(latent.abs().max()) for latent in latents) * 1.01 + 1e-3
    low, high, best = -reach, reach, (float("inf"), 0.0)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        _shift(planes, latents, middle)
        share = camera.throughput()
        best = min(best, (abs(share - target), middle))
        low, high = (middle, high) if share < target else (low, middle)
    _shift(planes, latents, best[1])


def _free(plane: CodePlane) -> bool:
    return plane.learnable and plane.family not in ("one-hot", "complementary")


def _shift(planes: list[CodePlane], latents: list[Tensor], shift: float) -> None:
    for plane, latent in zip(planes, latents, strict=True):
        plane.latent.copy_(latent + shift)
