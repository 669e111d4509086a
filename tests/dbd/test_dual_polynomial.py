"""Dual polynomials: values, derivatives, grids and peaks against sums written out."""

import numpy as np
import pytest

from tests.dbd.loops import KINDS, full, noise, polynomial, slopes, small
from tmca.dbd import Source
from tmca.dbd.atoms import Atoms, Polynomial


def random_ones(kind, seed=0):
    """The polynomials of both sources for a random dual variable, and their squares by the slow loop."""
    rng, problem = np.random.default_rng(seed), small(kind)
    for source in problem.sources:
        atoms, q = Atoms(source, problem.shape), noise(rng, *problem.shape)

        def square(x, atoms=atoms, q=q):
            return np.linalg.norm(polynomial(atoms.source, q, full(atoms, x))) ** 2

        yield Polynomial(atoms, q), square, rng.random((2, len(atoms.axes)))


@pytest.mark.parametrize("kind", KINDS)
def test_the_polynomial_is_the_adjoint_of_the_atoms(kind):
    for one, square, points in random_ones(kind):
        f = polynomial(one.atoms.source, one.q, full(one.atoms, points[0]))
        np.testing.assert_allclose(one.atoms.matrix(points[0]).conj().T @ one.q.reshape(-1), f, atol=1e-12)
        np.testing.assert_allclose(one.derivatives(points)[0], [square(x) for x in points])


@pytest.mark.parametrize("kind", KINDS)
def test_grids_hold_the_squares_at_their_points(kind):
    for one, square, _ in random_ones(kind):
        grid = (one.atoms.source.weight * one.levels_on_grid(2)) ** 2
        assert grid.shape == tuple(2 * int(count) for count in one.atoms.counts)
        places = np.random.default_rng(1).integers(grid.shape, size=(6, grid.ndim))
        slow = [square(place / np.array(grid.shape)) for place in places]
        np.testing.assert_allclose([grid[tuple(place)] for place in places], slow, rtol=1e-10)


@pytest.mark.parametrize(
    "kind",
    ["shared", "even", "block", "three pulses a symbol", "two symbols a pulse", "antennas", "antennas, block",
     "one pulse", "one frequency"],
)  # fmt: skip
def test_derivatives_are_finite_differences(kind):
    for one, square, points in random_ones(kind):
        value, gradient, hessian = one.derivatives(points)
        for at, x in enumerate(points):
            scale = square(x)
            assert value[at] == pytest.approx(scale)
            np.testing.assert_allclose(gradient[at], slopes(square, x), rtol=1e-5, atol=1e-5 * scale)
            twice = slopes(lambda z, square=square: slopes(square, z, 1e-4), x, 1e-4)
            np.testing.assert_allclose(hessian[at], twice, rtol=1e-3, atol=1e-3 * np.abs(twice).max())


@pytest.mark.parametrize("kind", ["shared", "even", "antennas", "one pulse", "one frequency"])
def test_a_dual_variable_of_one_atom_peaks_there(kind):
    problem = small(kind)
    source = Source("known", noise(np.random.default_rng(3), *problem.shape[1:], 1), [0] * problem.shape[1])
    atoms = Atoms(source, problem.shape)
    for point in (np.full(len(atoms.axes), 0.2345), np.full(len(atoms.axes), 0.9999)):
        points, levels = Polynomial(atoms, atoms.signals(point[None], np.ones(1))[0]).peaks(0.0)
        np.testing.assert_allclose(points[0], point, atol=1e-9)
        energy = problem.shape[0] * np.linalg.norm(source.rows) ** 2 / source.weight
        assert levels[0] == pytest.approx(energy)
        assert np.all(levels[1:] < energy)
        assert len(Polynomial(atoms, atoms.signals(point[None], np.ones(1))[0]).peaks(0.9999 * energy)[0]) == 1


def test_peaks_are_all_the_maxima_above_the_level():
    one, square, _ = next(random_ones("one pulse"))
    x = np.arange(1000) / 1000
    values = np.sqrt([square([at]) for at in x]) / one.atoms.source.weight
    tops = (values > np.roll(values, 1)) & (values >= np.roll(values, -1)) & (values >= 3.0)
    points, levels = one.peaks(3.0)
    assert np.all(np.diff(levels) <= 0)
    np.testing.assert_allclose(np.sort(points[:, 0]), x[tops], atol=1 / 1000)
    assert len(one.peaks(3.0, most=1)[0]) == 1
    assert one.peaks(1e3)[0].shape == (0, 1)
