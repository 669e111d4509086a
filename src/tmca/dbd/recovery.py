"""What a solver recovered, how sure that is, and how near to the truth, up to what no receiver can know."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from tmca.dbd.certificate import Certificate
from tmca.dbd.channel import Channel
from tmca.dbd.model import AXES, Complex, Problem, Real, Source, Truth, Units, centred, distance, matched
from tmca.dbd.paths import path_dataset, path_frame
from tmca.errors import SettingError
from tmca.summaries import Summary, as_numpy, sizes

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class Recovery(Summary):
    """The answer to a problem.

    Args:
        problem: that was solved.
        method: that solved it.
        sources: the channel and signal of each.
        residual: relative norm of what the channels leave unexplained.
        exact: noiseless samples are explained to 1e-9 with fewer unknowns than samples.
        certificate: whether the lifted solution is the atomic-norm optimum; None where it was not asked for.
        sigma: standard deviation of the noise, given or estimated; 0 where an exact fit leaves none.
        q: ``(A, P, M)``, a dual variable whose polynomials show the paths.
        seconds: all steps took.
        notes: what cannot be known, and what was doubtful.
        doubt: why the paths do not explain the samples, in one sentence, or None: more than the noise and half of all
            other energy is left, or far more than a stated noise, nearly as many unknowns as samples were needed, or
            many close paths that cancel, or another pulse, or another sign or order of the bases, explains the samples
            better.
    """

    problem: Problem = field(repr=False)
    method: str
    sources: tuple[Channel, ...]
    residual: float
    exact: bool
    certificate: Certificate | None
    sigma: float | None
    q: Complex = field(repr=False)
    seconds: float
    notes: tuple[str, ...] = ()
    doubt: str | None = None
    _uncut: ClassVar[tuple[str, ...]] = ("doubt",)

    @property
    def found(self) -> bool:
        """Whether there is any path, and all together explain the samples: without :attr:`doubt`."""
        return any(len(source) for source in self.sources) and self.doubt is None

    @property
    def unexplained(self) -> float:
        """Share of the samples' energy that the paths do not explain, 0 to 1, noise included."""
        return self.residual**2

    @property
    def certified(self) -> bool | None:
        """Whether the recovery is proven to be the optimum; None where that is undecided."""
        return None if self.certificate is None else self.certificate.certified

    @property
    def certificate_status(self) -> str:
        """In words; ``not looked for`` where there is none."""
        return "not looked for" if self.certificate is None else self.certificate.status

    def __getitem__(self, name: str) -> Channel:
        return {source.name: source for source in self.sources}[name]

    def __iter__(self) -> Iterator[Channel]:
        return iter(self.sources)

    def score(self, problem: Problem | None = None, tolerance: float | None = None) -> Score:
        """How near the truth of ``problem`` (this one's by default) the recovery is; see :func:`score`."""
        return score(self.sources, problem or self.problem, tolerance)

    def to_pandas(self) -> pd.DataFrame:
        """A row for every target and path, by name: delay, Doppler, gain, power and standard deviations (``…_std``,
        Cramér–Rao bounds); in seconds and hertz, metres and metres a second where the problem has units.
        """
        return path_frame(self)

    def to_xarray(self) -> xr.Dataset:
        """The same along one dimension ``path``, with units, and the share that stays unexplained as an attribute."""
        return path_dataset(self)

    @property
    def dopplers_hz(self) -> dict[str, Real]:
        """Per source the Dopplers in hertz, ``−½`` to ``½`` of the pulse repetition frequency; needs units."""
        return {one.name: centred(one.points[:, 1]) * self._units().doppler_hz for one in self.sources}

    @property
    def delays_s(self) -> dict[str, Real]:
        """Per source the delays in seconds; needs units."""
        return {one.name: one.points[:, 0] * self._units().delay_s for one in self.sources}

    def plot(self) -> Figure:
        """Norms of the dual polynomials over delay and Doppler, with the recovered paths, and the true where known."""
        from tmca.dbd.planes import planes
        from tmca.plots.dbd import Plane, planes_figure

        line = f"in doubt: {self.doubt}" if self.doubt else ""
        return planes_figure([Plane(**plane) for plane in planes(self)], line)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray[Any, Any]:
        """(n, 3) delay, Doppler and angle of all paths, source after source."""
        return as_numpy(np.concatenate([one.points for one in self.sources]), dtype, copy)

    def _facts(self) -> dict[str, str]:
        counts = (f"{one.name} {len(one)} path{'s'[: len(one) != 1]}" for one in self.sources)
        return {
            "found": "no" * (not self.found),
            "doubt": self.doubt or "",
            "problem": f"{sizes(self.problem.shape)} (antennas, pulses, frequencies)",
            "paths": ", ".join(counts),
            "unexplained": "nothing: an exact fit" if self.exact else f"{self.unexplained:.2g} of the energy",
            "certificate": self.certificate_status,
            "noise": "not known" if self.sigma is None else f"{self.sigma:.3g}" if self.sigma else "none",
            "method": f"{self.method}, {self.seconds:.2g} s",
            "notes": "; ".join(self.notes),
        }

    def _picture(self) -> Figure:
        from tmca.dbd.planes import planes
        from tmca.plots.dbd import Plane, small_planes_figure

        return small_planes_figure([Plane(**plane) for plane in planes(self)])

    def _units(self) -> Units:
        if self.problem.units is None:
            raise SettingError("units", "none", "a problem with physical units", "give Problem(…, units=Units(…))")
        return self.problem.units


@dataclass(frozen=True)
class SourceScore:
    """One source against its truth.

    Args:
        name: of the source.
        right_number: as many paths as there are.
        errors: by axis, torus distance of each matched path; Dopplers of ``block`` messages count from the strongest's.
        waveform_correlation: 0 to 1, up to scale and, for ``block`` messages, a phase ramp.
        reference: the true path that Dopplers of ``block`` messages count from, that of the strongest one; or None.
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


def score(recovery: Recovery | Sequence[Channel], problem: Problem, tolerance: float | None = None) -> Score:
    """Matches the paths of every source by the Hungarian method and measures what is left, on the torus.

    Args:
        recovery: or its channels, one of every source.
        problem: with the truth.
        tolerance: largest error of a success; without, 1e-6 for samples without noise, half of the finest resolution
            cell with noise.

    Raises:
        SettingError: a problem without truth, or with other sources.
    """
    channels = list(recovery)
    if tolerance is None:
        tolerance = 1e-6 if problem.sigma == 0 else 0.5 / max(problem.shape)
    if [one.name for one in channels] != [one.name for one in problem.sources]:
        names = ", ".join(one.name for one in problem.sources)
        raise SettingError("problem", f"sources {names}", ", ".join(one.name for one in channels))
    if problem.truth is None:
        raise SettingError("problem", "no truth", "a simulated problem", "simulate one, or give Problem(…, truth=…)")
    triples = zip(channels, problem.sources, problem.truth, strict=True)
    return Score(tuple(_source_score(*triple) for triple in triples), tolerance)


def _source_score(channel: Channel, source: Source, truth: Truth) -> SourceScore:
    points = channel.points
    if not len(points) or len(points) != len(truth.points):
        right = len(points) == len(truth.points)
        return SourceScore(channel.name, right, {}, float(right), {})
    axes = [index for index in range(len(AXES)) if np.all(np.isfinite(points[:, index]))]
    first = [axis for axis in axes if axis != 1] if channel.relative_doppler else axes
    here, there = matched(points[:, first], truth.points[:, first])
    estimate, true = points[here], truth.points[there]
    shift, reference = 0.0, None
    if channel.relative_doppler:
        strongest = int(np.argmax(np.abs(channel.amplitudes[here])))
        reference, shift = int(there[strongest]), float(true[strongest, 1] - estimate[strongest, 1])
    estimate = estimate + np.array([0.0, shift, 0.0])
    errors = {AXES[axis]: distance(estimate[:, axis], true[:, axis]) for axis in axes}
    limits = channel.bounds
    bounds = {} if limits is None else {AXES[axis]: limits[here, axis] for axis in axes}
    ramp = np.exp(2j * np.pi * shift * np.arange(source.messages))
    turned = (channel.waveform.reshape(source.messages, -1) * ramp[:, None]).reshape(-1)
    correlation = abs(np.vdot(turned, truth.waveform)) / (np.linalg.norm(turned) * np.linalg.norm(truth.waveform))
    return SourceScore(channel.name, True, errors, float(correlation), bounds, reference)
