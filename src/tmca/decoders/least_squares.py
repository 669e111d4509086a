"""What the snapshot alone says of the scene: the data step of iterative decoders, least norm, a smooth scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import pad

from tmca.decoders.decoder import Decoder, Progress, Raw
from tmca.errors import DataError, check_range, check_shape
from tmca.operators import TapOperator
from tmca.operators.linear import LinearOperator, conjugate_gradients

Checked = Callable[[int, float, float], None]
"""Called at every check with the iteration and the relative primal and dual residuals."""
_INNER = 1e-4  # of the inner iteration, which resumes from its last solution: the objective is then right to 1e-5


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

    def raw(self, **notes: Any) -> Raw:
        """What a decoder returns of it."""
        return Raw(self.estimate, notes={**notes, "iterations": self.iterations, "converged": self.converged})


class DataStep:
    """``argmin_x ½‖A x − y‖² + ρ/2 ‖x − point‖²``, as ``prox_l2`` of the operator.

    Where ``A Aᵀ`` has no closed inverse, its iteration resumes from the last solution.

    Args:
        operator: the camera.
        snapshot: (B, 1, H, W').
        tolerance: residual of the conjugate gradients, where they are needed, as a share of the misfit's norm.

    Raises:
        ShapeError: a snapshot that is not the operator's.
        DataError: NaN or infinite values in the snapshot.
    """

    def __init__(self, operator: LinearOperator, snapshot: Tensor, tolerance: float = _INNER) -> None:
        check_shape("snapshot", snapshot, ("B", *operator.snapshot_shape))
        if not bool(torch.isfinite(snapshot).all()):
            raise DataError("snapshot", "NaN or infinite values", "finite values", "mask or replace the bad pixels")
        self.operator, self.snapshot, self.tolerance = operator, snapshot, tolerance
        self._solved: Tensor | None = None

    def __call__(self, point: Tensor, rho: float) -> Tensor:
        """The minimiser (B, L, H, W) next to ``point`` (B, L, H, W)."""
        misfit = self.snapshot - self.operator.A(point)
        self._solved = self.operator.gram_solve(misfit, rho, tolerance=self.tolerance, start=self._solved)
        return point + self.operator.A_adjoint(self._solved)

    def misfit(self, cube: Tensor) -> float:
        """``½‖A x − y‖²``, summed over the batch."""
        return 0.5 * float((self.operator.A(cube) - self.snapshot).square().sum(dtype=torch.float64))

    def start(self, initial: Tensor | None, rho: float) -> Tensor:
        """A copy of the initial estimate; by default the pseudo-inverse of the snapshot.

        Without a closed inverse of ``A Aᵀ`` it is the data step next to darkness: noise lies where such an operator
        hardly lets light through, and there the pseudo-inverse is of any size.
        """
        expected = (len(self.snapshot), *self.operator.scene_shape)
        if initial is not None:
            check_shape("initial", initial, expected)
            return initial.to(self.snapshot).clone()
        if type(self.operator).gram_solve is LinearOperator.gram_solve:
            return self(self.snapshot.new_zeros(expected), rho)
        return self.operator.A_dagger(self.snapshot).clone()


def energy(operator: LinearOperator, snapshot: Tensor) -> float:
    """What ``A Aᵀ`` does to a snapshot on average, ``‖Aᵀ y‖² / ‖y‖²``; 0 of darkness."""
    back, light = (part.square().sum() for part in (operator.A_adjoint(snapshot), snapshot))
    return float(back / light.clamp_min(torch.finfo(light.dtype).tiny))


def check_iteration(max_iterations: int, tolerance: float) -> None:
    """Raises SettingError unless there is at least one iteration and the tolerance is a finite number ≥ 0."""
    check_range("max_iterations", max_iterations, 1)
    check_range("tolerance", tolerance, 0)


def of_iterations(progress: Progress | None, iterations: int) -> Checked | None:
    """What reports the share of the iterations that is done."""
    return None if progress is None else lambda iteration, *_: progress(iteration / iterations)


def channel_operator(camera: Any) -> LinearOperator:
    """The operator of a camera on scenes (B, channels, H, W), views side by side."""
    operator = camera.operator()
    return operator if len(operator.scene_shape) == 3 else TapOperator(camera.taps())


def noise_level(camera: Any, snapshot: Tensor) -> float:
    """Root mean square of the snapshot's noise."""
    return float(camera.noise.variance(snapshot).mean().sqrt())


def exposure_gain(camera: Any) -> float:
    """What one channel of a white scene gives through open codes: 1 at equal exposure, the slots where they add up."""
    return float(camera.exposures)


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
    check_range("weight", weight, above=0)
    check_range("iterations", iterations, 1)
    check_shape("snapshot", snapshot, ("B", *operator.snapshot_shape))
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
    needs_taps = True
    weight: float = 0.3
    iterations: int = 100

    def __post_init__(self) -> None:
        check_range("weight", self.weight, above=0)
        check_range("iterations", self.iterations, 1, whole=True)

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
