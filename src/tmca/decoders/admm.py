"""Total-variation reconstruction by the alternating direction method of multipliers (ADMM).

``min_x ½‖A x − y‖² + weight · TV(x)``, with ``lower ≤ x ≤ upper`` if wished, is split as u = x (data), v = ∇x
(variation) and z = x (bounds). Every step is then closed: u by the Woodbury identity, v by shrinkage, z by
clipping, x by the discrete cosine transform. Method and stopping: Boyd et al. (2011), with over-relaxation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from tmca.decoders.data_step import (
    Checked,
    DataStep,
    Operator,
    Result,
    channel_operator,
    check_settings,
    exposure_gain,
    noise_level,
)
from tmca.decoders.decoder import Decoder, Progress, Raw
from tmca.decoders.tv import NeumannSolver, divergence, field_norm, gradient, project
from tmca.errors import SettingError

_RELAXATION = 1.8
_CHECK_EVERY = 10
_EDGE = 0.1  # image differences (relative irradiance) that the first threshold takes to be flat
_IMBALANCE, _RESCALE = 10.0, 2.0

Bounds = tuple[float, float]


def default_weight(noise_sigma: float = 0.0) -> float:
    """A total-variation weight for cubes in [0, 1] of about twelve bands, seen at equal exposure.

    ``0.002 + 15 σ²``: the first term stands for the misfit of the model itself, the second is how the weight
    of a fixed prior grows with the noise. On 160² crops of three training scenes of CAVE under random codes, static
    and with eight slots, at σ = 0, 0.01 and 0.05, it is within 0.1 dB of the best of seven weights for joint
    variation and within 0.3 dB for band-wise variation (``benchmarks/defaults.py``).

    Args:
        noise_sigma: standard deviation of the snapshot's noise, where 1 is one band of a white scene.
    """
    if not (noise_sigma >= 0 and math.isfinite(noise_sigma)):
        raise SettingError("noise_sigma", f"{noise_sigma}", "a finite number ≥ 0")
    return 0.002 + 15 * noise_sigma**2


class _Split:
    """The copies u, v, z of x with their scaled multipliers, and one iteration over them."""

    def __init__(self, data: DataStep, start: Tensor, weight: float, joint: bool, bounds: Bounds | None) -> None:
        self.data, self.weight, self.joint, self.bounds = data, weight, joint, bounds
        self.x, self.slope = start, gradient(start)
        self.u, self.u_dual = start.clone(), torch.zeros_like(start)
        self.v, self.v_dual = self.slope.clone(), torch.zeros_like(self.slope)
        self.z, self.z_dual = start.clone(), torch.zeros_like(start)
        self.solve = NeumannSolver(start, 1.0 if bounds is None else 2.0)

    def step(self, rho: float) -> None:
        """x from all copies, then every copy and its multiplier from x."""
        right = divergence(self.v_dual - self.v).add_(self.u).sub_(self.u_dual)
        if self.bounds is not None:
            right.add_(self.z).sub_(self.z_dual)
        self.x = self.solve(right)
        self._step_data(rho)
        self._step_variation(rho)
        if self.bounds is not None:
            point = torch.lerp(self.z, self.x, _RELAXATION).add_(self.z_dual)
            self.z = point.clamp(*self.bounds)
            self.z_dual = point.sub_(self.z)

    def _step_data(self, rho: float) -> None:
        point = torch.lerp(self.u, self.x, _RELAXATION).add_(self.u_dual)
        self.u = self.data(point, rho)
        self.u_dual = point.sub_(self.u)

    def _step_variation(self, rho: float) -> None:
        """Shrinkage of p = ∇x + dual: the new dual is p cut to length weight/ρ, and v the rest of p."""
        gradient(self.x, out=self.slope)
        point = self.v.lerp_(self.slope, _RELAXATION).add_(self.v_dual)
        project(point, self.weight / rho, self.joint, out=self.v_dual)
        self.v = point.sub_(self.v_dual)

    def adjoint_of_copies(self) -> Tensor:
        """``Kᵀ(u, v, z)`` for the stacked map ``K x = (x, ∇x, x)``."""
        total = divergence(self.v).neg_().add_(self.u)
        return total if self.bounds is None else total.add_(self.z)

    def scale_duals(self, factor: float) -> None:
        for dual in (self.u_dual, self.v_dual, self.z_dual):
            dual.mul_(factor)

    def residuals(self, before: Tensor, rho: float, floor: float) -> tuple[float, float]:
        """Relative primal and dual residuals, ``before`` being `adjoint_of_copies` one iteration ago."""
        copies, images = [self.u, self.v], [self.x, self.slope]
        duals = [self.u_dual, self.v_dual]
        if self.bounds is not None:
            copies, images, duals = [*copies, self.z], [*images, self.x], [*duals, self.z_dual]
        gap = _norm([image - copy for image, copy in zip(images, copies, strict=True)])
        primal = gap / max(_norm(images), _norm(copies), 1e-30)
        change = _norm([self.adjoint_of_copies().sub_(before)])
        return primal, rho * change / max(rho * _norm(duals), floor, 1e-30)

    def estimate(self) -> Tensor:
        return self.x if self.bounds is None else self.x.clamp(*self.bounds)

    def objective(self) -> float:
        cube = self.estimate()
        slope = gradient(cube, out=torch.empty_like(self.slope))
        variation = float(field_norm(slope, self.joint).sum(dtype=torch.float64))
        return self.data.misfit(cube) + self.weight * variation


def _norm(parts: list[Tensor]) -> float:
    return math.hypot(*(float(torch.linalg.vector_norm(part)) for part in parts))


def _first_rho(data: DataStep, weight: float) -> float:
    """Penalty whose first threshold is a typical edge; without a weight, a share of the operator's energy."""
    if weight > 0:
        return weight / _EDGE
    energy = float(data.snapshot.square().sum())
    back = float(data.operator.A_adjoint(data.snapshot).square().sum())
    return 1e-2 * back / energy if energy > 0 and back > 0 else 1.0


@torch.no_grad()
def admm_tv(
    operator: Operator,
    snapshot: Tensor,
    weight: float,
    *,
    joint: bool = False,
    bounds: Bounds | None = None,
    max_iterations: int = 300,
    tolerance: float = 1e-3,
    rho: float | None = None,
    progress: Checked | None = None,
    initial: Tensor | None = None,
) -> Result:
    """``argmin_x ½‖A x − y‖² + weight · TV(x)`` subject to ``lower ≤ x ≤ upper``.

    Args:
        operator: the camera.
        snapshot: y, (B, 1, H, W'), float32 or float64.
        weight: weight of the total variation, ≥ 0; see `default_weight`.
        joint: one gradient norm over all bands (edges shared by the bands) instead of one per band.
        bounds: (lower, upper) of the estimate, either may be infinite; ``(0, inf)`` keeps it non-negative.
        max_iterations: most iterations done.
        tolerance: the iteration stops when, over the whole batch, the primal residual ‖Kx − w‖ is below this
            share of the copies' norm and the dual residual ρ‖KᵀΔw‖ below this share of the multipliers'
            norm, with K x = (x, ∇x, x) and w = (u, v, z). On cubes of 12 bands, 1e-3
            gives the objective to 3e-3 and the PSNR to 0.05 dB. 0 runs all iterations.
        rho: first penalty, by default 10 · weight; while the residuals differ tenfold it is balanced, in the
            first half of ``max_iterations``.
        progress: called at every check, see `Checked`.
        initial: (B, L, H, W) to start from, by default the pseudo-inverse of the snapshot.

    Raises:
        ShapeError: a snapshot or initial estimate that does not fit the operator.
        SettingError: an impossible weight, bound, penalty, tolerance or number of iterations.
    """
    _check(weight, bounds, rho)
    check_settings(max_iterations, tolerance)
    data = DataStep(operator, snapshot)
    rho = _first_rho(data, weight) if rho is None else rho
    split = _Split(data, data.start(initial), weight, joint, bounds)
    floor = tolerance * _norm([operator.A_adjoint(snapshot)])
    history: list[tuple[int, float, float, float]] = []
    converged = False
    for iteration in range(1, max_iterations + 1):
        if iteration % _CHECK_EVERY and iteration < max_iterations:
            split.step(rho)
            continue
        before = split.adjoint_of_copies()
        split.step(rho)
        primal, dual = split.residuals(before, rho, floor)
        history.append((iteration, split.objective(), primal, dual))
        if progress is not None:
            progress(iteration, primal, dual)
        converged = max(primal, dual) <= tolerance
        if converged:
            break
        if 2 * iteration <= max_iterations:
            factor = _balance(primal, dual)
            rho *= factor
            split.scale_duals(1 / factor)
    checked, objective, primals, duals = zip(*history, strict=True)
    return Result(split.estimate(), checked, objective, primals, duals, history[-1][0], converged)


def _balance(primal: float, dual: float) -> float:
    """Factor on the penalty that evens out the residuals (Boyd et al. 2011, 3.4.1; Wohlberg 2017)."""
    if primal > _IMBALANCE * dual:
        return _RESCALE
    return 1 / _RESCALE if dual > _IMBALANCE * primal else 1.0


def _check(weight: float, bounds: Bounds | None, rho: float | None) -> None:
    if not (weight >= 0 and math.isfinite(weight)):
        raise SettingError("weight", f"{weight}", "a finite number ≥ 0")
    if rho is not None and not (rho > 0 and math.isfinite(rho)):
        raise SettingError("rho", f"{rho}", "a finite number > 0", "leave it out for the default")
    if bounds is not None and not bounds[0] < bounds[1]:
        raise SettingError("bounds", f"{bounds}", "lower < upper")


@dataclass
class VariationDecoder(Decoder):
    """Total variation of every channel, by ADMM; no prior is learned.

    Args:
        tv_weight: weight of the total variation; chosen from the noise if None.
        iterations: at most.
    """

    name, label, cameras = "admm-tv", "ADMM-TV", frozenset({"spectral", "light-field"})
    joint: ClassVar[bool] = False
    tv_weight: float | None = None
    iterations: int = 300

    def reconstruct(self, prepared: Any, values: Tensor, progress: Progress | None) -> Raw:
        weight = self._usual_weight(prepared, values) if self.tv_weight is None else self.tv_weight
        result = admm_tv(
            channel_operator(prepared), values, weight, joint=self.joint, bounds=(0.0, math.inf),
            max_iterations=self.iterations,
            progress=None if progress is None else lambda iteration, *_: progress(iteration / self.iterations),
        )  # fmt: skip
        notes = {"tv_weight": weight, "iterations": result.iterations, "converged": result.converged}
        return Raw(result.estimate, notes=notes)

    def _usual_weight(self, camera: Any, values: Tensor) -> float:
        """The default was chosen at equal exposure; K times the light is K² times the data term."""
        gain = exposure_gain(camera)
        return default_weight(noise_level(camera, values) / gain) * gain**2


@dataclass
class JointVariationDecoder(VariationDecoder):
    """Total variation over all channels together, by ADMM; no prior is learned.

    Args:
        tv_weight: weight of the total variation; chosen from the noise if None.
        iterations: at most.
    """

    name, label, joint = "admm-tv-joint", "ADMM-TV joint", True
