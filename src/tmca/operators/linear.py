"""What every camera's linear part offers: ``A``, ``A_adjoint``, ``A_dagger`` (deepinv's names and meaning)."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor, nn

from tmca.errors import SettingError, ShapeError

_TOLERANCE = {torch.float32: 1e-6, torch.float64: 1e-11}


def conjugate_gradients(
    apply: Callable[[Tensor], Tensor],
    right: Tensor,
    *,
    shift: float = 0.0,
    tolerance: float | None = 1e-6,
    steps: int = 200,
    start: Tensor | None = None,
    preconditioner: Tensor | None = None,
    progress: Callable[[float], None] | None = None,
) -> Tensor:
    """Solve ``apply(x) + shift · x = right`` for a batch, each entry with steps of its own (Hestenes, Stiefel 1952).

    Args:
        apply: symmetric and positive semidefinite, in whose range ``right`` lies.
        right: (B, …).
        shift: ≥ 0.
        tolerance: residual, as a share of the norm of ``right``, at which the iteration stops; None takes a fixed
            number of steps, in operations that exporters know, of which those beyond rounding change nothing.
        steps: most steps taken.
        start: a solution that is near, such as that of the iteration before; zero if None.
        preconditioner: (…) near inverse of the diagonal.
        progress: told the share of the steps that is done.
    """
    tiny, rounding = torch.finfo(right.dtype).tiny, torch.finfo(right.dtype).eps ** 2
    inner = _inner if tolerance is not None else _inner_by_rows
    solution = torch.zeros_like(right) if start is None else start
    residual = right if start is None else right - apply(start) - shift * start
    direction = scaled = residual if preconditioner is None else preconditioner * residual
    first = energy = inner(residual, scaled)
    goal = None if tolerance is None else tolerance**2 * inner(right, right)
    for step in range(1, steps + 1):
        if goal is not None and bool((inner(residual, residual) <= goal).all()):
            break
        image = apply(direction) + shift * direction if shift else apply(direction)
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
        solved = conjugate_gradients(
            lambda y: self.A(self.A_adjoint(y)), snapshot, tolerance=_TOLERANCE[snapshot.dtype], steps=1000
        )
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
