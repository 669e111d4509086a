"""Weights and positions under the sum of atomic norms: optimality conditions, CVXPY, finite differences."""

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest

from tests.dbd.loops import alone, slopes, small, true_positions
from tmca.dbd.channel import each_atom, fit, no_paths, paths, relative_residual, residual, with_fitted_weights
from tmca.dbd.frank_wolfe import descend, group_lasso
from tmca.dbd.noise import largest_level

LEVEL = 2.0


def with_source_weights(problem, weights):
    sources = tuple(replace(one, weight=w) for one, w in zip(problem.sources, weights, strict=True))
    return replace(problem, sources=sources)


def silent(problem, count=4, seed=0):
    """Random atoms of weight zero."""
    rng = np.random.default_rng(seed)
    return [one.added(rng.random((count, len(one.atoms.axes)))) for one in no_paths(problem)]


def displaced(problem):
    """Atoms of weight zero at the true points, each moved by up to a tenth of a cell."""
    rng, pairs = np.random.default_rng(1), zip(no_paths(problem), true_positions(problem), strict=True)
    return [one.added(x + 0.1 * rng.uniform(-1, 1, (len(x), 1)) / one.atoms.counts) for one, x in pairs]


def objective(channels, y, level):
    """Half the squared residual of the slow loop and the penalties."""
    left, penalty = y.reshape(-1).copy(), 0.0
    for atoms, point, weight in each_atom(channels):
        left -= alone(atoms, point, weight)
        penalty += atoms.source.weight * np.linalg.norm(weight)
    return 0.5 * np.linalg.norm(left) ** 2 + level * penalty


def cvxpys(channels, y, level):
    """The group lasso on real numbers."""
    atoms = list(each_atom(channels))
    blocks = [family.matrix(point) for family, point, _ in atoms]
    parts = [cp.Variable(2 * block.shape[1]) for block in blocks]
    real = [np.block([[b.real, -b.imag], [b.imag, b.real]]) for b in blocks]
    left = np.concatenate([y.real.ravel(), y.imag.ravel()]) - sum(b @ x for b, x in zip(real, parts, strict=True))
    norms = sum(one[0].source.weight * cp.norm(x) for one, x in zip(atoms, parts, strict=True))
    problem = cp.Problem(cp.Minimize(0.5 * cp.sum_squares(left) + level * norms))
    problem.solve(solver="CLARABEL")
    halves = [np.split(x.value, 2) for x in parts]
    return problem.value, np.concatenate([a + 1j * b for a, b in halves])


@pytest.mark.parametrize(("kind", "weights"), [("shared", (1.0, 1.0)), ("shared", (0.7, 1.6)), ("block", (1.0, 0.6))])
def test_group_lasso_is_cvxpys(kind, weights):
    problem = with_source_weights(small(kind), weights)
    value, vector = cvxpys(silent(problem, 3), problem.y, LEVEL)
    channels = group_lasso(silent(problem, 3), problem.y, LEVEL, sweeps=2000, tolerance=1e-12)
    assert objective(channels, problem.y, LEVEL) == pytest.approx(value, rel=1e-6)
    np.testing.assert_allclose(np.concatenate([one.weights.reshape(-1) for one in channels]), vector, atol=1e-3)


def test_group_lasso_meets_its_optimality_conditions():
    problem, level, off = small("shared"), 12.0, 0
    channels = group_lasso(silent(problem, 6), problem.y, level, sweeps=5000, tolerance=1e-13)
    left = residual(channels, problem.y)
    for atoms, point, weight in each_atom(channels):
        correlation = atoms.matrix(point).conj().T @ left
        if np.any(weight):
            np.testing.assert_allclose(correlation, level * weight / np.linalg.norm(weight), atol=1e-7)
        else:
            off += 1
            assert np.linalg.norm(correlation) <= level
    assert 0 < off < 12


@pytest.mark.parametrize("kind", ["shared", "block", "antennas", "three pulses a symbol"])
def test_sliding_ends_where_nothing_moves(kind):
    problem = small(kind)
    start = group_lasso(displaced(problem), problem.y, LEVEL)
    before = objective(start, problem.y, LEVEL)
    channels = fit(start, problem.y, 200, LEVEL)
    assert objective(channels, problem.y, LEVEL) < before
    for index, one in enumerate(channels):
        places, numbers = one.positions.size, one.waveform.size

        def around(step, index=index, one=one, places=places, numbers=numbers):
            change = step[places : places + numbers] + 1j * step[places + numbers :]
            other = [*channels[:index], one.moved(step[:places], change), *channels[index + 1 :]]
            return objective(other, problem.y, LEVEL)

        np.testing.assert_allclose(slopes(around, np.zeros(places + 2 * numbers), 1e-5), 0, atol=1e-4 * before)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("kind", ["shared", "block", "antennas", "one pulse"])
def test_displaced_atoms_slide_home_in_any_unit(kind, scale):
    problem = small(kind)
    y = scale * problem.y
    channels = fit(with_fitted_weights(displaced(problem), y), y, 50)
    assert relative_residual(channels, y) < 1e-10
    for one, expected in zip(channels, true_positions(problem), strict=True):
        np.testing.assert_allclose(one.positions, expected, atol=1e-9)


def test_above_the_largest_level_nothing_is_inserted():
    problem = small("shared")
    empty = no_paths(problem)
    level = largest_level(empty, problem.y)
    assert paths(descend(empty, problem.y, 1.1 * level)) == (0, 0)
    assert sum(paths(descend(empty, problem.y, 0.8 * level))) > 0


@pytest.mark.parametrize("kind", ["shared", "block", "three pulses a symbol"])
def test_a_descent_meets_the_conditions_of_the_regularised_optimum(kind):
    problem = small(kind)
    level = 0.1 * largest_level(no_paths(problem), problem.y)
    channels = fit(descend(no_paths(problem), problem.y, level, rounds=40), problem.y, 300, level)
    q = residual(channels, problem.y) / level
    for atoms, point, weight in each_atom(channels):
        f = atoms.matrix(point).conj().T @ q
        np.testing.assert_allclose(f, weight / np.linalg.norm(weight), atol=1e-4)
    for one in channels:
        spots = np.random.default_rng(0).random((400, len(one.atoms.axes)))
        assert max(np.linalg.norm(one.atoms.matrix(x).conj().T @ q) for x in spots) < 1.01
