"""From the atoms of a regularised solution to an exact fit of noiseless samples, with as few atoms as explain them."""

from __future__ import annotations

import numpy as np

from tmca.dbd.atoms.measure import Measure
from tmca.dbd.solvers.slide import slide

EXACT = 1e-9
"""Relative residual from which samples count as explained exactly."""
_CELLS = 0.6
_STEPS = 25


def refined(measure: Measure, share: float) -> Measure | None:
    """The atoms above ``share`` of the strongest, clusters joined, fitted without regularisation; None if too many."""
    trial = measure.copy()
    trial.merge(_CELLS)
    strongest = max((norms.max(initial=0.0) for norms in trial.norms()), default=0.0)
    trial.keep(lambda norms: norms > share * strongest)
    if not sum(trial.counts) or trial.unknowns >= 2 * trial.y.size:
        return None
    _fit(trial)
    if trial.relative_residual() < EXACT:
        trial.merge(1e-2)
        _fit(trial)
        trial = _eliminated(trial)
    return trial


def _fit(measure: Measure) -> None:
    measure.fit_weights()
    slide(measure, 0.0, _STEPS)


def _eliminated(measure: Measure) -> Measure:
    """Drops atoms, the weakest first, as long as the fit stays exact."""
    while sum(measure.counts) > 1:
        fewer = _one_less(measure)
        if fewer is None:
            return measure
        measure = fewer
    return measure


def _one_less(measure: Measure) -> Measure | None:
    norms = measure.norms()
    strongest = max(one.max(initial=0.0) for one in norms)
    order = sorted((norm, source, atom) for source, one in enumerate(norms) for atom, norm in enumerate(one))
    for norm, source, atom in order:
        if norm > _CELLS * strongest:
            return None
        trial = measure.without(source, atom)
        _fit(trial)
        if trial.relative_residual() < EXACT:
            return trial
    return None


def exact_fit(measure: Measure, shares: tuple[float, ...] = (0.1, 0.2)) -> tuple[float, Measure | None]:
    """The best of several thresholds: its relative residual and its atoms."""
    best: tuple[float, Measure | None] = (np.inf, None)
    for share in shares:
        trial = refined(measure, share)
        if trial is not None and trial.relative_residual() < best[0]:
            best = (trial.relative_residual(), trial)
        if best[0] < EXACT:
            break
    return best
