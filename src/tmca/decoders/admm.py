"""Reconstruction under total variation by ADMM.

``min_x ½‖A x − y‖² + weight · TV(x)``, with ``lower ≤ x ≤ upper`` if wished, is split as u = x (data), v = ∇x
(variation) and z = x (bounds). u is the data step, v is shrunk and z clipped; x is brought nearer to the solution by
Chebyshev's iteration. Method and stopping: Boyd et al. (2011), with over-relaxation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce
from typing import Any, ClassVar

import torch
from torch import Tensor

from tmca.decoders.decoder import Decoder, Progress, Raw
from tmca.decoders.least_squares import (
    Checked,
    DataStep,
    Result,
    channel_operator,
    check_iteration,
    energy,
    exposure_gain,
    noise_level,
    of_iterations,
)
from tmca.decoders.tv import LARGEST_LAPLACIAN, add_adjoint, add_gradient, cut, distance, field_norm, gradient, norm
from tmca.errors import SettingError, check_range
from tmca.operators.linear import LinearOperator

_RELAXATION = 1.8
_CHECK_EVERY, _MOST_ITERATIONS = 10, 300
_EDGE = 0.1  # image differences (relative irradiance) that the first threshold takes to be flat
_IMBALANCE, _RESCALE = 10.0, 2.0
_PART = 2**18  # values that a processor's cache holds, as many as six times
_BOUND = 0.3  # β of the bounded copy: less is slower where bounds bind, 1 is slower where they hardly do

Bounds = tuple[float, float]


def _subtract_normal(right: Tensor, cube: Tensor, shift: float) -> Tensor:
    """``right − (shift·I + ∇ᵀ∇) cube``, in place of ``right``; both (B, L, H, W)."""
    right.sub_(cube, alpha=shift + 4)
    for axis in (-2, -1):
        last = cube.shape[axis] - 1
        right.narrow(axis, 1, last).add_(cube.narrow(axis, 0, last))
        right.narrow(axis, 0, last).add_(cube.narrow(axis, 1, last))
        for edge in (0, last):
            right.select(axis, edge).add_(cube.select(axis, edge))
    return right


def approach(cube: Tensor, right: Tensor, shift: float) -> None:
    """Brings a cube (B, L, H, W) nearer to the solution of ``(shift·I + ∇ᵀ∇) x = right``, in place.

    Two rounds of two steps of Chebyshev's iteration (Saad 2003, algorithm 12.1), whose bounds of the eigenvalues are
    shift and shift + 8. Two alike rounds leave a share ≥ 0 of every part of the error: no step goes too far, which
    keeps the relaxed iteration around it from diverging. ``right`` is overwritten.
    """
    centre, half = shift + LARGEST_LAPLACIAN / 2, LARGEST_LAPLACIAN / 2
    again = 1 / (2 * centre / half - half / centre)
    residual = _subtract_normal(right, cube, shift)
    for ends in (False, True):
        change = residual / centre
        cube += change
        _subtract_normal(residual, change, shift)
        change.mul_(again * half / centre).add_(residual, alpha=2 * again / half)
        cube += change
        if not ends:
            _subtract_normal(residual, change, shift)


def default_weight(noise_sigma: float = 0.0) -> float:
    """A total-variation weight for cubes in [0, 1] of about twelve bands, seen at equal exposure.

    ``0.002 + 15 σ²``: the first term stands for the misfit of the model itself, the second is how the weight
    of a fixed prior grows with the noise. On 160² crops of three training scenes of CAVE under random codes, static
    and with eight slots, at σ = 0, 0.01 and 0.05, it is within 0.1 dB of the best of seven weights for joint
    variation and within 0.3 dB for band-wise variation (``benchmarks/defaults.py``).

    Args:
        noise_sigma: standard deviation of the snapshot's noise, where 1 is one band of a white scene.
    """
    check_range("noise_sigma", noise_sigma, 0)
    return 0.002 + 15 * noise_sigma**2


def usual_weight(noise_sigma: float, gain: float) -> float:
    """`default_weight`, which was chosen at equal exposure: ``gain`` times the light is its square times the data term.

    Args:
        noise_sigma: as there.
        gain: see `tmca.decoders.least_squares.exposure_gain`.
    """
    return default_weight(noise_sigma / gain) * gain**2


class _Split:
    """The copies w = (u, v, √β z) of K x = (x, ∇x, √β x), and one iteration over them.

    Of every copy the point p = w + d is stored, where d is its scaled multiplier. The copies follow: u by the data step
    (stored too), v = share · p and z = p, clipped. Channels are taken by parts that a processor's cache holds.
    """

    def __init__(self, data: DataStep, start: Tensor, weight: float, joint: bool, bounds: Bounds) -> None:
        self.data, self.weight, self.joint, self.bounds = data, weight, joint, bounds
        self.x, self.u, self.data_point, self.bound_point = start, start.clone(), start.clone(), start.clone()
        self.variation_point = gradient(start)
        self.share = start.new_ones(start[:, :1].shape if joint else start.shape)
        size = max(1, _PART // start[:, :1].numel()) if start.device.type == "cpu" else start.shape[1]
        self.parts = [slice(first, first + size) for first in range(0, start.shape[1], size)]

    def step(self, rho: float) -> None:
        """x from all copies, then every copy from x."""
        for part in self.parts:
            approach(self.x[:, part], self._right(part), 1 + _BOUND)
            self._move(part)
        self.u = self.data(self.data_point, rho)
        self.share = 1 - cut(self.variation_point, self.weight / rho, self.joint)

    def _right(self, part: slice) -> Tensor:
        """Kᵀ(w − d), where w − d is 2 w − point."""
        bound = self.bound_point[:, part]
        right = bound.clamp(*self.bounds).mul_(2).sub_(bound).mul_(_BOUND)
        right.add_(self.u[:, part], alpha=2).sub_(self.data_point[:, part])
        return add_adjoint(right, self.variation_point[:, :, part] * self._share_of(part).mul(2).sub_(1))

    def _move(self, part: slice) -> None:
        """The points, by 1.8 (K x − w)."""
        x, bound = self.x[:, part], self.bound_point[:, part]
        self.data_point[:, part].add_(x, alpha=_RELAXATION).sub_(self.u[:, part], alpha=_RELAXATION)
        bound.add_(x - bound.clamp(*self.bounds), alpha=_RELAXATION)
        variation = self.variation_point[:, :, part].mul_(self._share_of(part).mul(-_RELAXATION).add_(1))
        add_gradient(variation, x, _RELAXATION)

    def _share_of(self, part: slice) -> Tensor:
        return self.share if self.joint else self.share[:, part]

    def _images(self, part: slice) -> list[Tensor]:
        x = self.x[:, part]
        return [x, gradient(x), x * math.sqrt(_BOUND)]

    def _points(self, part: slice) -> list[Tensor]:
        bound = self.bound_point[:, part] * math.sqrt(_BOUND)
        return [self.data_point[:, part], self.variation_point[:, :, part], bound]

    def _copies(self, part: slice) -> list[Tensor]:
        bounded = self.bound_point[:, part].clamp(*self.bounds).mul_(math.sqrt(_BOUND))
        return [self.u[:, part], self.variation_point[:, :, part] * self._share_of(part), bounded]

    def _adjoint_of_copies(self, part: slice) -> Tensor:
        data, variation, bounded = self._copies(part)
        return add_adjoint(data.add(bounded, alpha=math.sqrt(_BOUND)), variation)

    def adjoint_of_copies(self) -> Tensor:
        """Kᵀ w."""
        return torch.cat([self._adjoint_of_copies(part) for part in self.parts], 1)

    def measured_step(self, rho: float, floor: float) -> tuple[float, float]:
        """`step`, and the residuals that it leaves."""
        before = self.adjoint_of_copies()
        self.step(rho)
        return self.residuals(before, rho, floor)

    def residuals(self, before: Tensor, rho: float, floor: float) -> tuple[float, float]:
        """Relative primal and dual residuals, ``before`` being `adjoint_of_copies` one iteration ago."""
        lengths = []
        for part in self.parts:
            images, points, copies = self._images(part), self._points(part), self._copies(part)
            change = distance([self._adjoint_of_copies(part)], [before[:, part]])
            lengths.append((distance(images, copies), norm(images), norm(copies), change, distance(points, copies)))
        gap, image, copy, change, dual = (math.hypot(*parts) for parts in zip(*lengths, strict=True))
        return gap / max(image, copy, 1e-30), rho * change / max(rho * dual, floor, 1e-30)

    def balanced(self, rho: float, primal: float, dual: float) -> float:
        """A penalty that evens out the residuals, and the multipliers with it."""
        factor = _balance(primal, dual)
        if factor != 1:
            self.rescale(factor)
        return rho * factor

    def rescale(self, factor: float) -> None:
        """Multipliers over a factor, of a penalty that grows by it: the copies stay."""
        self.data_point = torch.lerp(self.u, self.data_point, 1 / factor)
        self.bound_point = torch.lerp(self.bound_point.clamp(*self.bounds), self.bound_point, 1 / factor)
        shorter = self.share + (1 - self.share) / factor
        self.variation_point *= shorter
        self.share /= shorter

    def estimate(self) -> Tensor:
        return self.x.clamp(*self.bounds)

    def objective(self) -> float:
        cube = self.estimate()
        lengths = [field_norm(gradient(cube[:, part]), self.joint) for part in self.parts]
        variation = reduce(torch.hypot, lengths) if self.joint else torch.cat(lengths, 1)
        return self.data.misfit(cube) + self.weight * float(variation.sum(dtype=torch.float64))


@torch.no_grad()
def admm_tv(
    operator: LinearOperator,
    snapshot: Tensor,
    weight: float,
    *,
    joint: bool = False,
    bounds: Bounds | None = None,
    max_iterations: int = _MOST_ITERATIONS,
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
            norm, with K x = (x, ∇x, √β x) and w its copies. On cubes of 12 bands, 1e-3
            gives the objective to 2e-3 and the PSNR to 0.02 dB. 0 runs all iterations.
        rho: first penalty, by default 10 · weight; while the residuals differ tenfold it is balanced, in the
            first half of ``max_iterations``.
        progress: called at every check, see `Checked`.
        initial: (B, L, H, W) to start from, see `DataStep.start`.

    Raises:
        ShapeError, SettingError: a snapshot or initial estimate that does not fit, or a number out of range.
    """
    _check_settings(weight, max_iterations, tolerance, rho, bounds)
    data = DataStep(operator, snapshot)
    rho = _first_penalty(operator, snapshot, weight) if rho is None else rho
    split = _Split(data, data.start(initial, rho), weight, joint, bounds or (-math.inf, math.inf))
    floor = tolerance * norm([operator.A_adjoint(snapshot)])
    history: list[tuple[int, float, float, float]] = []
    converged = False
    for iteration in range(1, max_iterations + 1):
        if iteration % _CHECK_EVERY and iteration < max_iterations:
            split.step(rho)
            continue
        primal, dual = split.measured_step(rho, floor)
        history.append((iteration, split.objective(), primal, dual))
        if progress is not None:
            progress(iteration, primal, dual)
        converged = max(primal, dual) <= tolerance
        if converged:
            break
        if 2 * iteration <= max_iterations:
            rho = split.balanced(rho, primal, dual)
    checked, objective, primals, duals = zip(*history, strict=True)
    return Result(split.estimate(), checked, objective, primals, duals, history[-1][0], converged)


def _check_settings(
    weight: float, max_iterations: int, tolerance: float, rho: float | None, bounds: Bounds | None
) -> None:
    check_range("weight", weight, 0)
    check_iteration(max_iterations, tolerance)
    if rho is not None:
        check_range("rho", rho, above=0)
    if bounds is not None and not bounds[0] < bounds[1]:
        raise SettingError("bounds", f"{bounds}", "lower < upper")


def _first_penalty(operator: LinearOperator, snapshot: Tensor, weight: float) -> float:
    """Its first threshold is a typical edge; without a weight, a share of the operator's energy."""
    return weight / _EDGE if weight > 0 else 1e-2 * energy(operator, snapshot) or 1.0


def least_variation(
    operator: LinearOperator,
    snapshot: Tensor,
    weight: float,
    *,
    joint: bool,
    iterations: int = _MOST_ITERATIONS,
    progress: Progress | None = None,
) -> Result:
    """`admm_tv` of a scene of light, which is not negative; ``progress`` is called with the share that is done."""
    how: dict[str, Any] = {"max_iterations": iterations, "progress": of_iterations(progress, iterations)}
    return admm_tv(operator, snapshot, weight, joint=joint, bounds=(0.0, math.inf), **how)


def _balance(primal: float, dual: float) -> float:
    """Factor on the penalty that evens out the residuals (Boyd et al. 2011, 3.4.1; Wohlberg 2017)."""
    if primal > _IMBALANCE * dual:
        return _RESCALE
    return 1 / _RESCALE if dual > _IMBALANCE * primal else 1.0


@dataclass
class VariationDecoder(Decoder):
    """Total variation of every channel, by ADMM; no prior is learned.

    Args:
        tv_weight: weight of the total variation; chosen from the noise if None.
        iterations: largest number of them.
    """

    name, label, cameras = "admm-tv", "ADMM-TV", frozenset({"spectral", "light-field"})
    joint: ClassVar[bool] = False
    tv_weight: float | None = None
    iterations: int = _MOST_ITERATIONS

    def __post_init__(self) -> None:
        if self.tv_weight is not None:
            check_range("tv_weight", self.tv_weight, 0)
        check_range("iterations", self.iterations, 1, whole=True)

    def reconstruct(self, prepared: Any, values: Tensor, progress: Progress | None) -> Raw:
        weight = self._usual_weight(prepared, values) if self.tv_weight is None else self.tv_weight
        how: dict[str, Any] = {"joint": self.joint, "iterations": self.iterations, "progress": progress}
        return least_variation(channel_operator(prepared), values, weight, **how).raw(tv_weight=weight)

    def _usual_weight(self, camera: Any, values: Tensor) -> float:
        return usual_weight(noise_level(camera, values), exposure_gain(camera))


@dataclass
class JointVariationDecoder(VariationDecoder):
    """Total variation over all channels together, by ADMM; no prior is learned.

    Args:
        tv_weight: weight of the total variation; chosen from the noise if None.
        iterations: largest number of them.
    """

    name, label, joint = "admm-tv-joint", "ADMM-TV joint", True
