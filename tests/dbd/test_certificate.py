"""A certificate is a polynomial that anybody can check; where there is none, that is said."""

from functools import cache

import numpy as np
import pytest

from tests.dbd.loops import full, lifted, polynomial, true_positions
from tmca.dbd import certificate as module
from tmca.dbd import simulate, solve
from tmca.dbd.certificate import certificate
from tmca.dbd.channel import each_atom, no_paths
from tmca.dbd.dual import solve_admm
from tmca.dbd.identifiability import SameSignals


def true_atoms(problem):
    weights = [np.outer(truth.amplitudes, truth.waveform) for truth in problem.truth]
    return lifted(problem, true_positions(problem), weights)


@cache
def solved(messages):
    """A certified and a refuted recovery, both of them right."""
    return solve(simulate(M=7, P=4, J=2, targets=1, paths=1, messages=messages, seed=1))


@pytest.mark.parametrize("more", [{}, {"antennas": 2}, {"targets": 2, "paths": 0}, {"M": 8}])
def test_a_certificate_takes_the_directions_of_the_weights_and_stays_below_one(more):
    channels = true_atoms(simulate(**{"M": 7, "P": 5, "J": 2, "targets": 1, "paths": 1, **more}))
    found = certificate(channels)
    assert (found.status, found.certified) == ("certified", True)
    assert found.level <= 1 + 1e-6
    for atoms, point, weight in each_atom(channels):
        f = polynomial(atoms.source, found.q, full(atoms, point))
        np.testing.assert_allclose(f, weight / np.linalg.norm(weight), atol=1e-6)
    spots = np.random.default_rng(0).random((300, 3))
    for atoms in (one.atoms for one in channels):
        norms = [np.linalg.norm(polynomial(atoms.source, found.q, full(atoms, x[: len(atoms.axes)]))) for x in spots]
        assert max(norms) <= 1 + 1e-6


def test_opposite_atoms_closer_than_a_tenth_of_a_cell_are_refuted():
    problem = simulate(M=9, P=5, J=1, targets=2, paths=1, basis="gaussian")
    twins, apart = [[[0.3, 0.4], [0.3 + gap / 9, 0.4]] for gap in (0.05, 2.0)]
    weights = [[[1.0], [-1.0]], [[1j]]]
    assert certificate(lifted(problem, [twins, [[0.7, 0.2]]], weights)).status == "refuted"
    assert certificate(lifted(problem, [apart, [[0.7, 0.2]]], weights)).status == "certified"


def test_two_atoms_at_one_place_that_disagree_are_refuted():
    problem = simulate(M=9, P=5, J=1, targets=2, paths=1, basis="gaussian")
    found = certificate(lifted(problem, [[[0.3, 0.4], [0.3, 0.4]], [[0.7, 0.2]]], [[[1.0], [1j]], [[1.0]]]))
    assert found.status == "refuted"
    assert "no polynomial takes these values" in found.reason


def test_what_is_certified_is_the_optimum_of_the_programme():
    recovery = solved("shared")
    assert recovery.certified is True
    total = sum(np.abs(one.amplitudes).sum() for one in recovery.sources)
    assert solve_admm(recovery.problem).value == pytest.approx(total, abs=1e-3)
    assert np.vdot(recovery.q, recovery.problem.y).real == pytest.approx(total, abs=1e-5)


def test_what_is_refuted_is_not():
    recovery = solved("block")
    assert recovery.score().success
    assert recovery.exact
    assert recovery.certified is False
    assert any("not certified" in note for note in recovery.notes)
    total = sum(np.abs(one.amplitudes).sum() for one in recovery.sources)
    assert solve_admm(recovery.problem).value < total - 5e-3


def test_an_optimum_among_others_is_not_the_only_one():
    """With one Vandermonde column both sources send ones: the path of either may be the other's."""
    problem = simulate(M=9, P=5, J=1, targets=1, paths=1, seed=1)
    with pytest.warns(SameSignals):
        recovery = solve(problem)
    assert recovery.certified
    assert not recovery.certificate.unique
    assert "certified, but there may be other optima" in recovery.notes
    alone = solved("shared")
    assert alone.certificate.unique
    assert not any("certified" in note for note in alone.notes)


def test_nobody_certifies_nothing_or_what_is_too_large(monkeypatch):
    problem = simulate(M=7, P=4, J=2, targets=1, paths=1, messages="block", seed=1)
    empty = certificate(no_paths(problem))
    assert (empty.status, empty.certified, empty.reason) == ("undecided", None, "no atoms")
    monkeypatch.setattr(module, "_LARGEST", 20)
    large = certificate(true_atoms(problem))
    assert large.status == "undecided"
    assert "28 samples are many" in large.reason
    assert large.level > 1 + 1e-6


@pytest.mark.slow
def test_bounds_that_can_just_not_be_kept_refute_too():
    """The least norm stalls here: samples whose truth is one per cent above the optimum."""
    problem = simulate(M=9, P=5, J=2, targets=3, paths=1, seed=1)
    assert certificate(true_atoms(problem)).status == "refuted"
    total = sum(np.abs(one.amplitudes).sum() for one in problem.truth)
    assert solve_admm(problem).value < 0.995 * total
