"""Weights of fixed atoms under the sum of atomic norms: a group lasso, solved group by group exactly."""

from __future__ import annotations

import numpy as np

from tmca.dbd.arrays import Complex, Real
from tmca.dbd.atoms.measure import Measure


def penalties(measure: Measure, level: float) -> Real:
    """The penalty of each atom: ``level`` times the weight of its source."""
    return np.array([level * atoms.source.weight for atoms, _, _ in measure.each()])


def group_lasso(measure: Measure, level: float, sweeps: int = 60, tolerance: float = 1e-9) -> None:
    """Minimises ``½‖y − A w‖² + Σ level·weight ‖wᵢ‖`` over the weights of the measure, in place.

    Block coordinate descent; each block is solved through its eigenvalues (a scalar secular equation).
    """
    matrix = measure.matrix()
    if not matrix.shape[1]:
        return
    gram = matrix.conj().T @ matrix
    weights = measure.vector()
    left = matrix.conj().T @ measure.y - gram @ weights
    sizes = [atoms.size for atoms, _, _ in measure.each()]
    ends = np.cumsum(sizes)
    blocks = [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)]
    systems = [np.linalg.eigh(gram[block, block]) for block in blocks]
    for _ in range(sweeps):
        largest = 0.0
        for block, (values, vectors), penalty in zip(blocks, systems, penalties(measure, level), strict=True):
            old = weights[block]
            target = left[block] + gram[block, block] @ old
            new = _block(values, vectors, target, penalty, float(np.linalg.norm(old)))
            step = new - old
            left -= gram[:, block] @ step
            weights[block] = new
            largest = max(largest, float(np.linalg.norm(step)))
        if largest <= tolerance * float(np.linalg.norm(weights)):
            break
    measure.set_vector(weights)


def _block(values: Real, vectors: Complex, target: Complex, penalty: float, start: float) -> Complex:
    """The minimiser of ``½wᴴGw − Re wᴴc + penalty ‖w‖`` with ``G`` by its eigenvalues and vectors."""
    size = float(np.linalg.norm(target))
    if size <= penalty:
        return np.zeros_like(target)
    along = vectors.conj().T @ target
    power = np.abs(along) ** 2
    norm = max(start, (size - penalty) / values[-1])
    for _ in range(50):
        scale = values * norm + penalty
        total = float(np.sum(power / scale**2))
        slope = -2 * float(np.sum(power * values / scale**3))
        change = (total**-0.5 - 1) / (-0.5 * total**-1.5 * slope)  # Newton on a nearly straight function
        updated = norm - change if norm > change else norm / 10
        done = abs(updated - norm) < 1e-13 * norm
        norm = updated
        if done:
            break
    return vectors @ (along / (values + penalty / norm))
