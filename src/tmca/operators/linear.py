"""What every camera's linear part offers: ``A``, ``A_adjoint``, ``A_dagger``, ``prox_l2`` (deepinv's names)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor, nn

from tmca.errors import SettingError, ShapeError

_TOLERANCE = {torch.float32: 1e-6, torch.float64: 1e-11}


def conjugate_gradients(
    matrix: Callable[[Tensor], Tensor],
    right: Tensor,
    *,
    tolerance: float = 1e-6,
    steps: int = 200,
    start: Tensor | None = None,
) -> Tensor:
    """Solve ``matrix(x) = right`` for a batch, each entry with steps of its own (Hestenes and Stiefel 1952).

    Args:
        matrix: symmetric, positive semidefinite; applied to tensors like ``right``.
        right: (B, …); where the matrix is singular it must lie in its range.
        tolerance: residual, as a share of the norm of ``right``, at which every entry is solved.
        steps: most steps taken.
        start: a solution that is near, such as that of the iteration before; zero if None.
    """
    dims = tuple(range(1, right.ndim))

    def dot(a: Tensor, b: Tensor) -> Tensor:
        return (a * b).sum(dim=dims, keepdim=True)

    tiny = torch.finfo(right.dtype).tiny
    solution = torch.zeros_like(right) if start is None else start
    residual = right if start is None else right - matrix(start)
    direction, energy = residual, dot(residual, residual)
    goal = tolerance**2 * dot(right, right)
    for _ in range(steps):
        if bool((energy <= goal).all()):
            break
        image = matrix(direction)
        step = energy / dot(direction, image).clamp_min(tiny)
        solution, residual = solution + step * direction, residual - step * image
        energy, previous = dot(residual, residual), energy
        direction = residual + energy / previous.clamp_min(tiny) * direction
    return solution


def conjugate_gradient_gram(operator: Any, y: Tensor, shift: float, **iteration: Any) -> Tensor:
    """``(A Aᵀ + shift·I)⁻¹ y`` of anything with ``A`` and ``A_adjoint``."""
    return conjugate_gradients(lambda x: operator.A(operator.A_adjoint(x)) + shift * x, y, **iteration)


class LinearOperator(nn.Module, ABC):
    """A linear map from scenes (B, *scene_shape) to snapshots (B, *snapshot_shape).

    Subclasses set ``scene_shape`` and ``snapshot_shape`` and define ``A`` and ``A_adjoint``, and ``gram_solve`` where
    ``A Aᵀ`` has a closed inverse.
    """

    scene_shape: tuple[int, ...]
    snapshot_shape: tuple[int, ...]

    @abstractmethod
    def A(self, scene: Tensor) -> Tensor:
        """Scene (B, *scene_shape) → snapshot (B, *snapshot_shape)."""

    @abstractmethod
    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        """Snapshot → scene, the transpose of ``A``."""

    def forward(self, scene: Tensor) -> Tensor:
        """The same as ``A``."""
        return self.A(scene)

    def gram_solve(
        self,
        snapshot: Tensor,
        shift: float | Tensor,
        *,
        tolerance: float | None = None,
        steps: int = 200,
        start: Tensor | None = None,
    ) -> Tensor:
        """``(A Aᵀ + shift·I)⁻¹ snapshot``, by conjugate gradients unless closed.

        Args:
            snapshot: (B, *snapshot_shape).
            shift: ≥ 0, or a map of the snapshot's size; with 0 the snapshot must lie in the range of A.
            tolerance, steps, start: of the iteration, see ``conjugate_gradients``; closed solutions need none of them.
        """
        return conjugate_gradients(
            lambda y: self.A(self.A_adjoint(y)) + shift * y,
            snapshot,
            tolerance=_TOLERANCE[snapshot.dtype] if tolerance is None else tolerance,
            steps=steps,
            start=start,
        )

    def A_dagger(self, snapshot: Tensor) -> Tensor:
        """Least-norm scene that explains the snapshot, ``Aᵀ (A Aᵀ)⁺ snapshot``."""
        self._check(snapshot, self.snapshot_shape, "snapshot")
        return self.A_adjoint(self.gram_solve(snapshot, 0.0, steps=1000))

    def prox_l2(self, point: Tensor, snapshot: Tensor, rho: float | Tensor) -> Tensor:
        """``argmin_x ½‖A x − snapshot‖² + ρ/2 ‖x − point‖²``, solved in the space of the snapshot.

        By the Woodbury identity it is ``point + Aᵀ (A Aᵀ + ρ I)⁻¹ (snapshot − A point)``.

        Args:
            point: (B, *scene_shape).
            snapshot: (B, *snapshot_shape).
            rho: ρ > 0.
        """
        return point + self.A_adjoint(self.gram_solve(snapshot - self.A(point), rho))

    def _check(self, tensor: Tensor, shape: tuple[int, ...], name: str) -> None:
        if not isinstance(tensor, Tensor) or not tensor.is_floating_point():
            kind = str(getattr(tensor, "dtype", type(tensor).__name__))
            raise SettingError(
                name, kind, "a floating-point torch tensor", "convert it with torch.as_tensor(…).float()"
            )
        if tensor.ndim != len(shape) + 1 or tuple(tensor.shape[1:]) != tuple(shape):
            expected = f"(batch, {', '.join(map(str, shape))})"
            remedy = "give the camera this size and number of bands, or crop the input"
            raise ShapeError(name, f"shape {tuple(tensor.shape)}", expected, remedy)
