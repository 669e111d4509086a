"""What the samples of a problem cannot tell of their sources, and what is warned of."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from tmca.dbd.model import Problem, is_radar

_NEAR_RADAR = 0.75
"""How like ``radar`` a name is that may be a misspelt one; ``radio`` is less."""


class BeyondFreedom(UserWarning):
    """More lifted unknowns than samples."""


class SameSignals(UserWarning):
    """Whatever one source sends, another can send too."""


class LittleExplained(UserWarning):
    """Paths that leave most of the samples unexplained."""


class OneWay(UserWarning):
    """A source whose name is nearly that of a radar is taken one way."""


def taken_one_way(problem: Problem) -> list[str]:
    """The sources whose names may be a misspelt ``radar``, whose delays then are not there and back."""
    from difflib import get_close_matches

    return [
        f"{one.name} is taken one way, as a path of a transmitter; did you mean radar?"
        for one in problem.sources
        if not is_radar(one.name) and get_close_matches(one.name.lower(), ["radar"], 1, _NEAR_RADAR)
    ]


def beyond_freedom(problem: Problem, paths: Sequence[int]) -> str | None:
    """Why no convex method can succeed with so many paths, or None.

    The lifted problem has L J + Q J P complex unknowns for a radar and ``block`` messages (with the Doppler absorbed,
    every path needs its own J P coefficients; the sample bound of thesis equation 87 misses the factor P).
    """
    unknowns = sum(count * source.unknowns for count, source in zip(paths, problem.sources, strict=True))
    samples = problem.y.size
    if unknowns <= samples:
        return None
    parts = " + ".join(f"{n} x {one.unknowns}" for n, one in zip(paths, problem.sources, strict=True))
    return (
        f"{parts} = {unknowns} lifted unknowns exceed {samples} samples: convex methods cannot succeed; "
        "take more frequencies, fewer coefficients or messages that pulses share"
    )


def same_signals(problem: Problem) -> tuple[str, ...]:
    """Pairs of sources one of which can send all that the other can, a sentence each."""
    from scipy.linalg import subspace_angles

    spaces = {  # all signals a source can send, as columns (P M, G J)
        one.name: one.signal(np.eye(one.unknowns, dtype=complex)).reshape(one.unknowns, -1).T for one in problem.sources
    }
    return tuple(
        f"{one} and {other} can send the same signals: any path may be of either"
        for one, other in combinations(spaces, 2)
        if float(subspace_angles(spaces[one], spaces[other]).max()) < 1e-7
    )


def ambiguities(problem: Problem) -> tuple[str, ...]:
    """What is undetermined in principle, a sentence each."""
    absorbed = (
        f"{source.name}: messages of their own in every pulse absorb the absolute Doppler; "
        "Dopplers are relative to each other, and waveforms known up to a phase ramp over the pulses"
        for source in problem.sources
        if not source.sees_doppler and problem.shape[1] > 1
    )
    return (
        "the scale and phase of each waveform trade against its gains",
        *absorbed,
        *same_signals(problem),
        "an unknown lag of a source's clock adds to all its delays, an unknown frequency offset to its Dopplers",
    )
