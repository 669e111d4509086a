"""Linear decoders without any prior: the least-norm scene, and least squares with a smooth one (Tikhonov)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import pad

from tmca.decoders.decoder import Decoder, Progress
from tmca.errors import SettingError, ShapeError
from tmca.operators import TapOperator
from tmca.operators.linear import conjugate_gradients


def tikhonov(
    operator: TapOperator,
    snapshot: Tensor,
    *,
    weight: float = 0.3,
    iterations: int = 60,
    progress: Progress | None = None,
) -> Tensor:
    """``argmin_x ‖A x − y‖² + w·e·(‖∂y x‖² + ‖∂x x‖²)`` with e the mean of the diagonal of AᵀA (Tikhonov 1963).

    Conjugate gradients (Hestenes, Stiefel 1952) preconditioned by the diagonal, a fixed number of them from zero: every
    snapshot of a batch is decoded as it would be alone, gradients reach code and snapshot, and exporters know every
    operation. Nothing couples the channels but the snapshot.

    Args:
        operator: of the camera.
        snapshot: (B, 1, H, W').
        weight: w, finite and > 0; on training scenes 0.1 to 1 come to the same within 0.7 dB, at any noise up to 0.05
            (``benchmarks/defaults.py --study tikhonov``).
        iterations: at least 1; on training scenes 60 come within 0.2 dB of the minimum, 100 reach it.
        progress: called with the share that is done.

    Returns:
        (B, L, H, W), in scene units; not clipped. Of several minima the one that is reached from zero.

    Raises:
        SettingError: a weight or a number of iterations out of range.
        ShapeError: a snapshot that is not the operator's.
    """
    if not 0 < weight < math.inf:
        raise SettingError("weight", f"{weight:g}", "a finite number > 0")
    if iterations < 1:
        raise SettingError("iterations", str(iterations), "at least 1")
    if snapshot.ndim != 4 or tuple(snapshot.shape[1:]) != tuple(operator.snapshot_shape):
        raise ShapeError("snapshot", str(tuple(snapshot.shape)), f"(B, {', '.join(map(str, operator.snapshot_shape))})")
    energy = operator.taps.channel_energy()
    stiffness = weight * energy.mean()

    def normal(scene: Tensor) -> Tensor:
        return torch.addcmul(operator.A_adjoint(operator.A(scene)), stiffness, _roughness(scene))

    preconditioner = 1 / (energy + 4 * stiffness).clamp_min(torch.finfo(energy.dtype).tiny)
    return conjugate_gradients(
        normal, operator.A_adjoint(snapshot), steps=iterations, tolerance=None, preconditioner=preconditioner,
        progress=progress,
    )  # fmt: skip


def _roughness(scene: Tensor) -> Tensor:
    """∇ᵀ∇ of every channel, Neumann boundary."""
    around = pad(scene, (1, 1, 1, 1), mode="replicate")
    total = 4 * scene
    total -= around[..., 2:, 1:-1]
    total -= around[..., :-2, 1:-1]
    total -= around[..., 1:-1, 2:]
    total -= around[..., 1:-1, :-2]
    return total


@dataclass
class TikhonovDecoder(Decoder):
    """Least squares with smooth channels, by conjugate gradients; linear, no prior is learned.

    Args:
        weight: of the smoothness.
        iterations: of the conjugate gradients.
    """

    name, label, cameras = "tikhonov", "Tikhonov", frozenset({"spectral", "light-field"})
    weight: float = 0.3
    iterations: int = 100

    def setup(self, camera: Any, prior: None) -> TapOperator:
        return TapOperator(camera.taps())

    def reconstruct(self, prepared: TapOperator, values: Tensor, progress: Progress | None) -> Tensor:
        return tikhonov(prepared, values, weight=self.weight, iterations=self.iterations, progress=progress)


@dataclass
class LeastNorm(Decoder):
    """The least-norm scene that explains the snapshot, by the pseudo-inverse: the plain baseline."""

    name, label, cameras = "dagger", "least norm", frozenset({"spectral", "light-field"})
    clips = False

    def reconstruct(self, prepared: Any, values: Tensor, progress: Progress | None) -> Tensor:
        scene: Tensor = prepared.operator().A_dagger(values)
        return scene
