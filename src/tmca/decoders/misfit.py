"""How well an estimate explains its snapshot: what the camera makes of it, beside what was recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from tmca.decoders.estimate import Estimate
from tmca.decoders.space_time import frame_operator

_FACTOR, _USUAL = 1.5, 0.04
"""More than noise and this share of a snapshot, which decoders smooth away, times this factor is doubtful.

Measured on five rendered scenes (12 bands, 64×80 pixels). One bucket (CASSI, one-hot K = 4; no noise, σ = 0.01,
1 000 e⁻), lmmse and admm-tv: right frames leave at most 1.33 times as much as both together. Two buckets (K = 4, codes
that repeat every 8 pixels or not at all, σ = 0.001 and 0.01): right frames leave at most 0.9 times as much; exchanged
buckets and other codes 1.9 to 13 times by lmmse, by admm-tv more than 1.5 in 15 and 10 of 20. Codes that repeat every 4
pixels, fewer than there are bands, leave up to 1.9 by lmmse though they are right. What has many unknowns for each
pixel explains almost any snapshot: dagger, or admm-tv of a light field. What a decoder itself leaves hides small
faults.
"""


@dataclass(frozen=True)
class Misfit:
    """What an estimate leaves of its snapshot.

    Args:
        left: rms of the snapshot without what the camera makes of the estimate, over that of the snapshot.
        noise: rms of the noise that the camera knows of, over the same.
        causes: usual ones where it is doubtful.
    """

    left: float
    noise: float
    causes: ClassVar[str] = "other codes, buckets that are exchanged, another calibration, or a scene that moved"

    @property
    def doubtful(self) -> bool:
        """Whether it is far more than noise and a decoder leave of the snapshot of their own camera."""
        return self.left > _FACTOR * float((self.noise**2 + _USUAL**2) ** 0.5)

    def in_words(self) -> str:
        """Both, in one line."""
        return f"the estimate leaves {self.left:.1%} of the snapshot, noise is {self.noise:.1%}"


@torch.no_grad()
def misfit_of(estimate: Estimate, values: Tensor) -> Misfit:
    """What an estimate leaves of the snapshot (B, C, H, W') that it was made of, saturated pixels aside; 0 of a
    black one.

    Of scenes that change, (B, G, *scene_shape), every frame is imaged in its time.
    """
    camera = estimate.camera
    values = values.to(estimate.values)
    seen = values < float(getattr(camera.sensor, "saturates", False) or torch.inf) * camera.full_scale * (1 - 1e-3)
    light = float(values[seen].square().mean().sqrt()) if bool(seen.any()) else 0.0
    if not light:
        return Misfit(0.0, 0.0)
    left = (_imaged(camera, estimate) - values)[seen].square().mean().sqrt()
    noise = camera.noise.variance(values)[seen].mean().sqrt()
    return Misfit(float(left) / light, float(noise) / light)


def _imaged(camera: Any, estimate: Estimate) -> Tensor:
    """(B, C, H, W') exact snapshot of an estimate."""
    scene = estimate.values
    if scene.ndim > 1 + len(camera.scene_shape):
        return frame_operator(camera, scene.shape[1]).A(scene)
    exact: Tensor = camera.A(scene) if estimate.depth is None else camera.A(scene, estimate.depth)
    return exact
