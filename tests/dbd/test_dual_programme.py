"""The dual semidefinite programme: index arithmetic by loops, values by CVXPY and by its primal."""

from dataclasses import replace
from functools import cache

import cvxpy as cp
import numpy as np
import pytest

from tests.dbd.loops import noise, polynomial, small
from tmca.dbd import simulate
from tmca.dbd.channel import fit, no_paths, objective, residual
from tmca.dbd.dual import Gram, solve_admm, solve_cvx
from tmca.dbd.frank_wolfe import descend
from tmca.dbd.noise import largest_level

KINDS = ["shared", "even", "block", "three pulses a symbol", "two symbols a pulse", "antennas", "antennas, block"]
TINY = {
    "shared": {"M": 4, "P": 3},
    "block": {"M": 5, "P": 3, "messages": "block"},
    "antennas": {"M": 3, "P": 2, "antennas": 2},
    "two dimensions": {"M": 5, "P": 2, "J": 2},
}


@cache
def tiny(kind, weights=(1.0, 1.0)):
    problem = simulate(**{"J": 1, "targets": 1, "paths": 1, "basis": "gaussian", "seed": 3, **TINY[kind]})
    sources = tuple(replace(one, weight=w) for one, w in zip(problem.sources, weights, strict=True))
    return replace(problem, sources=sources)


def lattice(source, shape):
    """The places of the Gram matrix of a source: without pulses where each has a message of its own."""
    pulses = shape[1] if len(set(source.message.tolist())) < shape[1] else 1
    return [(a, p, n) for a in range(shape[0]) for p in range(pulses) for n in range(shape[2])]


def lags(source, shape):
    """The pairs of places that are the same step apart, by step."""
    places, pairs = lattice(source, shape), {}
    for i, here in enumerate(places):
        for k, there in enumerate(places):
            pairs.setdefault(tuple(b - a for a, b in zip(here, there, strict=True)), []).append((i, k))
    return pairs


def traces(source, shape):
    """A row for each lag of a half space, with ones where it lies in the Gram matrix, and what it has to sum to."""
    pairs = {lag: found for lag, found in lags(source, shape).items() if lag >= (0, 0, 0)}
    rows = np.zeros((len(pairs), len(lattice(source, shape)), len(lattice(source, shape))))
    for row, found in zip(rows, pairs.values(), strict=True):
        for pair in found:
            row[pair] = 1
    return rows.reshape(len(pairs), -1), np.array([float(lag == (0, 0, 0)) for lag in pairs])


def entries(source, shape):
    """The coefficients of the dual polynomial for each unit vector in the place of q: ``(G J, places, samples)``."""
    places, J = lattice(source, shape), source.rows.shape[2]
    found = np.zeros(((source.message[-1] + 1) * J, len(places), int(np.prod(shape))), complex)
    for number, (a, p, n) in enumerate(np.ndindex(*shape)):
        place = places.index((a, p, n) if (a, p, n) in places else (a, 0, n))
        for j in range(J):
            found[source.message[p] * J + j, place, number] = np.conj(source.rows[p, n, j])
    return found


def slow_value(problem, level=0.0, shared=False):
    """The programme written out for CVXPY: matrices entry by entry, traces lag by lag."""
    q = cp.Variable(problem.y.size, complex=True)
    constraints, corner = [], None
    for source in problem.sources:
        size, count, samples = (unit := entries(source, problem.shape)).shape
        if corner is None or not shared:
            corner = cp.Variable((count, count), hermitian=True)
            sums, wanted = traces(source, problem.shape)
            constraints.append(sums @ cp.vec(corner, order="C") == wanted)
        H = cp.reshape(unit.reshape(-1, samples) @ q, (size, count), order="C")
        constraints.append(cp.bmat([[corner, H.H], [H, source.weight**2 * np.eye(size)]]) >> 0)
    gained = cp.real(cp.sum(cp.multiply(problem.y.reshape(-1).conj(), q)))
    spent = level / 2 * cp.sum_squares(cp.hstack([cp.real(q), cp.imag(q)])) if level else 0
    programme = cp.Problem(cp.Maximize(gained - spent), constraints)
    programme.solve(solver="CLARABEL")
    return programme.value


@cache
def tiny_value(kind, level=0.0, shared=False):
    return slow_value(tiny(kind), level, shared)


@pytest.mark.parametrize("kind", KINDS)
def test_traces_are_made_one_diagonal_at_a_time(kind):
    problem, rng = small(kind), np.random.default_rng(0)
    for source in problem.sources:
        gram = Gram(source, problem.shape)
        matrix = noise(rng, gram.size, gram.size)
        expected = matrix.copy()
        for lag, pairs in lags(source, problem.shape).items():
            spare = (sum(matrix[pair] for pair in pairs) - (lag == (0, 0, 0))) / len(pairs)
            for pair in pairs:
                expected[pair] -= spare
        np.testing.assert_allclose(gram.unit_traces(matrix), expected, atol=1e-12)


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")
@pytest.mark.parametrize(("kind", "level"), [*((kind, 0.0) for kind in TINY), ("shared", 0.5), ("block", 0.5)])
def test_both_solvers_reach_the_value_of_the_programme_written_out(kind, level):
    problem = tiny(kind)
    expected = tiny_value(kind, level)
    found = solve_admm(problem, level=level)
    assert found.residual < 1e-5
    assert found.value == pytest.approx(expected, abs=2e-3)
    assert solve_cvx(problem, level=level).value == pytest.approx(expected, abs=1e-4)


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")
@pytest.mark.parametrize("kind", ["shared", "block"])
def test_weights_bound_the_polynomials(kind):
    problem = tiny(kind, (0.6, 1.5))
    found = solve_admm(problem)
    assert found.value == pytest.approx(slow_value(problem), abs=2e-3)
    points = np.random.default_rng(0).random((200, 3)) * [1, 1, 0]
    for source in problem.sources:
        highest = max(np.linalg.norm(polynomial(source, found.q, x)) for x in points)
        assert 0.8 * source.weight < highest < 1.002 * source.weight


def test_one_gram_matrix_for_all_sources_is_a_restriction():
    lower = []
    for seed in (0, 2):
        problem = simulate(M=5, P=2, J=2, targets=1, paths=1, seed=seed)
        separate = solve_admm(problem).value
        shared = solve_admm(problem, gram="shared").value
        assert shared <= separate + 2e-3
        lower.append(shared < separate - 5e-3)
    assert any(lower)


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")
@pytest.mark.parametrize("solver", [solve_admm, solve_cvx])
def test_the_thesis_gram_gives_the_value_of_the_programme_written_out(solver):
    problem = tiny("two dimensions")
    assert solver(problem, gram="shared").value == pytest.approx(tiny_value("two dimensions", shared=True), abs=2e-3)


@pytest.mark.parametrize("kind", ["shared", "block"])
def test_the_regularised_dual_is_the_scaled_residual_of_its_primal(kind):
    problem = small(kind, M=5, P=2, J=1, targets=1)
    level = 0.1 * largest_level(no_paths(problem), problem.y)
    channels = fit(descend(no_paths(problem), problem.y, level, rounds=30), problem.y, 100, level)
    found = solve_admm(problem, level=level)
    left = residual(channels, problem.y).reshape(problem.shape)
    assert np.linalg.norm(found.q - left / level) < 0.02 * np.linalg.norm(found.q)
    assert level * found.value == pytest.approx(objective(channels, left.reshape(-1), level), rel=1e-3)
