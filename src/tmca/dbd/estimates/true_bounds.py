"""Cramér–Rao bounds of a simulated problem, at its true parameters."""

from __future__ import annotations

from collections.abc import Sequence

from tmca.dbd.arrays import Real
from tmca.dbd.atoms.atoms import Atoms
from tmca.dbd.estimates.channels import Channel
from tmca.dbd.estimates.structured import bounds
from tmca.dbd.problem import Problem
from tmca.errors import SettingError


def true_bounds(problem: Problem, references: Sequence[int | None] | None = None) -> list[Real]:
    """Standard deviations ``(n, D)`` of all coordinates, per source.

    Args:
        problem: with truth and noise.
        references: per source, the path that Dopplers of ``block`` messages count from; by default the strongest.

    Raises:
        SettingError: a problem without truth or without noise.
    """
    if problem.truth is None or not problem.sigma:
        raise SettingError("problem", "no truth or no noise", "a simulated problem with snr_db")
    channels = []
    for source, truth in zip(problem.sources, problem.truth, strict=True):
        atoms = Atoms(source, problem.shape, every_axis=True)
        points = truth.points[:, [2 - axis for axis in atoms.lattice_axes]]
        channels.append(Channel(atoms, points, truth.amplitudes, truth.waveform))
    return bounds(channels, problem.sigma, references)
