"""What every camera's linear part offers: ``A``, ``A_adjoint``, ``A_dagger``, ``prox_l2`` (deepinv's names)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import torch
from torch import Tensor, nn

from tmca.errors import SettingError, ShapeError

_TOLERANCE = {torch.float32: 1e-6, torch.float64: 1e-11}


def conjugate_gradients(
    apply: Callable[[Tensor], Tensor],
    right: Tensor,
    *,
    shift: float | Tensor = 0.0,
    tolerance: float | None = 1e-6,
    steps: int = 200,
    start: Tensor | None = None,
    preconditioner: Tensor | None = None,
    progress: Callable[[float], None] | None = None,
) -> Tensor:
    """Solve ``apply(x) + shift · x = right`` for a batch, each entry with steps of its own (Hestenes, Stiefel 1952).

    Args:
        apply: symmetric and positive semidefinite; without a shift ``right`` must lie in its range.
        right: (B, …).
        shift: ≥ 0, or a map.
        tolerance: residual, as a share of the norm of ``right``, at which the iteration stops; None takes a fixed
            number of steps, in operations that exporters know, of which those beyond rounding change nothing.
        steps: most steps taken.
        start: a solution that is near, such as that of the iteration before; zero if None.
        preconditioner: (…) near inverse of the diagonal.
        progress: called with the share of the steps that is done.
    """
    shifted = isinstance(shift, Tensor) or shift != 0

    def matrix(x: Tensor) -> Tensor:
        return apply(x) + shift * x if shifted else apply(x)

    tiny, rounding = torch.finfo(right.dtype).tiny, torch.finfo(right.dtype).eps ** 2
    inner = _inner if tolerance is not None else _inner_by_rows
    solution = torch.zeros_like(right) if start is None else start
    residual = right if start is None else right - matrix(start)
    direction = scaled = residual if preconditioner is None else preconditioner * residual
    first = energy = inner(residual, scaled)
    goal = None if tolerance is None else tolerance**2 * inner(right, right)
    for step in range(1, steps + 1):
        if goal is not None and bool((inner(residual, residual) <= goal).all()):
            break
        image = matrix(direction)
        length = energy / inner(direction, image).clamp_min(tiny)
        length = length * (energy > rounding * first) if goal is None else length
        solution, residual = solution + length * direction, residual - length * image
        scaled = residual if preconditioner is None else preconditioner * residual
        energy, previous = inner(residual, scaled), energy
        direction = scaled + energy / previous.clamp_min(tiny) * direction
        if progress is not None:
            progress(step / steps)
    return solution


def _inner(one: Tensor, other: Tensor) -> Tensor:
    """(B, 1, …) inner products."""
    return (one * other).sum(dim=tuple(range(1, one.ndim)), keepdim=True)


def _inner_by_rows(one: Tensor, other: Tensor) -> Tensor:
    """The same, row by row: exported, one sum of millions in single precision is rounded differently everywhere."""
    return torch.linalg.vecdot(one, other).flatten(1).sum(1).reshape(-1, *(1 for _ in one.shape[1:]))


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
            lambda y: self.A(self.A_adjoint(y)),
            snapshot,
            shift=shift,
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
