"""Atoms are what a path puts on the samples, channels sums of them; dual polynomials against sums written out."""

import numpy as np
import pytest

from tests.dbd.loops import KINDS, alone, full, lifted, noise, polynomial, scattered, slopes, small
from tmca.dbd import Source
from tmca.dbd.atoms import Atoms, Polynomial
from tmca.dbd.channel import each_atom, paths, relative_residual, residual, with_fitted_weights
from tmca.errors import SettingError


def families(kind):
    problem = small(kind)
    return [Atoms(source, problem.shape) for source in problem.sources]


@pytest.mark.parametrize("kind", KINDS)
def test_an_atom_is_a_path_of_the_slow_loop_and_slopes_are_its_differences(kind):
    rng = np.random.default_rng(1)
    for atoms in families(kind):
        point, weight = rng.random(len(atoms.axes)), noise(rng, atoms.size)
        expected = alone(atoms, point, weight)
        np.testing.assert_allclose(atoms.matrix(point) @ weight, expected, atol=1e-12)
        np.testing.assert_allclose(atoms.signals(point[None], weight)[0], expected, atol=1e-12)
        differences = slopes(lambda x, atoms=atoms, weight=weight: alone(atoms, x, weight), point)
        np.testing.assert_allclose(atoms.slopes(point[None], weight), differences, atol=1e-6)


@pytest.mark.parametrize(
    ("kind", "axes"),
    [
        ("shared", ("delay", "doppler")),
        ("block", ("delay",)),
        ("three pulses a symbol", ("delay", "doppler")),
        ("two symbols a pulse", ("delay",)),
        ("antennas", ("delay", "doppler", "angle")),
        ("antennas, block", ("delay", "angle")),
        ("one pulse", ("delay",)),
        ("one frequency", ("doppler",)),
    ],
)
def test_a_point_has_the_coordinates_that_show(kind, axes):
    problem = small(kind)
    atoms = Atoms(problem.sources[-1], problem.shape)
    assert atoms.axes == axes
    sizes = dict(zip(("angle", "doppler", "delay"), problem.shape, strict=True))
    assert atoms.counts.tolist() == [sizes[axis] for axis in axes]
    points = np.random.default_rng(0).random((2, len(axes)))
    np.testing.assert_array_equal(atoms.seen(atoms.full(points)), points)


def test_samples_on_which_nothing_shows_are_refused():
    with pytest.raises(SettingError) as caught:
        Atoms(small("block").sources[1], (1, 5, 1))
    assert caught.value.where == "samples of communications"


@pytest.mark.parametrize("kind", ["shared", "block", "antennas"])
def test_a_residual_is_what_the_atoms_leave(kind):
    problem = small(kind)
    channels, y = scattered(problem, 3), problem.y.reshape(-1)
    left = y - sum(alone(*one) for one in each_atom(channels))
    np.testing.assert_allclose(residual(channels, problem.y), left, atol=1e-11)
    assert relative_residual(channels, problem.y) == pytest.approx(np.linalg.norm(left) / np.linalg.norm(y))


def test_fitted_weights_leave_nothing_that_the_atoms_could_explain():
    problem = small("shared")
    channels = with_fitted_weights(scattered(problem, 3), problem.y)
    left = residual(channels, problem.y)
    for one in channels:
        np.testing.assert_allclose(one.linear().conj().T @ left, 0, atol=1e-10)


def test_twins_merge_across_the_edge_and_keep_their_signal():
    problem = small("shared")
    places = [[0.9999, 0.5], [0.0001, 0.5]], [[0.1, 0.2], [0.1, 0.45]]
    channels = lifted(problem, places, noise(np.random.default_rng(0), 2, 2, 2))
    merged = [one.merged(0.5) for one in channels]
    assert paths(merged) == (1, 2)
    before, after = residual(channels, problem.y), residual(merged, problem.y)
    assert np.linalg.norm(after - before) < 0.02 * np.linalg.norm(before)


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
