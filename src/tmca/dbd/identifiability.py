"""What samples cannot tell, said before anything is solved."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from scipy.linalg import subspace_angles

from tmca.dbd.arrays import Complex
from tmca.dbd.problem import Problem
from tmca.dbd.source import Source


class BeyondFreedom(UserWarning):
    """More lifted unknowns than samples."""


class SameSignals(UserWarning):
    """Whatever one source sends, another can send too."""


def lifted_unknowns(problem: Problem, paths: Sequence[int]) -> int:
    """Complex unknowns of the lifted problem: paths times coefficients, summed over the sources.

    For a radar and ``block`` messages L J + Q J P (dbd erratum S2: with the Doppler absorbed, every path needs its
    own J P coefficients; the sample bound of thesis equation 87 misses the factor P).
    """
    return sum(count * source.unknowns for count, source in zip(paths, problem.sources, strict=True))


def beyond_freedom(problem: Problem, paths: Sequence[int]) -> str | None:
    """Why no convex method can succeed with so many paths, or None."""
    unknowns, samples = lifted_unknowns(problem, paths), problem.y.size
    if unknowns <= samples:
        return None
    parts = " + ".join(f"{n} x {one.unknowns}" for n, one in zip(paths, problem.sources, strict=True))
    return (
        f"{parts} = {unknowns} lifted unknowns exceed {samples} samples: convex methods cannot succeed; "
        "take more frequencies, fewer coefficients or messages that pulses share"
    )


def same_signals(problem: Problem) -> tuple[str, ...]:
    """Pairs of sources one of which can send all that the other can, a sentence each."""
    found = []
    for one, other in combinations(problem.sources, 2):
        if float(subspace_angles(_subspace(one), _subspace(other)).max()) < 1e-7:
            found.append(f"{one.name} and {other.name} can send the same signals: any path may be of either")
    return tuple(found)


def _subspace(source: Source) -> Complex:
    """All signals a source can send, as columns ``(P M, G J)``."""
    pulses, frequencies, size = source.rows.shape
    columns = np.zeros((pulses, frequencies, source.messages, size), complex)
    columns[np.arange(pulses), :, source.message] = source.rows
    return columns.reshape(pulses * frequencies, -1)


def ambiguities(problem: Problem) -> tuple[str, ...]:
    """What is undetermined in principle, a sentence each."""
    found = ["the scale and phase of each waveform trade against its gains"]
    for source in problem.sources:
        if not source.sees_doppler and problem.shape[1] > 1:
            found.append(
                f"{source.name}: messages of their own in every pulse absorb the absolute Doppler; "
                "Dopplers are relative to each other, and waveforms known up to a phase ramp over the pulses"
            )
    found += same_signals(problem)
    found.append(
        "an unknown lag of a source's clock adds to all its delays, an unknown frequency offset to its Dopplers"
    )
    return tuple(found)
