"""What changes during a run, as functions of the step alone, so that a resumed run goes on exactly."""

from __future__ import annotations

from math import cos, pi


def decoder_rate(step: int, steps: int, peak: float, warmup: float) -> float:
    """Learning rate of the decoder: a linear rise over ``warmup`` of the run, then a cosine to 1 % of the peak."""
    rise = warmup * steps
    if step < rise:
        return peak * (step + 1) / (rise + 1)
    share = (step - rise) / max(steps - rise, 1)
    return peak * (0.01 + 0.99 * 0.5 * (1 + cos(pi * share)))


def code_rate(step: int, steps: int, peak: float, frozen: float) -> float:
    """Learning rate of the codes: constant, then zero in the last ``frozen`` of the run."""
    return 0.0 if step >= (1 - frozen) * steps else peak


def slope(step: int, steps: int, ends: tuple[float, float], frozen: float) -> float:
    """Slope of the surrogate derivative, raised geometrically until the codes are frozen (annealing)."""
    share = min(step / max((1 - frozen) * steps, 1), 1.0)
    return ends[0] * (ends[1] / ends[0]) ** share
