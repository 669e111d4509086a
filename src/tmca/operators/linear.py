"""What every camera's linear part offers: ``A``, ``A_adjoint``, ``A_dagger`` (deepinv's names and meaning)."""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor, nn

from tmca.errors import SettingError, ShapeError

_TOLERANCE = {torch.float32: 1e-6, torch.float64: 1e-11}


class Imaging(Protocol):
    """Anything with ``A`` and ``A_adjoint``."""

    def A(self, x: Tensor, /) -> Tensor: ...

    def A_adjoint(self, y: Tensor, /) -> Tensor: ...


def conjugate_gradient_gram(
    operator: Imaging,
    y: Tensor,
    shift: float,
    *,
    tolerance: float = 1e-6,
    steps: int = 200,
    start: Tensor | None = None,
) -> Tensor:
    """``(A Aᵀ + shift·I)⁻¹ y`` for a batch of snapshots by conjugate gradients.

    Args:
        operator: with ``A`` and ``A_adjoint``.
        y: (B, …).
        shift: ≥ 0; with 0, y must lie in the range of A.
        tolerance: residual, as a share of the norm of y, at which each snapshot of the batch is solved.
        steps: most steps taken.
        start: a solution that is near, such as that of the iteration before; zero if None.
    """
    dims = tuple(range(1, y.ndim))

    def dot(a: Tensor, b: Tensor) -> Tensor:
        return (a * b).sum(dim=dims, keepdim=True)

    tiny = torch.finfo(y.dtype).tiny
    solution = torch.zeros_like(y) if start is None else start
    residual = y if start is None else y - operator.A(operator.A_adjoint(start)) - shift * start
    direction, energy = residual, dot(residual, residual)
    goal = tolerance**2 * dot(y, y)
    for _ in range(steps):
        if bool((energy <= goal).all()):
            break
        image = operator.A(operator.A_adjoint(direction)) + shift * direction
        step = energy / dot(direction, image).clamp_min(tiny)
        solution, residual = solution + step * direction, residual - step * image
        energy, previous = dot(residual, residual), energy
        direction = residual + energy / previous.clamp_min(tiny) * direction
    return solution


class LinearOperator(nn.Module):
    """A linear map from scenes (B, *scene_shape) to snapshots (B, *snapshot_shape).

    Subclasses set ``scene_shape`` and ``snapshot_shape`` and define ``A`` and ``A_adjoint``.
    """

    scene_shape: tuple[int, ...]
    snapshot_shape: tuple[int, ...]

    def A(self, scene: Tensor) -> Tensor:
        """Scene (B, *scene_shape) → snapshot (B, *snapshot_shape)."""
        raise TypeError(f"{type(self).__name__} defines no A")

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        """Snapshot → scene, the transpose of ``A``."""
        raise TypeError(f"{type(self).__name__} defines no A_adjoint")

    def forward(self, scene: Tensor) -> Tensor:
        """The same as ``A``."""
        return self.A(scene)

    def A_dagger(self, snapshot: Tensor) -> Tensor:
        """Least-norm scene that explains the snapshot, ``Aᵀ (A Aᵀ)⁺ snapshot``; by iteration, unless closed."""
        self._check(snapshot, self.snapshot_shape, "snapshot")
        solved = conjugate_gradient_gram(self, snapshot, 0.0, tolerance=_TOLERANCE[snapshot.dtype], steps=1000)
        return self.A_adjoint(solved)

    def _check(self, tensor: Tensor, shape: tuple[int, ...], name: str) -> None:
        if not isinstance(tensor, Tensor) or not tensor.is_floating_point():
            found = str(getattr(tensor, "dtype", type(tensor).__name__))
            raise SettingError(
                name, found, "a floating-point torch tensor", "convert it with torch.as_tensor(…).float()"
            )
        if tensor.ndim != len(shape) + 1 or tuple(tensor.shape[1:]) != tuple(shape):
            raise ShapeError(
                name,
                f"shape {tuple(tensor.shape)}",
                f"(batch, {', '.join(map(str, shape))})",
                "give the camera this size and number of bands, or crop the input",
            )
