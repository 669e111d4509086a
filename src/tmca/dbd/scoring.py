"""How near a recovery is to the truth, on the torus and up to what no receiver can know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tmca.dbd.arrays import Complex, Real, Whole
from tmca.dbd.problem import Problem, Truth
from tmca.dbd.source import AXES, Source
from tmca.dbd.torus import distance, matched
from tmca.errors import SettingError

if TYPE_CHECKING:
    from tmca.dbd.recovery import RecoveredSource


@dataclass(frozen=True)
class SourceScore:
    """One source against its truth.

    Args:
        name: of the source.
        right_number: as many paths as there are.
        errors: by axis, torus distance of each matched path; Dopplers of ``block`` messages count from the strongest's.
        waveform_correlation: 0 to 1, up to scale and, for ``block`` messages, a phase ramp.
        reference: the true path that Dopplers of ``block`` messages count from, that of the strongest found; or None.
        bounds: by axis, the recovery's Cramér–Rao bounds of the same paths; empty without noise.
    """

    name: str
    right_number: bool
    errors: dict[str, Real]
    waveform_correlation: float
    bounds: dict[str, Real]
    reference: int | None = None

    @property
    def max_error(self) -> float:
        """The largest error of any path in any axis; infinite with a wrong number of paths."""
        if not self.right_number:
            return float("inf")
        return max((float(error.max(initial=0.0)) for error in self.errors.values()), default=0.0)


@dataclass(frozen=True)
class Score:
    """A recovery against the truth.

    Args:
        sources: one score each.
        tolerance: largest error of a success.
    """

    sources: tuple[SourceScore, ...]
    tolerance: float

    @property
    def max_error(self) -> float:
        """The largest of all sources."""
        return max(one.max_error for one in self.sources)

    @property
    def success(self) -> bool:
        """Right numbers of paths, all within the tolerance."""
        return self.max_error < self.tolerance

    def __getitem__(self, name: str) -> SourceScore:
        return {one.name: one for one in self.sources}[name]


def usual_tolerance(problem: Problem) -> float:
    """Largest error of a success: 1e-6 without noise, half of the finest resolution cell with noise."""
    return 1e-6 if problem.sigma == 0 else 0.5 / max(problem.shape)


def score(found: Sequence[RecoveredSource], problem: Problem, tolerance: float | None = None) -> Score:
    """Matches the paths of every source by the Hungarian method and measures what is left.

    Args:
        found: one of every source.
        problem: with the truth.
        tolerance: largest error of a success; :func:`usual_tolerance` without.

    Raises:
        SettingError: a problem without truth, or with other sources.
    """
    tolerance = usual_tolerance(problem) if tolerance is None else tolerance
    if [one.name for one in found] != [one.name for one in problem.sources]:
        names = ", ".join(one.name for one in problem.sources)
        raise SettingError("problem", f"sources {names}", ", ".join(one.name for one in found))
    if problem.truth is None:
        raise SettingError("problem", "no truth", "a simulated problem", "simulate one, or give Problem(…, truth=…)")
    triples = zip(found, problem.sources, problem.truth, strict=True)
    return Score(tuple(_one(*triple) for triple in triples), tolerance)


def _one(found: RecoveredSource, source: Source, truth: Truth) -> SourceScore:
    if len(found.points) != len(truth.points):
        return SourceScore(found.name, False, {}, 0.0, {})
    if not len(found.points):
        return SourceScore(found.name, True, {}, 1.0, {})
    axes = [index for index in range(len(AXES)) if np.all(np.isfinite(found.points[:, index]))]
    first = [axis for axis in axes if axis != 1] if found.relative_doppler else axes
    here, there = matched(found.points[:, first], truth.points[:, first])
    estimate, true = found.points[here], truth.points[there].copy()
    strongest = int(np.argmax(np.abs(found.amplitudes[here])))
    reference = int(there[strongest]) if found.relative_doppler else None
    shift = float(true[strongest, 1] - estimate[strongest, 1]) if found.relative_doppler else 0.0
    estimate = estimate + np.array([0.0, shift, 0.0])
    errors = {AXES[axis]: distance(estimate[:, axis], true[:, axis]) for axis in axes}
    correlation = _correlation(source, found.waveform, truth.waveform, shift)
    return SourceScore(found.name, True, errors, correlation, _bounds(found, axes, here), reference)


def _correlation(source: Source, estimate: Complex, true: Complex, shift: float) -> float:
    ramp = np.exp(2j * np.pi * shift * np.arange(source.messages))
    turned = (estimate.reshape(source.messages, -1) * ramp[:, None]).reshape(-1)
    return float(abs(np.vdot(turned, true)) / (np.linalg.norm(turned) * np.linalg.norm(true)))


def _bounds(found: RecoveredSource, axes: list[int], order: Whole) -> dict[str, Real]:
    return {} if found.bounds is None else {AXES[axis]: found.bounds[order, axis] for axis in axes}
