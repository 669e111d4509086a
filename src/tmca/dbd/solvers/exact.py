"""From the atoms of a regularised solution to an exact fit of noiseless samples, with as few atoms as explain them."""

from __future__ import annotations

import numpy as np

from tmca.dbd.atoms.measure import Measure
from tmca.dbd.solvers.slide import slide

EXACT = 1e-9
"""Relative residual from which samples count as explained exactly."""
_SHARES = (0.1, 0.2, 0.02, 1e-3)
"""Of the strongest atom: what is weaker is left out on trial. The last are for paths 20 to 60 dB below others."""
_CELLS = 0.6
_STEPS = 25
_MISSED = 0.1
"""Relative residual without an atom above which the others cannot take over its signal."""


def refined(measure: Measure, share: float) -> Measure | None:
    """The atoms above ``share`` of the strongest, clusters joined, fitted without regularisation; None if too many."""
    trial = _strong(measure, share)
    return _fitted(trial) if trial is not None else None


def _strong(measure: Measure, share: float) -> Measure | None:
    trial = measure.copy()
    trial.merge(_CELLS)
    strongest = max((one.max(initial=0.0) for one in trial.strengths()), default=0.0)
    trial.keep(lambda strengths: strengths > share * strongest)
    return trial if sum(trial.counts) and trial.unknowns < 2 * trial.y.size else None


def _fitted(trial: Measure) -> Measure:
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
    each = enumerate(measure.strengths())
    for _, source, atom in sorted((value, source, atom) for source, one in each for atom, value in enumerate(one)):
        trial = measure.without(source, atom)
        trial.fit_weights()
        if trial.relative_residual() < _MISSED:
            slide(trial, 0.0, _STEPS)
        if trial.relative_residual() < EXACT:
            return trial
    return None


def exact_fit(measure: Measure, least: float = 0.0) -> tuple[float, Measure | None]:
    """The best of several thresholds: its relative residual and its atoms.

    Args:
        measure: a regularised solution.
        least: share of the strongest atom below which the regularisation has left none that counts.
    """
    best: tuple[float, Measure | None] = (np.inf, None)
    seen: set[tuple[int, ...]] = set()
    for share in (one for one in _SHARES if one >= least):
        trial = _strong(measure, share)
        if trial is None or trial.counts in seen:
            continue
        seen.add(trial.counts)
        trial = _fitted(trial)
        if trial.relative_residual() < best[0]:
            best = (trial.relative_residual(), trial)
        if best[0] < EXACT:
            break
    return best
