"""What a solver found, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass, field

from tmca.dbd.arrays import Complex, Real
from tmca.dbd.physical import centred
from tmca.dbd.problem import Problem
from tmca.dbd.scoring import Score, score
from tmca.dbd.solvers.certificate import Certificate


@dataclass(frozen=True)
class RecoveredSource:
    """Channel and signal of one source.

    Args:
        name: of the source.
        points: ``(n, 3)``, normalised delay, Doppler and angle in [0, 1); NaN for an axis that does not exist.
        amplitudes: ``(n,)``, complex gains, up to one factor.
        waveform: ``(G J,)``, coefficients of the signal, of norm one.
        signal: ``(P, M)``, the spectrum these coefficients make.
        bounds: ``(n, 3)``, Cramér–Rao bounds of the points in the estimated noise; None without noise.
        relative_doppler: Dopplers count from the strongest path.
    """

    name: str
    points: Real
    amplitudes: Complex = field(repr=False)
    waveform: Complex = field(repr=False)
    signal: Complex = field(repr=False)
    bounds: Real | None = field(default=None, repr=False)
    relative_doppler: bool = False


@dataclass(frozen=True)
class Recovery:
    """The answer to a problem.

    Args:
        problem: that was solved.
        method: that solved it.
        sources: what was found of each.
        residual: relative norm of what the channels leave unexplained.
        exact: noiseless samples are explained to 1e-9 with fewer unknowns than samples.
        certificate: whether the lifted solution is the atomic-norm optimum; None where it was not asked for.
        sigma: standard deviation of the noise, given or estimated; 0 where an exact fit leaves none.
        q: ``(A, P, M)``, a dual variable whose polynomials show the paths.
        seconds: all steps took.
        notes: what cannot be known, and what was doubtful.
    """

    problem: Problem = field(repr=False)
    method: str
    sources: tuple[RecoveredSource, ...]
    residual: float
    exact: bool
    certificate: Certificate | None
    sigma: float | None
    q: Complex = field(repr=False)
    seconds: float
    notes: tuple[str, ...] = ()

    @property
    def found(self) -> bool:
        """Whether any path was found."""
        return any(len(source.points) for source in self.sources)

    @property
    def certified(self) -> bool | None:
        """Whether the recovery is proven to be the optimum; None where that is undecided."""
        return None if self.certificate is None else self.certificate.certified

    def __getitem__(self, name: str) -> RecoveredSource:
        return {source.name: source for source in self.sources}[name]

    def score(self, problem: Problem | None = None, tolerance: float | None = None) -> Score:
        """How near the truth of ``problem`` (this one's by default) the recovery is; see :func:`scoring.score`."""
        return score(self.sources, problem or self.problem, tolerance)

    @property
    def dopplers_hz(self) -> dict[str, Real]:
        """Per source the Dopplers in hertz, ``−½`` to ``½`` of the pulse repetition frequency; needs units."""
        return {one.name: centred(one.points[:, 1]) * self._units().doppler_hz for one in self.sources}

    @property
    def delays_s(self) -> dict[str, Real]:
        """Per source the delays in seconds; needs units."""
        return {one.name: one.points[:, 0] * self._units().delay_s for one in self.sources}

    def _units(self):  # type: ignore[no-untyped-def]
        from tmca.errors import SettingError

        if self.problem.units is None:
            raise SettingError("units", "none", "a problem with physical units", "give Problem(…, units=Units(…))")
        return self.problem.units
