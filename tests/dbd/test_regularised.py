"""Weights and positions under the sum of atomic norms: optimality conditions, CVXPY, finite differences."""

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest

from tests.dbd.loops import full, samples, slopes, small
from tmca.dbd import Truth
from tmca.dbd.atoms.measure import Measure
from tmca.dbd.solvers.frank_wolfe import descend, largest_level
from tmca.dbd.solvers.group_lasso import group_lasso
from tmca.dbd.solvers.slide import slide

LEVEL = 2.0


def scattered(kind="shared", count=4, weights=(1.0, 1.0), seed=0):
    """Random points without weights; sources may weigh differently in the sum of norms."""
    problem = small(kind)
    sources = tuple(replace(one, weight=w) for one, w in zip(problem.sources, weights, strict=True))
    rng, measure = np.random.default_rng(seed), Measure.empty(replace(problem, sources=sources))
    for index, atoms in enumerate(measure.atoms):
        measure.add(index, rng.random((count, len(atoms.axes))))
    return measure


def displaced(problem):
    """The true points, each moved by up to a tenth of a cell, without weights."""
    measure, rng = Measure.empty(problem), np.random.default_rng(1)
    for index, (atoms, truth) in enumerate(zip(measure.atoms, problem.truth, strict=True)):
        columns = [("delay", "doppler", "angle").index(axis) for axis in atoms.axes]
        measure.add(index, truth.points[:, columns] + 0.1 * rng.uniform(-1, 1, (len(truth.points), 1)) / atoms.counts)
    return measure


def objective(measure, level):
    """Half the squared residual of the slow loop and the penalties."""
    left, penalty = measure.y.copy(), 0.0
    for atoms, point, weight in measure.each():
        truth = Truth(np.array([full(atoms, point)]), np.ones(1), weight)
        left -= samples(atoms.shape, (atoms.source,), (truth,)).reshape(-1)
        penalty += atoms.source.weight * np.linalg.norm(weight)
    return 0.5 * np.linalg.norm(left) ** 2 + level * penalty


def cvxpys(measure, level):
    """The group lasso on real numbers."""
    blocks = [atoms.matrix(point) for atoms, point, _ in measure.each()]
    parts = [cp.Variable(2 * block.shape[1]) for block in blocks]
    real = [np.block([[b.real, -b.imag], [b.imag, b.real]]) for b in blocks]
    left = np.concatenate([measure.y.real, measure.y.imag]) - sum(b @ x for b, x in zip(real, parts, strict=True))
    norms = sum(one[0].source.weight * cp.norm(x) for one, x in zip(measure.each(), parts, strict=True))
    problem = cp.Problem(cp.Minimize(0.5 * cp.sum_squares(left) + level * norms))
    problem.solve(solver="CLARABEL")
    halves = [np.split(x.value, 2) for x in parts]
    return problem.value, np.concatenate([a + 1j * b for a, b in halves])


@pytest.mark.parametrize(("kind", "weights"), [("shared", (1.0, 1.0)), ("shared", (0.7, 1.6)), ("block", (1.0, 0.6))])
def test_group_lasso_is_cvxpys(kind, weights):
    measure = scattered(kind, 3, weights)
    value, vector = cvxpys(measure, LEVEL)
    group_lasso(measure, LEVEL, sweeps=2000, tolerance=1e-12)
    assert objective(measure, LEVEL) == pytest.approx(value, rel=1e-6)
    np.testing.assert_allclose(measure.vector(), vector, atol=1e-3)


def test_group_lasso_meets_its_optimality_conditions():
    measure, level = scattered(count=6), 12.0
    group_lasso(measure, level, sweeps=5000, tolerance=1e-13)
    left, silent = measure.residual(), 0
    for atoms, point, weight in measure.each():
        correlation = atoms.matrix(point).conj().T @ left
        if np.any(weight):
            np.testing.assert_allclose(correlation, level * weight / np.linalg.norm(weight), atol=1e-7)
        else:
            silent += 1
            assert np.linalg.norm(correlation) <= level
    assert 0 < silent < 12


def test_a_level_that_no_atom_reaches_silences_all():
    measure = scattered()
    reached = [np.linalg.norm(atoms.matrix(point).conj().T @ measure.y) for atoms, point, _ in measure.each()]
    group_lasso(measure, 1.01 * max(reached))
    assert not measure.vector().any()
    group_lasso(measure, 0.99 * max(reached))
    assert np.sum([np.any(weight) for _, _, weight in measure.each()]) == 1


@pytest.mark.parametrize("kind", ["shared", "block", "antennas", "three pulses a symbol"])
def test_sliding_ends_where_nothing_moves(kind):
    measure = displaced(small(kind))
    group_lasso(measure, LEVEL)
    before = objective(measure, LEVEL)
    slide(measure, LEVEL, steps=200)
    size = measure.vector().size

    def around(step):
        other = measure.copy()
        other.set_vector(measure.vector() + step[:size] + 1j * step[size : 2 * size])
        other.move(step[2 * size :])
        return objective(other, LEVEL)

    count = 2 * size + sum(one.size for one in measure.points)
    assert objective(measure, LEVEL) < before
    np.testing.assert_allclose(slopes(around, np.zeros(count), 1e-5), 0, atol=1e-4 * before)


@pytest.mark.parametrize("kind", ["shared", "block", "antennas", "one pulse"])
def test_displaced_atoms_slide_home(kind):
    problem = small(kind)
    measure = displaced(problem)
    measure.fit_weights()
    slide(measure, 0.0, steps=50)
    assert measure.relative_residual() < 1e-10
    for atoms, points, truth in zip(measure.atoms, measure.points, problem.truth, strict=True):
        for point, true in zip(points, truth.points, strict=True):
            expected = [x for x, axis in zip(true, ("delay", "doppler", "angle"), strict=True) if axis in atoms.axes]
            np.testing.assert_allclose(point, expected, atol=1e-9)


def test_sliding_works_in_any_unit():
    for scale in (1e-9, 1e9):
        measure = displaced(small("shared"))
        measure.y = scale * measure.y
        measure.fit_weights()
        slide(measure, 0.0, steps=50)
        assert measure.relative_residual() < 1e-10


def test_above_the_largest_level_nothing_is_inserted():
    measure = Measure.empty(small("shared"))
    level = largest_level(measure)
    descend(measure, 1.1 * level)
    assert measure.counts == (0, 0)
    descend(measure, 0.8 * level)
    assert sum(measure.counts) > 0


@pytest.mark.parametrize("kind", ["shared", "block", "three pulses a symbol"])
def test_a_descent_meets_the_conditions_of_the_regularised_optimum(kind):
    measure = Measure.empty(small(kind))
    level = 0.1 * largest_level(measure)
    descend(measure, level, rounds=40)
    slide(measure, level, steps=300)
    q = (measure.residual() / level).reshape(measure.atoms[0].shape)
    for atoms, point, weight in measure.each():
        f = atoms.matrix(point).conj().T @ q.reshape(-1)
        np.testing.assert_allclose(f, weight / np.linalg.norm(weight), atol=1e-4)
    for atoms in measure.atoms:
        spots = np.random.default_rng(0).random((400, len(atoms.axes)))
        assert max(np.linalg.norm(atoms.matrix(x).conj().T @ q.reshape(-1)) for x in spots) < 1.01


def test_a_weight_of_a_source_is_a_scale_of_its_basis():
    problem = small("one pulse")
    radar, link = problem.sources
    values = []
    for one in (radar, replace(radar, weight=1.5), replace(radar, rows=radar.rows / 1.5)):
        measure = Measure.empty(replace(problem, sources=(one, link)))
        descend(measure, 1.0, rounds=40)
        values.append(objective(measure, 1.0))
    assert values[1] == pytest.approx(values[2], rel=1e-4)
    assert values[0] < 0.95 * values[1]
