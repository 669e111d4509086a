"""The linear matrix inequality of one source: its Gram matrix and the coefficients of its dual polynomial.

``‖f‖ ≤ weight`` everywhere holds if ``[[K, Hᴴ], [H, weight² I]] ⪰ 0`` with the traces of a unit polynomial in K (thesis
equations 79 to 81; every source has a Gram matrix of its own, and block messages a lossless one in the delay alone).
"""

from __future__ import annotations

import numpy as np

from tmca.dbd.arrays import Complex, Real, Whole
from tmca.dbd.problem import Problem
from tmca.dbd.source import Source


class Gram:
    """Index arithmetic of one source's inequality.

    Args:
        source: the transmitter.
        shape: antennas, pulses, frequencies.
    """

    def __init__(self, source: Source, shape: tuple[int, int, int]) -> None:
        antennas, pulses, frequencies = shape
        a, p, n = np.meshgrid(np.arange(antennas), np.arange(pulses), np.arange(frequencies), indexing="ij")
        self.lattice = shape if source.sees_doppler else (antennas, 1, frequencies)
        self.size = int(np.prod(self.lattice))
        self.unknowns, self.bound = source.unknowns, source.weight
        pulse = p if source.sees_doppler else np.zeros_like(p)
        self.columns = ((a * self.lattice[1] + pulse) * frequencies + n).reshape(-1, 1)
        first = (source.message[p] * source.subspace).reshape(-1, 1)
        self.rows = first + np.arange(source.subspace)
        self.values = np.conj(source.rows[p, n]).reshape(-1, source.subspace)
        self.lags = lag_numbers(self.lattice)
        self.lag_sizes = np.bincount(self.lags.reshape(-1)).astype(float)

    @property
    def order(self) -> int:
        """Rows of the whole inequality."""
        return self.size + self.unknowns

    def coefficients(self, q: Complex) -> Complex:
        """H, ``(G J, lattice)``, for a dual variable ``(A P M,)``."""
        matrix = np.zeros((self.unknowns, self.size), complex)
        matrix[self.rows, self.columns] = self.values * q[:, None]
        return matrix

    def adjoint(self, matrix: Complex) -> Complex:
        """Of :meth:`coefficients`: ``(A P M,)``."""
        return np.sum(np.conj(self.values) * matrix[self.rows, self.columns], axis=1)

    def power(self) -> Real:
        """The diagonal of ``adjoint(coefficients)``."""
        return np.sum(np.abs(self.values) ** 2, axis=1)

    def unit_traces(self, matrix: Complex) -> Complex:
        """The nearest matrix whose diagonals sum to zero, but the main one to one (thesis equation 80)."""
        flat, numbers = matrix.reshape(-1), self.lags.reshape(-1)
        count = len(self.lag_sizes)
        sums = np.bincount(numbers, flat.real, count) + 1j * np.bincount(numbers, flat.imag, count)
        sums[self.lags[0, 0]] -= 1
        return matrix - (sums / self.lag_sizes)[self.lags]


def lag_numbers(lattice: tuple[int, int, int]) -> Whole:
    """``(N, N)``: the number of the lag between two samples, the same for the same difference in every axis."""
    places = np.stack(np.unravel_index(np.arange(int(np.prod(lattice))), lattice))
    numbers = np.zeros((places.shape[1],) * 2, np.int64)
    for place, extent in zip(places, lattice, strict=True):
        numbers = numbers * (2 * extent - 1) + (place[None, :] - place[:, None] + extent - 1)
    return numbers


def grams(problem: Problem) -> list[Gram]:
    """One per source."""
    return [Gram(source, problem.shape) for source in problem.sources]
