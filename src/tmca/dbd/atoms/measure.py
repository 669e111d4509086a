"""Sparse measures: a few weighted atoms of each source that together explain the samples."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from tmca.dbd.arrays import Complex, Mask, Real
from tmca.dbd.atoms.atoms import Atoms
from tmca.dbd.problem import Problem
from tmca.dbd.torus import distance


@dataclass
class Measure:
    """Points and lifted weights of every source.

    Args:
        atoms: per source.
        y: ``(A P M,)``, the samples to explain.
        points: per source ``(n, D)``.
        weights: per source ``(n, G J)``; a weight is amplitude times signal coefficients.
    """

    atoms: tuple[Atoms, ...]
    y: Complex
    points: list[Real]
    weights: list[Complex]

    @classmethod
    def empty(cls, problem: Problem, every_axis: bool = False) -> Measure:
        """No atoms yet."""
        atoms = tuple(Atoms(source, problem.shape, every_axis) for source in problem.sources)
        points: list[Real] = [np.zeros((0, len(one.axes))) for one in atoms]
        weights: list[Complex] = [np.zeros((0, one.size), complex) for one in atoms]
        return cls(atoms, problem.y.reshape(-1), points, weights)

    def copy(self) -> Measure:
        """Another one that can be changed on its own."""
        return Measure(self.atoms, self.y, [one.copy() for one in self.points], [one.copy() for one in self.weights])

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of atoms of every source."""
        return tuple(len(points) for points in self.points)

    @property
    def unknowns(self) -> int:
        """Real unknowns: positions, and twice the complex weights."""
        return sum(n * (2 * one.size + len(one.axes)) for n, one in zip(self.counts, self.atoms, strict=True))

    def each(self) -> Iterator[tuple[Atoms, Real, Complex]]:
        """The atoms one by one: family, point, weight."""
        for atoms, points, weights in self._families():
            for point, weight in zip(points, weights, strict=True):
                yield atoms, point, weight

    def _families(self) -> Iterator[tuple[Atoms, Real, Complex]]:
        return zip(self.atoms, self.points, self.weights, strict=True)

    def matrix(self) -> Complex:
        """``(A P M, K)`` of all atoms side by side."""
        return np.hstack([atoms.matrix(points) for atoms, points, _ in self._families()])

    def slopes(self) -> Complex:
        """``(A P M, D of all atoms)``: how the samples change with the positions."""
        return np.hstack([atoms.slopes(points, weights) for atoms, points, weights in self._families()])

    def vector(self) -> Complex:
        """All weights in one vector ``(K,)``."""
        return np.concatenate([weights.reshape(-1) for weights in self.weights])

    def set_vector(self, vector: Complex) -> None:
        """Takes the weights from one vector."""
        start = 0
        for index, weights in enumerate(self.weights):
            self.weights[index] = vector[start : start + weights.size].reshape(weights.shape)
            start += weights.size

    def move(self, step: Real) -> None:
        """Shifts all positions by one vector of their coordinates."""
        start = 0
        for index, points in enumerate(self.points):
            self.points[index] = (points + step[start : start + points.size].reshape(points.shape)) % 1.0
            start += points.size

    def residual(self) -> Complex:
        """What the atoms leave unexplained, ``(A P M,)``."""
        return self.y - sum(atoms.signals(points, weights).sum(axis=0) for atoms, points, weights in self._families())

    def fit_weights(self) -> None:
        """Least-squares weights at these positions."""
        self.set_vector(np.linalg.lstsq(self.matrix(), self.y, rcond=None)[0])

    def strengths(self) -> list[Real]:
        """Weighted norm of every atom, by source: its share of the sum of atomic norms, whatever the basis' scale."""
        return [
            one.source.weight * np.linalg.norm(weights, axis=1)
            for one, weights in zip(self.atoms, self.weights, strict=True)
        ]

    def relative_residual(self) -> float:
        """Norm of the residual over that of the samples."""
        return float(np.linalg.norm(self.residual())) / max(float(np.linalg.norm(self.y)), 1e-300)

    def add(self, source: int, points: Real) -> int:
        """Atoms of weight zero at points that are none yet; how many were new."""
        counts = self.atoms[source].counts
        fresh = [x for x in points if not np.any(_apart(self.points[source], x, counts) <= 0.02)]
        if fresh:
            self.points[source] = np.vstack([self.points[source], fresh])
            nothing = np.zeros((len(fresh), self.atoms[source].size), complex)
            self.weights[source] = np.vstack([self.weights[source], nothing])
        return len(fresh)

    def keep(self, wanted: Callable[[Real], Mask]) -> None:
        """Keeps the atoms whose strength ``wanted`` says true of."""
        for index, strengths in enumerate(self.strengths()):
            mask = np.asarray(wanted(strengths), bool)
            self.points[index], self.weights[index] = self.points[index][mask], self.weights[index][mask]

    def without(self, source: int, atom: int) -> Measure:
        """A copy less one atom."""
        other = self.copy()
        other.points[source] = np.delete(other.points[source], atom, axis=0)
        other.weights[source] = np.delete(other.weights[source], atom, axis=0)
        return other

    def merge(self, radius: float) -> bool:
        """Replaces atoms within ``radius`` resolution cells of a stronger one by it; says whether there were any.

        The strongest atom takes over the others' signal as far as its subspace can.
        """
        merged = False
        for index, atoms in enumerate(self.atoms):
            points, weights = self.points[index], self.weights[index]
            left = list(np.argsort(-np.linalg.norm(weights, axis=1)))
            new_points, new_weights = [], []
            while left:
                near = _apart(points[left], points[left[0]], atoms.counts) < radius
                group = [one for one, inside in zip(left, near, strict=True) if inside]
                left = [one for one, inside in zip(left, near, strict=True) if not inside]
                merged |= len(group) > 1
                new_points.append(points[group[0]])
                new_weights.append(_taken_over(atoms, points[group], weights[group]))
            if new_points:
                self.points[index], self.weights[index] = np.array(new_points), np.array(new_weights)
        return merged


def _apart(points: Real, point: Real, counts: Real) -> Real:
    """Largest coordinate distance in resolution cells."""
    return np.max(distance(points, point) * counts, axis=-1, initial=0.0)


def _taken_over(atoms: Atoms, points: Real, weights: Complex) -> Complex:
    if len(points) == 1:
        return weights[0]
    together = atoms.signals(points, weights).sum(axis=0)
    return np.linalg.lstsq(atoms.matrix(points[0]), together, rcond=None)[0]
