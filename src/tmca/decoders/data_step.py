"""What iterative decoders share: the operator they need, the closed data step, the result they return."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import torch
from torch import Tensor

from tmca.errors import DataError, SettingError, ShapeError
from tmca.operators import TapOperator
from tmca.operators.linear import LinearOperator, conjugate_gradients

Checked = Callable[[int, float, float], None]
"""Called at every check with the iteration and the relative primal and dual residuals."""


_INNER = 1e-4  # of the inner iteration, which resumes from its last solution: the objective is then right to 1e-5


class Operator(Protocol):
    """A linear camera: scene (B, L, H, W) to snapshot (B, 1, H, W').

    Where it also has ``gram_solve(y, shift) -> (A Aᵀ + shift·I)⁻¹ y`` the data step is closed, else conjugate
    gradients take its place.
    """

    @property
    def scene_shape(self) -> tuple[int, ...]: ...

    @property
    def snapshot_shape(self) -> tuple[int, ...]: ...

    def A(self, x: Tensor, /) -> Tensor: ...

    def A_adjoint(self, y: Tensor, /) -> Tensor: ...

    def A_dagger(self, y: Tensor, /) -> Tensor: ...


@dataclass(frozen=True)
class Result:
    """Outcome of an iterative decoder.

    Args:
        estimate: (B, L, H, W).
        checked: iterations at which the histories below were taken.
        objective: value of the objective, summed over the batch (empty for a plugged-in denoiser).
        primal: relative primal residual.
        dual: relative dual residual.
        iterations: iterations done.
        converged: whether both residuals fell below the tolerance.
    """

    estimate: Tensor
    checked: tuple[int, ...]
    objective: tuple[float, ...]
    primal: tuple[float, ...]
    dual: tuple[float, ...]
    iterations: int
    converged: bool


class DataStep:
    """``argmin_x ½‖A x − y‖² + ρ/2 ‖x − point‖²``, solved in the space of the snapshot.

    By the Woodbury identity it is ``point + Aᵀ (A Aᵀ + ρ I)⁻¹ (y − A point)``.

    Args:
        operator: the camera.
        snapshot: (B, 1, H, W').
        tolerance: residual of the conjugate gradients, where they are needed, as a share of the misfit's norm.

    Raises:
        ShapeError: a snapshot that is not the operator's.
        DataError: NaN or infinite values in the snapshot.
    """

    def __init__(self, operator: Operator, snapshot: Tensor, tolerance: float = _INNER) -> None:
        if snapshot.ndim != 4 or tuple(snapshot.shape[1:]) != tuple(operator.snapshot_shape):
            wanted = f"(B, {', '.join(map(str, operator.snapshot_shape))})"
            raise ShapeError("snapshot", f"shape {tuple(snapshot.shape)}", wanted)
        if not bool(torch.isfinite(snapshot).all()):
            raise DataError("snapshot", "NaN or infinite values", "finite values", "mask or replace the bad pixels")
        self.operator, self.snapshot, self.tolerance = operator, snapshot, tolerance
        self._solved: Tensor | None = None

    def gram_solve(self, y: Tensor, shift: float) -> Tensor:
        """``(A Aᵀ + shift·I)⁻¹ y``, by the operator where it knows how, else iterated from the last solution."""
        if isinstance(self.operator, LinearOperator):
            self._solved = self.operator.gram_solve(y, shift, tolerance=self.tolerance, start=self._solved)
            return self._solved
        solve: Callable[[Tensor, float], Tensor] | None = getattr(self.operator, "gram_solve", None)
        if solve is not None:
            return solve(y, shift)
        self._solved = conjugate_gradients(
            lambda v: self.operator.A(self.operator.A_adjoint(v)), y,
            shift=shift, tolerance=self.tolerance, start=self._solved,
        )  # fmt: skip
        return self._solved

    def __call__(self, point: Tensor, rho: float) -> Tensor:
        """The minimiser (B, L, H, W) next to ``point`` (B, L, H, W)."""
        misfit = self.snapshot - self.operator.A(point)
        return point + self.operator.A_adjoint(self.gram_solve(misfit, rho))

    def misfit(self, cube: Tensor) -> float:
        """``½‖A x − y‖²``, summed over the batch."""
        return 0.5 * float((self.operator.A(cube) - self.snapshot).square().sum(dtype=torch.float64))

    def start(self, initial: Tensor | None) -> Tensor:
        """A copy of the initial estimate, by default the pseudo-inverse of the snapshot."""
        if initial is None:
            return self.operator.A_dagger(self.snapshot).clone()
        expected = (self.snapshot.shape[0], *self.operator.scene_shape)
        if tuple(initial.shape) != expected:
            raise ShapeError("initial", f"shape {tuple(initial.shape)}", f"{expected}")
        return initial.to(self.snapshot).clone()


def check_settings(max_iterations: int, tolerance: float) -> None:
    """Raises SettingError unless there is at least one iteration and the tolerance is a finite number ≥ 0."""
    if max_iterations < 1:
        raise SettingError("max_iterations", f"{max_iterations}", "at least 1")
    if not (tolerance >= 0 and math.isfinite(tolerance)):
        raise SettingError("tolerance", f"{tolerance}", "a finite number ≥ 0", "0 runs all iterations")


def channel_operator(camera: Any) -> LinearOperator:
    """The operator of a camera on scenes (B, channels, H, W), views side by side."""
    operator = camera.operator()
    return operator if len(operator.scene_shape) == 3 else TapOperator(camera.taps())


def noise_level(camera: Any, snapshot: Tensor) -> float:
    """Root mean square of the snapshot's noise."""
    return float(camera.noise.variance(snapshot).mean().sqrt())


def exposure_gain(camera: Any) -> float:
    """What one channel of a white scene gives through open codes: 1 at equal exposure, the slots where they add up."""
    return float(camera.full_scale) / float(camera.response.sum())
