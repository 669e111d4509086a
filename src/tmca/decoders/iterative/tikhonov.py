"""Least squares with a smooth scene: Tikhonov regularisation by conjugate gradients, linear and without any prior."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn.functional import pad

from tmca.errors import SettingError, ShapeError
from tmca.operators import TapOperator


def tikhonov(
    operator: TapOperator,
    snapshot: Tensor,
    *,
    weight: float = 0.3,
    iterations: int = 60,
    progress: Callable[[float], None] | None = None,
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
        progress: told the share that is done.

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
    return _conjugate_gradients(normal, operator.A_adjoint(snapshot), preconditioner, iterations, progress)


def _roughness(scene: Tensor) -> Tensor:
    """∇ᵀ∇ of every channel, Neumann boundary."""
    around = pad(scene, (1, 1, 1, 1), mode="replicate")
    total = 4 * scene
    total -= around[..., 2:, 1:-1]
    total -= around[..., :-2, 1:-1]
    total -= around[..., 1:-1, 2:]
    total -= around[..., 1:-1, :-2]
    return total


def _conjugate_gradients(
    normal: Callable[[Tensor], Tensor],
    right: Tensor,
    preconditioner: Tensor,
    iterations: int,
    progress: Callable[[float], None] | None,
) -> Tensor:
    """Solve ``normal(x) = right`` (B, L, H, W), steps of each batch entry its own; none beyond rounding."""
    tiny, rounding = torch.finfo(right.dtype).tiny, torch.finfo(right.dtype).eps ** 2
    residual, estimate = right, torch.zeros_like(right)
    direction = preconditioner * residual
    first = product = _inner(residual, direction)
    for iteration in range(1, iterations + 1):
        image = normal(direction)
        step = (product > rounding * first) * product / _inner(direction, image).clamp_min(tiny)
        estimate, residual = torch.addcmul(estimate, step, direction), torch.addcmul(residual, -step, image)
        scaled = preconditioner * residual
        before, product = product, _inner(residual, scaled)
        direction = torch.addcmul(scaled, product / before.clamp_min(tiny), direction)
        if progress is not None:
            progress(iteration / iterations)
    return estimate


def _inner(one: Tensor, other: Tensor) -> Tensor:
    """(B, 1, 1, 1), summed row by row: one sum of millions in single precision is rounded differently everywhere."""
    return torch.linalg.vecdot(one, other).sum((1, 2))[:, None, None, None]
