"""Levenberg–Marquardt steps on anything that has a value, a system and a way to move."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from tmca.dbd.arrays import Real

State = TypeVar("State")
_TRIALS = 8


def levenberg_marquardt(
    state: State,
    value: Callable[[State], float],
    system: Callable[[State], tuple[Real, Real]],
    moved: Callable[[State, Real], State],
    steps: int,
) -> State:
    """The state after at most ``steps`` steps downhill.

    Args:
        state: where to start; it is not changed.
        value: to be lowered.
        system: curvature ``(n, n)`` and gradient ``(n,)`` at a state, in anybody's units.
        moved: the state after a step ``(n,)``.
        steps: at most; the descent ends where none lowers the value.
    """
    level, damping = value(state), 1e-6
    for _ in range(steps):
        hessian, gradient = system(state)
        better = None
        for _ in range(_TRIALS):
            better = _lower(state, level, _step(hessian, gradient, damping), value, moved)
            if better is not None:
                break
            damping = max(damping * 20, 1e-6)
        if better is None:
            break
        gain, (state, level) = level - better[1], better
        damping = max(damping / 5, 1e-12)
        if gain < 1e-13 * level:
            break
    return state


def _lower(
    state: State, level: float, step: Real | None, value: Callable[[State], float],
    moved: Callable[[State, Real], State],
) -> tuple[State, float] | None:  # fmt: skip
    if step is None:
        return None
    trial = moved(state, step)
    reached = value(trial)
    return (trial, reached) if reached < level else None


def _step(hessian: Real, gradient: Real, damping: float) -> Real | None:
    """One damped step; none where the system has no solution."""
    diagonal = np.diag(hessian)
    damped = hessian + np.diag((damping + 1e-14) * diagonal + (diagonal == 0))
    try:
        return -np.linalg.solve(damped, gradient)
    except np.linalg.LinAlgError:
        return None
