"""Whether a recovery explains its samples, and whether another sign or order of the samples would explain them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tmca.dbd.atoms import Atoms, Polynomial
from tmca.dbd.channel import Channel, relative_residual, unknowns
from tmca.dbd.frank_wolfe import frank_wolfe, rounds_told
from tmca.dbd.model import Complex, Mask, Problem, Source, distance, is_radar
from tmca.dbd.pulses import groups_of_dopplers, has_one_pulse, with_near_pulse, with_other_pulse

_LITTLE, _SIGMAS = 0.5, 5.0
"""Share of the signal's energy that a fit may leave, and standard deviations of the noise's energy above its mean."""
_FAR, _MODEL = 3.0, 0.02
"""Times a stated noise's energy, and share of the samples' energy on top, above which something else is on air."""
_TOO_LITTLE, _BY_CHANCE = 0.7, 1e-6
"""Share of the energy that is left with a right sigma, and chance of less, below which sigma is too large."""
_CANCELLING, _PAIRS, _CELL = 10.0, 12, 1.0
"""Energy of all paths one by one over that of their sum, and paths that have a neighbour within so many resolution
cells, from which paths are no paths: close ones that cancel explain anything.
"""
_CROWDED = 0.6
"""Unknowns for every real sample from which a fit that is not exact says nothing: any basis would fit as well."""
_REMAINS, _NOISELESS, _MANY = 0.03, 0.01, 0.25
"""Unexplained shares, in noise and without, and unknowns for every real sample, from which variants are tried."""
_TRIES, _LOWEST, _LARGE = 3, (0.95, 1.0), 1000
"""Variants that are tried, one in more samples than these; how high their matched filters are at least, in doubt and
without any.
"""
_COARSE = 0.15
"""Noise, as a share of the samples' root mean square, that a trial may leave: it is quick where the basis is wrong."""
_EXPLAINS, _MOST = 0.9, 0.4
"""Share of the signal's energy that a variant has to explain before it is named, and its most unknowns for every real
sample.
"""
_NEAR_PULSE = 8.0
"""What a pulse of another chirp rate has to gain in the information criterion: one unknown and the choice of it."""
_ROUNDING = 1e-18
"""Shares of energy below which numbers are rounding alone."""


class Variant(NamedTuple):
    """Bases that may have been meant."""

    name: str
    question: str
    rows: Callable[[Complex], Complex]


_BOTH = "is the sign of the time axis or the I/Q order swapped?"
_VARIANTS = (
    Variant("the conjugate of the basis", _BOTH, np.conj),
    Variant(
        "the conjugate of the basis at reversed frequencies",
        "is the I/Q order swapped?",
        lambda rows: rows[:, ::-1].conj(),
    ),
    Variant(
        "the basis at reversed frequencies",
        "is the sign of the time axis swapped?",
        lambda rows: rows[:, ::-1],
    ),
)


def noise_share(problem: Problem) -> float:
    """The most that noise of the stated level is of the samples' energy; 0 where the level is unknown."""
    samples, power = problem.y.size, float(np.linalg.norm(problem.y)) ** 2
    return (problem.sigma or 0.0) ** 2 * (samples + _SIGMAS * samples**0.5) / power


def whole_doubt(
    problem: Problem, channels: Sequence[Channel], left: float, exact: bool, report: Callable[..., None] | None = None
) -> str | None:
    """Why paths do not explain the samples, with the bases that would, in one sentence; None where they do.

    Args:
        problem: that was solved.
        channels: what was recovered.
        left: relative residual.
        exact: whether that is an exact fit with fewer unknowns than samples.
        report: of the rounds of solutions with other bases.
    """
    if exact:
        return None
    alone = _doubt(problem, channels, left)
    meant = better_variant(problem, channels, left, alone is not None, report)
    if meant:
        count = sum(map(len, channels))
        return f"{alone or f'{count} paths explain {1 - left**2:.0%}, other bases need fewer'}; {meant}"
    pulse = another_pulse(problem, channels, left)
    if alone is None or pulse is not None:
        return pulse
    quiet = "" if problem.sigma is not None else " or is there little signal (then give sigma)?"
    return (
        f"{alone}: is a source missing?{quiet} are bases, messages and sigma those of y? "
        "is y pulses x frequencies, lowest frequency first?"
    )


def loud_sigma(problem: Problem, channels: Sequence[Channel], left: float) -> str | None:
    """That a stated noise is far more than what the paths leave, which no such noise would: by chi-square; or None."""
    from scipy.stats import chi2

    if not problem.sigma:
        return None
    power = float(np.linalg.norm(problem.y)) ** 2
    free = max(2 * problem.y.size - unknowns(channels), 1)
    left_over = 2 * left**2 * power / problem.sigma**2
    if left_over > _TOO_LITTLE * free or chi2.cdf(left_over, free) > _BY_CHANCE:
        return None
    stated = problem.sigma**2 * problem.y.size / power
    return (
        f"sigma seems too large: noise of {problem.sigma:.3g} is {stated:.1%} of the samples' energy, the paths leave "
        f"{left**2:.1%}, as noise of {problem.sigma * (left_over / free) ** 0.5:.3g} does; "
        "every ± grows with sigma, and weak paths are missed"
    )


def _doubt(problem: Problem, channels: Sequence[Channel], left: float) -> str | None:
    """Why paths do not explain the samples, or None."""
    noise = noise_share(problem)
    if left**2 > noise + _LITTLE * (1 - noise):
        known = "unknown" if problem.sigma is None else f"{noise:.0%} at most"
        return f"the paths leave {left**2:.0%} of the samples' energy (noise: {known})"
    many = unknowns(channels) > _MANY * 2 * problem.y.size
    if problem.sigma and left**2 > (noise if many else _FAR * noise + _MODEL):
        return f"the paths leave {left**2:.1%} of the samples' energy, the noise is {noise:.1%} at most"
    if problem.sigma == 0 and left**2 > _NOISELESS:
        return f"the paths leave {left**2:.0%} of the energy of samples that are said to be without noise"
    if unknowns(channels) > _CROWDED * 2 * problem.y.size:
        count = sum(map(len, channels))
        return (
            f"{count} paths with {unknowns(channels)} unknowns fit {2 * problem.y.size} real samples: any basis would"
        )
    close = sum(int(np.sum(_near_another(one))) for one in channels)
    if close >= _PAIRS and _cancellation(channels) > _CANCELLING:
        return (
            f"{close} of {sum(map(len, channels))} paths lie within a resolution cell of others and cancel each other"
        )
    return None


def _near_another(channel: Channel) -> Mask:
    """``(n,)``, which paths have another one of their source within a resolution cell."""
    apart = distance(channel.positions[:, None], channel.positions[None]) * channel.atoms.counts
    return np.sum(np.max(apart, axis=-1, initial=0.0) < _CELL, axis=1) > 1


def _cancellation(channels: Sequence[Channel]) -> float:
    """Energy of the paths one by one over that of their sum."""
    each = sum(float(np.linalg.norm(one.atoms.signals(one.positions, one.weights)) ** 2) for one in channels)
    together = float(np.linalg.norm(np.sum([one.samples() for one in channels], axis=0)) ** 2)
    return each / max(together, 1e-300)


def another_pulse(problem: Problem, channels: Sequence[Channel], left: float) -> str | None:
    """The source whose pulse seems to be another one: any pulse, with a path for each velocity, explains more; or None.

    By the Bayesian information criterion, so that the unknowns of that pulse have to pay.
    """
    least, poor = _criterion(channels, left**2, problem), left**2 > noise_share(problem)
    for index, one in enumerate(channels):
        if not (len(one) > 1 and has_one_pulse(one)):
            continue
        velocities = groups_of_dopplers(one.points, problem.shape[1]).max() + 1
        if not poor and len(one) == velocities:
            continue
        other = with_other_pulse(problem, channels, index)
        remains = relative_residual(other, problem.y) ** 2
        gain = least - _criterion(other, remains, problem)
        if gain <= 0 and one.atoms.source.subspace == 1 and velocities < len(one):
            other = with_near_pulse(problem, channels, index)
            remains = relative_residual(other, problem.y) ** 2
            gain = least - _criterion(other, remains, problem) - _NEAR_PULSE
        if len(other[index]) > 1 and gain > 0:  # one would do with any row of targets
            word = "targets" if is_radar(one.name) else "paths"
            return (
                f"{len(one)} {word} of {one.name} explain {1 - left**2:.1%} of the samples' energy, "
                f"{len(other[index])} with another pulse explain {1 - remains:.1%}: is the pulse of {one.name} right?"
            )
    return None


def better_variant(
    problem: Problem,
    channels: Sequence[Channel],
    left: float,
    doubtful: bool,
    report: Callable[..., None] | None = None,
) -> str | None:
    """The variant of the bases that explains the samples where these do not, with what may be swapped; or None.

    Nothing is tried where few paths explain the samples. Elsewhere the matched filters say which are tried: those of
    the right bases are seldom lower than those of wrong ones.
    """
    samples, noise = 2 * problem.y.size, noise_share(problem)
    few = unknowns(channels) <= _MANY * samples and left**2 <= noise + _REMAINS
    if few and not doubtful:
        return None
    lowest = _LOWEST[0 if doubtful else 1] * _height(problem, problem.sources)
    heights = sorted(((_height(problem, one.sources), one) for one in _meant(problem)), key=lambda pair: -pair[0])
    coarse = max(problem.sigma or 0.0, _COARSE * float(np.sqrt(np.mean(np.abs(problem.y) ** 2))))
    best: tuple[float, str | None] = (_criterion(channels, left**2, problem), None)
    tell = rounds_told(report, "other bases: ")
    for _, meant in [pair for pair in heights if pair[0] >= lowest][: _TRIES if samples < 2 * _LARGE else 1]:
        other = frank_wolfe(replace(problem, sources=meant.sources, sigma=coarse, truth=None), tell).channels
        remains = relative_residual(other, problem.y) ** 2
        criterion = _criterion(other, remains, problem)
        explains = remains <= noise + (1 - _EXPLAINS) * (1 - noise) and unknowns(other) <= _MOST * samples
        if criterion < best[0] and explains:
            best = criterion, f"{meant.name} explains {1 - remains:.0%}: {meant.question}"
            if unknowns(other) <= _MANY * samples:
                break
    return best[1]


class _Meant(NamedTuple):
    """Sources with a variant of their bases."""

    name: str
    question: str
    sources: tuple[Source, ...]


def _meant(problem: Problem) -> list[_Meant]:
    """What else the bases may have been meant to be: the conjugates of some, or all at reversed frequencies."""
    names, several = [one.name for one in problem.sources], len(problem.sources) > 1
    chosen: list[tuple[str, tuple[str, ...]]] = [(f" of {name}" if several else "", (name,)) for name in names]
    tried = [(_VARIANTS[0], of, which) for of, which in chosen]
    if several:
        tried.append((_VARIANTS[0], " of all sources", tuple(names)))
    if problem.shape[2] % 2:  # the lowest of an even number of frequencies has no counterpart
        tried += [(one, " of all sources" if several else "", tuple(names)) for one in _VARIANTS[1:]]
    meant = []
    for variant, of, which in tried:
        rows = [variant.rows(one.rows) if one.name in which else one.rows for one in problem.sources]
        if any(not np.allclose(new, one.rows) for new, one in zip(rows, problem.sources, strict=True)):
            pairs = zip(rows, problem.sources, strict=True)
            changed = tuple(replace(one, rows=new) for new, one in pairs)
            meant.append(_Meant(variant.name.replace("the basis", f"the basis{of}"), variant.question, changed))
    return meant


def _height(problem: Problem, sources: Sequence[Source]) -> float:
    """The sum over the sources of the highest level of a matched filter of unknown waveform."""
    atoms = (Atoms(one, problem.shape) for one in sources)
    return sum(float(Polynomial(one, problem.y).levels_on_grid().max()) for one in atoms)


def _criterion(channels: Sequence[Channel], left: float, problem: Problem) -> float:
    """The Bayesian information criterion in noise of unknown level."""
    samples = 2 * problem.y.size
    return float(samples * np.log(max(left, _ROUNDING)) + unknowns(channels) * np.log(samples))
