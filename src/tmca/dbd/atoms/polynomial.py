"""The dual polynomial of a source: its norm on grids and at points, and where it peaks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tmca.dbd.arrays import Complex, Mask, Real, Whole
from tmca.dbd.atoms.atoms import Atoms
from tmca.dbd.torus import distance

_NEWTON_STEPS = 14
_SAME_PEAK = 0.1
"""Maxima closer than this share of a resolution cell are one."""


class Polynomial:
    """``f(x) = Σ q conj(rows) exp(+j2π(n τ + p ν + a θ))`` in C^(G J) (thesis equations 77 and 78, corrected).

    Args:
        atoms: of the source.
        q: ``(A, P, M)``, the dual variable.
    """

    def __init__(self, atoms: Atoms, q: Complex) -> None:
        self.atoms, self.q = atoms, q.reshape(atoms.shape)
        self.starts = np.flatnonzero(np.diff(atoms.source.message, prepend=-1))

    def norms_on_grid(self, oversampling: int = 4) -> Real:
        """``‖f‖²`` on a grid of ``oversampling`` points a resolution cell; dimensions as a point's coordinates."""
        atoms = self.atoms
        axes = atoms.lattice_axes[::-1]
        sizes = [int(oversampling * count) for count in atoms.counts[::-1]]
        absorbed = tuple(axis for axis in range(3) if axis not in axes)
        total = np.zeros(sizes)
        for coefficients in self._components(atoms.source.messages > 1 and 1 in axes):
            spectrum = np.fft.ifftn(coefficients, sizes, axes)
            total += (spectrum.real**2 + spectrum.imag**2).sum(absorbed)
        return total.T * float(np.prod(sizes)) ** 2

    def _components(self, by_message: bool) -> Iterator[Complex]:
        """Per component of f the ``(A, P, M)`` coefficients that a Fourier transform sums."""
        source = self.atoms.source
        for column in range(source.subspace):
            values = np.conj(source.rows[:, :, column]) * self.q
            if not by_message:
                yield values
                continue
            for message in range(source.messages):
                yield np.where((source.message == message)[None, :, None], values, 0)

    def derivatives(self, points: Real) -> tuple[Real, Real, Real]:
        """``‖f‖²`` at ``(n, D)`` points, its gradient ``(n, D)`` and its Hessian ``(n, D, D)``."""
        moments = self._moments(points)
        dims = range(len(self.atoms.axes))
        f = moments[(0,) * len(dims)]
        first = [moments[tuple(int(i == d) for i in dims)] for d in dims]

        def inner(a: Complex, b: Complex) -> Real:
            return 2 * np.real(np.sum(np.conj(a) * b, axis=(1, 2)))

        gradient = np.stack([inner(f, one) for one in first], axis=-1)
        hessian = np.empty((len(points), len(dims), len(dims)))
        for i in dims:
            for j in dims:
                second = moments[tuple(int(k == i) + int(k == j) for k in dims)]
                hessian[:, i, j] = inner(f, second) + inner(first[i], first[j])
        return inner(f, f) / 2, gradient, hessian

    def values(self, points: Real) -> Complex:
        """``f`` at ``(n, D)`` points: ``(n, G J)``."""
        moments = self._moments(points, orders=1)
        return moments[(0,) * len(self.atoms.axes)].reshape(len(points), -1)

    def _moments(self, points: Real, orders: int = 3) -> dict[tuple[int, ...], Complex]:
        """Derivatives of f by the coordinates, keyed by order in each; each ``(n, G, J)``."""
        count, atoms = len(points), self.atoms
        powers = {axis: np.ones((count, 1, atoms.shape[axis]), complex) for axis in range(3)}
        for axis, numbers, x in zip(atoms.lattice_axes, atoms.exponents, points.T, strict=True):
            slope = 2j * np.pi * numbers
            wave = np.exp(x[:, None] * slope)
            powers[axis] = np.stack([slope**order * wave for order in range(orders)], axis=1)
        weighted = np.conj(atoms.source.rows) * self.q[..., None]
        over_n = np.matmul(powers[2].reshape(-1, atoms.shape[2]), weighted)
        over_n = over_n.reshape(*atoms.shape[:2], count, -1, atoms.source.subspace)
        terms = over_n[:, :, :, :, None] * powers[1].transpose(2, 0, 1)[None, :, :, None, :, None]
        over_p = np.add.reduceat(terms, self.starts, axis=1)
        full = np.einsum("agnors,nta->nortgs", over_p, powers[0])
        found = {}
        for order in np.ndindex(full.shape[1], full.shape[2], full.shape[3]):
            if sum(order) <= 2:
                found[tuple(order[2 - axis] for axis in atoms.lattice_axes)] = full[(slice(None), *order)]
        return found

    def ascend(self, points: Real) -> tuple[Real, Real]:
        """Maxima of ``‖f‖²`` near ``(n, D)`` points by safeguarded Newton steps, and their values."""
        x = np.array(points, float)
        limit = 0.5 / self.atoms.counts
        value, gradient, hessian = self.derivatives(x)
        active = np.arange(len(x))
        for _ in range(_NEWTON_STEPS):
            if not len(active):
                break
            step = _newton_step(gradient[active], hessian[active], limit)
            moved = self._accepted(x, value, gradient, hessian, active, step)
            active = active[moved]
        return x % 1.0, value

    def _accepted(self, x: Real, value: Real, gradient: Real, hessian: Real, active: Whole, step: Real) -> Mask:
        """Takes each step, halved while it loses; says which points still move."""
        moved = np.zeros(len(active), bool)
        waiting = np.arange(len(active))
        for halving in range(4):
            trial = x[active[waiting]] + step[waiting] / 2**halving
            v, g, h = self.derivatives(trial)
            at = active[waiting]
            good = v >= value[at] - 1e-14 * np.abs(value[at])
            won = at[good]
            x[won], value[won], gradient[won], hessian[won] = trial[good], v[good], g[good], h[good]
            moved[waiting[good]] = np.abs(step[waiting[good]] / 2**halving).max(-1) > 1e-12
            waiting = waiting[~good]
            if not len(waiting):
                break
        return moved

    def peaks(self, level: float = 1.0, oversampling: int = 4, most: int = 20) -> tuple[Real, Real]:
        """Local maxima of ``‖f‖`` of at least ``level``, the highest first: points ``(n, D)`` and norms."""
        from scipy.ndimage import maximum_filter

        grid = self.norms_on_grid(oversampling)
        high = (grid >= maximum_filter(grid, size=3, mode="wrap")) & (grid >= 0.8 * level**2)
        places = np.argwhere(high)
        places = places[np.argsort(-grid[high])][:most]
        if not len(places):
            return np.zeros((0, len(self.atoms.axes))), np.zeros(0)
        points, squares = self.ascend(places / np.array(grid.shape))
        return _distinct(points, np.sqrt(squares), level, self.atoms.counts)


def _newton_step(gradient: Real, hessian: Real, limit: Real) -> Real:
    """Uphill step with the absolute curvatures, shortened to ``limit`` in every coordinate."""
    curvature, directions = np.linalg.eigh(hessian)
    size = np.abs(curvature)
    size = np.maximum(size, 1e-9 * size.max(-1, keepdims=True) + 1e-300)
    along = np.einsum("nij,ni->nj", directions, gradient) / size
    step = np.einsum("nij,nj->ni", directions, along)
    shorten = np.min(limit / (np.abs(step) + 1e-300), axis=-1, keepdims=True)
    return step * np.minimum(1, shorten)


def _distinct(points: Real, norms: Real, level: float, counts: Real) -> tuple[Real, Real]:
    """The points above the level, each once."""
    kept: list[int] = []
    for one in np.argsort(-norms):
        near = [np.max(distance(points[one], points[other]) * counts) < _SAME_PEAK for other in kept]
        if norms[one] >= level and not any(near):
            kept.append(int(one))
    return points[kept], norms[kept]
