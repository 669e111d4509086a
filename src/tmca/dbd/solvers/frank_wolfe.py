"""Sliding Frank–Wolfe over several families of lifted atoms, with continuation in the regularisation.

Denoyelle, Duval, Peyré and Soubies, "The sliding Frank–Wolfe algorithm and its application to super-resolution
microscopy", 2019, extended to complex group atoms of several sources and several insertions a round.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tmca.dbd.atoms.measure import Measure
from tmca.dbd.atoms.polynomial import Polynomial
from tmca.dbd.solvers.group_lasso import group_lasso
from tmca.dbd.solvers.slide import objective, slide

LEVELS = (0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3)
"""Shares of the largest useful regularisation that a noiseless solution goes through."""
_TOLERANCE = 1e-3
_SMALL = 200
"""Unknowns that a descent may pass through, at most five for every sample."""
_INSERTIONS = 8
"""Most atoms that one source may gain in a round."""


def largest_level(measure: Measure) -> float:
    """The regularisation above which the empty measure is optimal: the highest ``‖f‖ / weight`` of the samples."""
    highest = [
        np.sqrt(Polynomial(atoms, measure.y).norms_on_grid().max()) / atoms.source.weight for atoms in measure.atoms
    ]
    return float(max(highest))


def crowded(measure: Measure) -> bool:
    """Whether the measure has about as many unknowns as there are samples: these samples are not sparse."""
    return measure.unknowns > max(2 * measure.y.size, min(_SMALL, 5 * measure.y.size))


def descend(measure: Measure, level: float, rounds: int = 12, weak: float = 1e-6) -> int:
    """Solves the group BLASSO at one regularisation from where the measure is, in place.

    Args:
        measure: the atoms so far.
        level: of regularisation.
        rounds: most insertions.
        weak: atoms weaker than this share of the whole are dropped.

    Returns:
        Rounds used.
    """
    if sum(measure.counts):
        slide(measure, level, 10)
    for round_ in range(rounds):
        if crowded(measure):
            return round_
        if not _inserted(measure, level):
            slide(measure, level, 10)
            return round_
        group_lasso(measure, level)
        _drop(measure, 1e-9)
        slide(measure, level, 12)
        measure.merge(0.02)
        _merge_clusters(measure, level)
        _drop(measure, weak)
    return rounds


def _inserted(measure: Measure, level: float) -> int:
    """Adds atoms where the dual polynomials exceed their bound; how many."""
    dual = measure.residual() / level
    added = 0
    for index, atoms in enumerate(measure.atoms):
        bound = atoms.source.weight * (1 + _TOLERANCE)
        points, _ = Polynomial(atoms, dual).peaks(bound, most=_INSERTIONS)
        added += measure.add(index, points)
    return added


def _merge_clusters(measure: Measure, level: float) -> None:
    """Merges atoms within half a resolution cell where the convex objective agrees."""
    trial = measure.copy()
    if not trial.merge(0.5):
        return
    slide(trial, level, 15)
    if objective(trial, level) <= objective(measure, level) * (1 + 1e-9):
        measure.points, measure.weights = trial.points, trial.weights


def _drop(measure: Measure, share: float) -> None:
    limit = share * np.linalg.norm(np.concatenate(measure.strengths()))
    measure.keep(lambda strengths: strengths > limit)


def path(measure: Measure, levels: Sequence[float] = LEVELS):  # type: ignore[no-untyped-def]
    """Goes down the regularisation, in place; yields the level after each descent."""
    top = largest_level(measure)
    for share in levels:
        descend(measure, share * top)
        yield share * top
