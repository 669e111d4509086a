"""How many unknowns samples can tell: the rank of the atoms, and what is said before and after."""

import warnings

import numpy as np
import pytest

from tests.dbd.loops import small
from tmca.dbd import simulate, solve
from tmca.dbd.atoms import Atoms
from tmca.dbd.identifiability import ambiguities, beyond_freedom, same_signals


def stacked(problem, counts, seed=0):
    """The atoms of so many random points of every source side by side."""
    rng, blocks = np.random.default_rng(seed), []
    for source, count in zip(problem.sources, counts, strict=True):
        atoms = Atoms(source, problem.shape)
        blocks += [atoms.matrix(rng.random(len(atoms.axes))) for _ in range(count)]
    return np.hstack(blocks)


@pytest.mark.parametrize("pulses", [5, 9, 17])
@pytest.mark.parametrize(("frequencies", "J", "L", "Q"), [(9, 3, 3, 3), (9, 2, 2, 2), (10, 3, 3, 3), (7, 3, 4, 2)])
def test_block_messages_need_coefficients_for_every_path_and_pulse(frequencies, J, L, Q, pulses):
    problem = simulate(M=frequencies, P=pulses, J=J, targets=1, paths=1, messages="block", basis="gaussian")
    unknowns = L * J + Q * J * pulses
    assert [L * J, Q * J * pulses] == [n * one.unknowns for n, one in zip((L, Q), problem.sources, strict=True)]
    rank = np.linalg.matrix_rank(stacked(problem, (L, Q)))
    assert rank == min(unknowns, frequencies * pulses)
    assert (rank == unknowns) == (beyond_freedom(problem, (L, Q)) is None)


@pytest.mark.parametrize(("kind", "each"), [("shared", 2), ("three pulses a symbol", 4), ("two symbols a pulse", 20)])
def test_other_messages_need_what_their_sharing_says(kind, each):
    problem = small(kind)
    assert [one.unknowns for one in problem.sources] == [2, each]
    assert np.linalg.matrix_rank(stacked(problem, (2, 1))) == 2 * 2 + each


def test_antennas_add_samples():
    assert "exceed 35 samples" in beyond_freedom(small("block"), (2, 4))
    assert beyond_freedom(small("block", antennas=2), (2, 4)) is None


def test_beyond_freedom_is_warned_of_before_the_work():
    problem = simulate(M=3, P=2, J=1, targets=1, paths=3, messages="block", basis="gaussian", separation=0.05)
    with pytest.warns(UserWarning, match="1 x 1 . 3 x 2 = 7 lifted unknowns exceed 6 samples") as caught:
        recovery = solve(problem)
    assert caught[0].filename == __file__
    assert not recovery.score().success


def test_within_freedom_there_is_no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solve(simulate(M=7, P=4, J=1, targets=1, paths=1, basis="gaussian"))


@pytest.mark.parametrize("messages", ["shared", "block", "dense"])
def test_a_source_that_can_send_all_that_another_can_is_named(messages):
    same = simulate(M=7, P=5, J=1, targets=1, paths=1, messages=messages)  # Vandermonde rows of one column are ones
    assert same_signals(same) == ("radar and communications can send the same signals: any path may be of either",)
    assert not same_signals(simulate(M=7, P=5, J=1, targets=1, paths=1, messages=messages, basis="gaussian"))


def test_what_cannot_be_known_is_said_of_those_whom_it_concerns():
    block = " ".join(ambiguities(small("block")))
    assert "communications: messages of their own in every pulse absorb the absolute Doppler" in block
    assert "radar: messages" not in block
    for kind in ("shared", "one pulse", "three pulses a symbol"):
        told = " ".join(ambiguities(small(kind)))
        assert "absorb the absolute Doppler" not in told
        assert "scale and phase of each waveform" in told
        assert "lag" in told
