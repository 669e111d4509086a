"""Total variation in space and time, for scenes that change from slot to slot.

``min_x ½‖A x − y‖² + weight · Σ |(∂_y x, ∂_x x, time · ∂_t x)|``, isotropic over the three directions, by the
primal-dual method of Chambolle and Pock (2011), whose data step is that of `tmca.decoders.admm_tv`.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn.functional import pad

from tmca.decoders.iterative.data_step import DataStep, Operator, Progress, Result, check_settings
from tmca.errors import SettingError

_CHECK_EVERY = 10


def slopes(movie: Tensor, time: float) -> Tensor:
    """(3, B, K, L, H, W) forward differences along rows, columns and slots (times ``time``), zero at the end."""
    parts = []
    for axis, room in ((-2, (0, 0, 0, 1)), (-1, (0, 1)), (-4, (0, 0, 0, 0, 0, 0, 0, 1))):
        parts.append(pad(movie.diff(dim=axis), room))
    parts[2] = parts[2] * time
    return torch.stack(parts)


def slopes_adjoint(field: Tensor, time: float) -> Tensor:
    """Adjoint of `slopes`: (3, B, K, L, H, W) → (B, K, L, H, W)."""
    total = torch.zeros_like(field[0])
    for part, axis, factor in zip(field, (-2, -1, -4), (1.0, 1.0, time), strict=True):
        inner = part.narrow(axis, 0, part.shape[axis] - 1) * factor
        total.narrow(axis, 0, part.shape[axis] - 1).sub_(inner)
        total.narrow(axis, 1, part.shape[axis] - 1).add_(inner)
    return total


def space_time_variation(movie: Tensor, time: float) -> float:
    """Sum over all values of ``|(∂_y x, ∂_x x, time · ∂_t x)|``."""
    return float(_length(slopes(movie, time)).sum(dtype=torch.float64))


@torch.no_grad()
def space_time_tv(
    operator: Operator,
    snapshot: Tensor,
    weight: float,
    *,
    time: float = 1.0,
    max_iterations: int = 300,
    tolerance: float = 1e-3,
    progress: Progress | None = None,
    initial: Tensor | None = None,
) -> Result:
    """A scene per slot from one snapshot.

    Args:
        operator: of scenes (B, K, L, H, W), such as `tmca.operators.SlotwiseDisperser` with ``moving=True``.
        snapshot: (B, 1, H, W').
        weight: of the variation, > 0.
        time: weight of a difference between slots, relative to one between pixels, ≥ 0; large for a still scene.
        max_iterations: most iterations done.
        tolerance: the iteration stops when scene and dual field change by less than this share of their norms.
        progress: called at every check with the iteration and both changes.
        initial: (B, K, L, H, W) to start from, by default the pseudo-inverse of the snapshot.

    Raises:
        ShapeError: a snapshot or initial scene that does not fit the operator.
        SettingError: an impossible weight, tolerance or number of iterations.
    """
    check_settings(max_iterations, tolerance)
    if not (weight > 0 and math.isfinite(weight)) or not (time >= 0 and math.isfinite(time)):
        raise SettingError("weight, time", f"{weight:g}, {time:g}", "a finite weight > 0 and a finite time ≥ 0")
    data = DataStep(operator, snapshot)
    movie = data.start(initial)
    field, reached = torch.zeros_like(slopes(movie, time)), movie.clone()
    length = 8 + 4 * time**2  # bound on the squared norm of `slopes`
    primal = 4.0 / math.sqrt(length)  # values of order one, dual field of the order of the weight
    dual = 1 / (length * primal)
    history: list[tuple[int, float, float, float]] = []
    converged = False
    for iteration in range(1, max_iterations + 1):
        before, last = movie, field
        field = _cut(field + dual * slopes(reached, time), weight)
        movie = data(movie - primal * slopes_adjoint(field, time), 1 / primal)
        reached = 2 * movie - before
        if iteration % _CHECK_EVERY and iteration < max_iterations:
            continue
        changes = _change(movie, before), _change(field, last)
        value = data.misfit(movie) + weight * space_time_variation(movie, time)
        history.append((iteration, value, *changes))
        if progress is not None:
            progress(iteration, *changes)
        converged = max(changes) <= tolerance
        if converged:
            break
    checked, objective, primals, duals = zip(*history, strict=True)
    return Result(movie, checked, objective, primals, duals, history[-1][0], converged)


def _length(field: Tensor) -> Tensor:
    """Euclidean norm over the first axis; far faster than a reduction over a short leading axis."""
    return (field[0] * field[0]).addcmul_(field[1], field[1]).addcmul_(field[2], field[2]).sqrt_()


def _cut(field: Tensor, radius: float) -> Tensor:
    """The field with no vector longer than the radius."""
    return field * (radius / _length(field).clamp_min(radius))


def _change(now: Tensor, before: Tensor) -> float:
    return float(torch.linalg.vector_norm(now - before)) / max(float(torch.linalg.vector_norm(now)), 1e-30)
