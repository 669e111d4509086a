"""Joint descent in positions and weights: what lets atoms leave the grid."""

from __future__ import annotations

import numpy as np

from tmca.dbd.arrays import Complex, Real
from tmca.dbd.atoms.measure import Measure
from tmca.dbd.descent import levenberg_marquardt
from tmca.dbd.solvers.group_lasso import penalties


def objective(measure: Measure, level: float) -> float:
    """``½‖y − A w‖² + Σ level·weight ‖wᵢ‖``."""
    fit = 0.5 * float(np.linalg.norm(measure.residual()) ** 2)
    return fit + level * float(sum(strengths.sum() for strengths in measure.strengths()))


def slide(measure: Measure, level: float, steps: int = 10) -> None:
    """Levenberg–Marquardt steps on all positions and weights together, in place; ``level`` 0 is least squares.

    The curvature of ``‖w‖`` is exact, that of the fit Gauss–Newton's.
    """
    if not sum(measure.counts):
        return
    found = levenberg_marquardt(
        measure, lambda one: objective(one, level), lambda one: _system(one, level), _moved, steps
    )
    measure.points, measure.weights = found.points, found.weights


def _system(measure: Measure, level: float) -> tuple[Real, Real]:
    """Hessian and gradient in (real weights, imaginary weights, positions)."""
    matrix, slopes = measure.matrix(), measure.slopes()
    left = measure.y - matrix @ measure.vector()
    both = np.hstack([matrix, slopes])
    gram = both.conj().T @ both
    right = both.conj().T @ left
    hessian, gradient = _real(gram, right, matrix.shape[1])
    if level:
        _add_penalty(measure, level, hessian, gradient)
    return hessian, gradient


def _real(gram: Complex, right: Complex, weights: int) -> tuple[Real, Real]:
    """Real system of complex weights, which come first, and real positions."""
    w, x = slice(0, weights), slice(weights, None)
    ww, wx = gram[w, w], gram[w, x]
    upper = [ww.real, -ww.imag, wx.real]
    middle = [ww.imag, ww.real, wx.imag]
    lower = [wx.real.T, wx.imag.T, gram[x, x].real]
    gradient = -np.concatenate([right[w].real, right[w].imag, right[x].real])
    return np.block([upper, middle, lower]), gradient


def _add_penalty(measure: Measure, level: float, hessian: Real, gradient: Real) -> None:
    total = measure.vector().size
    start = 0
    for penalty, (_, _, weight) in zip(penalties(measure, level), measure.each(), strict=True):
        norm = float(np.linalg.norm(weight))
        direction = np.concatenate([weight.real, weight.imag]) / norm
        inside = np.arange(start, start + weight.size)
        both = np.concatenate([inside, total + inside])
        gradient[both] += penalty * direction
        hessian[np.ix_(both, both)] += penalty / norm * (np.eye(len(both)) - np.outer(direction, direction))
        start += weight.size


def _moved(measure: Measure, step: Real) -> Measure:
    trial = measure.copy()
    vector = measure.vector()
    size = vector.size
    trial.set_vector(vector + step[:size] + 1j * step[size : 2 * size])
    trial.move(step[2 * size :])
    return trial
