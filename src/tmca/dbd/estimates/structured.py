"""Least squares of channels with one waveform each, and what the samples can tell about them at best."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tmca.dbd.arrays import Complex, Real
from tmca.dbd.descent import levenberg_marquardt
from tmca.dbd.estimates.channels import Channel


def jacobian(channels: list[Channel]) -> tuple[Real, int]:
    """Real derivatives ``(2 A P M, parameters)`` of the samples, and how many of the first columns are positions.

    Parameters: all positions, then real and imaginary parts of all gains and waveforms.
    """
    positions = [one.atoms.slopes(one.points, one.amplitudes[:, None] * one.waveform) for one in channels]
    linear = []
    for one in channels:
        response = np.tensordot(one.amplitudes, one.atoms.phases(one.points), axes=1)
        linear += [one.columns(), one.atoms.through(response)]
    moves, values = np.hstack(positions), np.hstack(linear)
    both = np.hstack([moves, values, 1j * values])
    return np.vstack([both.real, both.imag]), moves.shape[1]


def residual(channels: list[Channel], y: Complex) -> Complex:
    """What the channels leave of the samples."""
    left = y.reshape(-1).copy()
    for one in channels:
        left -= one.signal()
    return left


def fit(channels: list[Channel], y: Complex, steps: int = 30) -> list[Channel]:
    """Levenberg–Marquardt from the channels given; gauge directions are left where they are."""
    if not any(len(one.points) for one in channels):
        return channels

    def value(trial: list[Channel]) -> float:
        return 0.5 * float(np.linalg.norm(residual(trial, y)) ** 2)

    def system(trial: list[Channel]) -> tuple[Real, Real]:
        slopes, _ = jacobian(trial)
        left = residual(trial, y)
        return slopes.T @ slopes, -slopes.T @ np.concatenate([left.real, left.imag])

    found = levenberg_marquardt(channels, value, system, _moved, steps)
    return [one.normalised() for one in found]


def _moved(channels: list[Channel], step: Real) -> list[Channel]:
    positions = sum(one.points.size for one in channels)
    values = (step.size - positions) // 2
    complex_step = step[positions : positions + values] + 1j * step[positions + values :]
    moved, place, value = [], 0, 0
    for one in channels:
        count, size = one.points.size, len(one.points)
        points = one.points + step[place : place + count].reshape(one.points.shape)
        gains = one.amplitudes + complex_step[value : value + size]
        waveform = one.waveform + complex_step[value + size : value + size + one.waveform.size]
        moved.append(Channel(one.atoms, points, gains, waveform))
        place, value = place + count, value + size + one.waveform.size
    return moved


def bounds(channels: list[Channel], sigma: float, references: Sequence[int | None] | None = None) -> list[Real]:
    """Cramér–Rao bounds of the positions: standard deviations ``(n, D)`` per source.

    Gains and waveforms are nuisance, up to their common factor. Dopplers of ``block`` messages are bounded relative to
    one path's, whose own is zero. Coordinates that no samples of this kind can tell have no bound: infinite.

    Args:
        channels: the truth, or an estimate in its place.
        sigma: standard deviation of the complex noise.
        references: per source, the path that relative Dopplers count from; by default the strongest.
    """
    slopes, positions = jacobian(channels)
    sizes = np.linalg.norm(slopes, axis=0)
    sizes[sizes == 0] = 1
    slopes = slopes / sizes  # no rank depends on anybody's units
    fixed = _reference_columns(channels, references or [None] * len(channels))
    kept = [column for column in range(positions) if column not in fixed]
    fisher = 2 / sigma**2 * slopes.T @ slopes
    nuisance = slice(positions, None)
    cross = fisher[np.ix_(kept, range(positions, len(fisher)))]
    schur = fisher[np.ix_(kept, kept)] - cross @ np.linalg.pinv(fisher[nuisance, nuisance], rcond=1e-9) @ cross.T
    deviations = np.zeros(positions)
    deviations[kept] = _deviations(schur, least=1e-11 * 2 / sigma**2) / sizes[kept]
    found: list[Real] = []
    place = 0
    for one in channels:
        found.append(deviations[place : place + one.points.size].reshape(one.points.shape))
        place += one.points.size
    return found


def _deviations(information: Real, least: float) -> Real:
    """Square roots of the diagonal of the inverse; infinite along directions with ``least`` information or less."""
    values, vectors = np.linalg.eigh(information)
    known = values > least
    variances = (vectors[:, known] ** 2 / values[known]).sum(axis=1)
    variances[(vectors[:, ~known] ** 2).sum(axis=1) > 1e-8] = np.inf
    return np.sqrt(variances)


def _reference_columns(channels: list[Channel], references: Sequence[int | None]) -> set[int]:
    """Columns of Dopplers that serve as references."""
    columns, place = set(), 0
    for one, given in zip(channels, references, strict=True):
        if one.relative_axis is not None and len(one.points):
            path = one.strongest if given is None else given
            columns.add(place + path * one.points.shape[1] + one.relative_axis)
        place += one.points.size
    return columns
