"""Isotropic total variation of cubes: value, proximal operator, and reconstruction under it by ADMM.

Finite differences are forward, with the last one zero (Neumann boundary). ``joint=False`` sums the variation
of every band; ``joint=True`` is the vectorial variation of Bresson and Chan (2008), whose gradient norm runs
over both axes and all bands, so that the edges of all bands fall together.

``min_x ½‖A x − y‖² + weight · TV(x)``, with ``lower ≤ x ≤ upper`` if wished, is split as u = x (data), v = ∇x
(variation) and z = x (bounds). Every step is then closed: u by the Woodbury identity, v by shrinkage, z by
clipping, x by the discrete cosine transform. Method and stopping: Boyd et al. (2011), with over-relaxation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import scipy.fft
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
from tmca.errors import SettingError, check_range, check_shape
from tmca.operators.linear import LinearOperator

_LARGEST_LAPLACIAN = 8.0  # bound on the eigenvalues of ∇ᵀ∇ in two dimensions
_RELAXATION = 1.8
_CHECK_EVERY = 10
_EDGE = 0.1  # image differences (relative irradiance) that the first threshold takes to be flat
_IMBALANCE, _RESCALE = 10.0, 2.0

Bounds = tuple[float, float]


def gradient(cube: Tensor) -> Tensor:
    """Forward differences (2, B, L, H, W) of a cube (B, L, H, W), along H first; zero in the last row or column."""
    field = cube.new_zeros((2, *cube.shape))
    field[0, ..., :-1, :] = cube.diff(dim=-2)
    field[1, ..., :-1] = cube.diff(dim=-1)
    return field


def divergence(field: Tensor) -> Tensor:
    """The negative adjoint of `gradient`, (2, B, L, H, W) → (B, L, H, W): ``⟨∇x, p⟩ = −⟨x, div p⟩``."""
    rows, columns = field[0, ..., :-1, :], field[1, ..., :-1]
    div = torch.empty_like(field[0])
    div[..., :-1, :] = rows
    div[..., -1, :] = 0
    div[..., 1:, :] -= rows
    div[..., :-1] += columns
    div[..., 1:] -= columns
    return div


def field_norm(field: Tensor, joint: bool = False) -> Tensor:
    """Length of the gradient at every pixel: (B, L, H, W), or (B, 1, H, W) over all bands if ``joint``."""
    if not joint:
        return (field[0] * field[0]).addcmul_(field[1], field[1]).sqrt_()
    energy = torch.zeros_like(field[0, :, :1])
    for band in field.transpose(1, 2).flatten(0, 1):  # a running sum needs no other cube
        energy[:, 0].addcmul_(band, band)
    return energy.sqrt_()


def total_variation(cube: Tensor, joint: bool = False) -> Tensor:
    """Isotropic total variation (B,) of cubes (B, L, H, W), summed over pixels (and bands, unless joint).

    It is differentiable, with derivative zero where the cube is flat.
    """
    check_shape("cube", cube, ("B", "L", "H", "W"))
    norm = torch.linalg.vector_norm(gradient(cube), dim=(0, 2) if joint else (0,))
    return norm.flatten(1).sum(1)


def project(field: Tensor, radius: float, joint: bool = False) -> Tensor:
    """Projection of a (2, B, L, H, W) field onto lengths up to ``radius``."""
    return field * _cut(field, radius, joint)


def _cut(field: Tensor, radius: float, joint: bool) -> Tensor:
    """What brings the lengths of a field down to ``radius``, at most one."""
    length = field_norm(field, joint).clamp_min_(max(radius, torch.finfo(field.dtype).tiny))
    return length.reciprocal_().mul_(radius)


@torch.no_grad()
def tv_prox(
    cube: Tensor, weight: float, joint: bool = False, *, max_iterations: int = 200, tolerance: float = 1e-4
) -> Tensor:
    """Total-variation denoising, ``argmin_x ½‖x − cube‖² + weight · TV(x)``.

    Fast gradient projection on the dual (Beck and Teboulle 2009).

    Args:
        cube: (B, L, H, W).
        weight: ≥ 0, in the units of the cube.
        joint: one gradient norm over all bands instead of one per band.
        max_iterations: most steps taken.
        tolerance: stop when a step changes the estimate by less than this share of its norm.
    """
    check_range("weight", weight, 0)
    check_iteration(max_iterations, tolerance)
    dual = cube.new_zeros((2, *cube.shape))
    ahead, step, estimate = dual.clone(), 1.0, cube
    for _ in range(max_iterations):
        ascent = ahead + gradient(cube + divergence(ahead)) / _LARGEST_LAPLACIAN
        ascent = project(ascent, weight, joint)
        step_next = (1 + math.sqrt(1 + 4 * step**2)) / 2
        ahead = ascent + (ascent - dual) * ((step - 1) / step_next)
        dual, step, previous = ascent, step_next, estimate
        estimate = cube + divergence(dual)
        if torch.linalg.vector_norm(estimate - previous) <= tolerance * torch.linalg.vector_norm(estimate):
            break
    return estimate


def cosines(size: int, like: Tensor) -> Tensor:
    """Orthonormal DCT-II matrix (size, size), one frequency per row."""
    index = torch.arange(size, dtype=torch.float64)
    matrix = torch.cos(math.pi / size * torch.outer(index, index + 0.5)) * math.sqrt(2 / size)
    matrix[0] /= math.sqrt(2)
    return matrix.to(like)


class NeumannSolver:
    """Solves ``(shift·I + ∇ᵀ∇) x = b`` with the gradient of this file, exactly.

    The DCT-II diagonalises ∇ᵀ∇ (forward differences, Neumann boundary) with the eigenvalues 2 − 2 cos(πk/N)
    per axis (Strang 1999). On the CPU the transform is SciPy's, elsewhere (or ``by_matrices``) two matrix products.
    The right-hand sides (…, H, W) are ``like`` a tensor in size, type and device.
    """

    def __init__(self, like: Tensor, shift: float, *, by_matrices: bool | None = None) -> None:
        height, width = like.shape[-2:]
        down, across = (2 - 2 * torch.cos(math.pi / n * torch.arange(n).double()) for n in (height, width))
        self.response = (1 / (shift + down[:, None] + across)).to(like)
        by_matrices = like.device.type != "cpu" if by_matrices is None else by_matrices
        self.matrices = (cosines(height, like), cosines(width, like)) if by_matrices else None

    def __call__(self, right: Tensor) -> Tensor:
        """x (…, H, W) for the right-hand side b of that shape, whose values may be overwritten."""
        if self.matrices is not None:
            rows, columns = self.matrices
            return rows.mT @ ((rows @ right @ columns.mT) * self.response) @ columns
        axes = {"axes": (-2, -1), "norm": "ortho", "overwrite_x": True}
        spectrum = torch.from_numpy(scipy.fft.dctn(right.numpy(), **axes))
        return torch.from_numpy(scipy.fft.idctn(spectrum.mul_(self.response).numpy(), **axes))


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


class _Split:
    """The copies u, v (and z) of K x = (x, ∇x, x) with their scaled multipliers, and one iteration over them."""

    def __init__(self, data: DataStep, start: Tensor, weight: float, joint: bool, bounds: Bounds | None) -> None:
        self.data, self.weight, self.joint, self.bounds = data, weight, joint, bounds
        self.images = [start, gradient(start)] if bounds is None else [start, gradient(start), start]
        self.copies = [image.clone() for image in self.images]
        self.duals = [torch.zeros_like(image) for image in self.images]
        self.solve = NeumannSolver(start, len(self.images) - 1.0)

    def step(self, rho: float) -> None:
        """x from all copies, then every copy and its multiplier from x."""
        x = self.solve(adjoint_of_copies([copy - dual for copy, dual in zip(self.copies, self.duals, strict=True)]))
        self.images = [x, gradient(x), x][: len(self.images)]
        for index, image in enumerate(self.images):
            point = self.copies[index].lerp_(image, _RELAXATION).add_(self.duals[index])
            self.copies[index] = self._nearest(index, point, rho)
            self.duals[index] = point.sub_(self.copies[index])

    def _nearest(self, index: int, point: Tensor, rho: float) -> Tensor:
        """Proximal operator of the data, of the variation (shrinkage) or of the bounds."""
        if index == 0:
            return self.data(point, rho)
        if index == 1:
            return point * (1 - _cut(point, self.weight / rho, self.joint))
        assert self.bounds is not None
        return point.clamp(*self.bounds)

    def residuals(self, before: Tensor, rho: float, floor: float) -> tuple[float, float]:
        """Relative primal and dual residuals, ``before`` being `adjoint_of_copies` one iteration ago."""
        gap = norm([image - copy for image, copy in zip(self.images, self.copies, strict=True)])
        primal = gap / max(norm(self.images), norm(self.copies), 1e-30)
        change = norm([adjoint_of_copies(self.copies).sub_(before)])
        return primal, rho * change / max(rho * norm(self.duals), floor, 1e-30)

    def estimate(self) -> Tensor:
        return self.images[0] if self.bounds is None else self.images[0].clamp(*self.bounds)

    def objective(self) -> float:
        cube = self.estimate()
        variation = float(field_norm(gradient(cube), self.joint).sum(dtype=torch.float64))
        return self.data.misfit(cube) + self.weight * variation


def adjoint_of_copies(copies: Sequence[Tensor]) -> Tensor:
    """``Kᵀ(u, v, z)`` for the stacked map ``K x = (x, ∇x, x)``."""
    total = divergence(copies[1]).neg_().add_(copies[0])
    return total.add_(copies[2]) if len(copies) > 2 else total


def norm(parts: list[Tensor]) -> float:
    """Euclidean norm of all together."""
    return math.hypot(*(float(torch.linalg.vector_norm(part)) for part in parts))


@torch.no_grad()
def admm_tv(
    operator: LinearOperator,
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
        initial: (B, L, H, W) to start from, see `DataStep.start`.

    Raises:
        ShapeError, SettingError: a snapshot or initial estimate that does not fit, or a number out of range.
    """
    check_range("weight", weight, 0)
    check_iteration(max_iterations, tolerance)
    if rho is not None:
        check_range("rho", rho, above=0)
    if bounds is not None and not bounds[0] < bounds[1]:
        raise SettingError("bounds", f"{bounds}", "lower < upper")
    data = DataStep(operator, snapshot)
    if rho is None:  # its first threshold is a typical edge; without a weight, a share of the operator's energy
        rho = weight / _EDGE if weight > 0 else 1e-2 * energy(operator, snapshot) or 1.0
    split = _Split(data, data.start(initial, rho), weight, joint, bounds)
    floor = tolerance * norm([operator.A_adjoint(snapshot)])
    history: list[tuple[int, float, float, float]] = []
    converged = False
    for iteration in range(1, max_iterations + 1):
        if iteration % _CHECK_EVERY and iteration < max_iterations:
            split.step(rho)
            continue
        before = adjoint_of_copies(split.copies)
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
            split.duals = [dual / factor for dual in split.duals]
    checked, objective, primals, duals = zip(*history, strict=True)
    return Result(split.estimate(), checked, objective, primals, duals, history[-1][0], converged)


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
    iterations: int = 300

    def __post_init__(self) -> None:
        if self.tv_weight is not None:
            check_range("tv_weight", self.tv_weight, 0)
        check_range("iterations", self.iterations, 1, whole=True)

    def reconstruct(self, prepared: Any, values: Tensor, progress: Progress | None) -> Raw:
        weight = self._usual_weight(prepared, values) if self.tv_weight is None else self.tv_weight
        result = admm_tv(
            channel_operator(prepared), values, weight, joint=self.joint, bounds=(0.0, math.inf),
            max_iterations=self.iterations, progress=of_iterations(progress, self.iterations),
        )  # fmt: skip
        return result.raw(tv_weight=weight)

    def _usual_weight(self, camera: Any, values: Tensor) -> float:
        """The default was chosen at equal exposure; K times the light is K² times the data term."""
        gain = exposure_gain(camera)
        return default_weight(noise_level(camera, values) / gain) * gain**2


@dataclass
class JointVariationDecoder(VariationDecoder):
    """Total variation over all channels together, by ADMM; no prior is learned.

    Args:
        tv_weight: weight of the total variation; chosen from the noise if None.
        iterations: largest number of them.
    """

    name, label, joint = "admm-tv-joint", "ADMM-TV joint", True
