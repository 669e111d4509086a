"""Samples that paths do not explain are not called found, and what would explain them is named."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from tmca.dbd import simulate, solve
from tmca.dbd.model import LittleExplained
from tmca.dbd.tables import recovery_lines

PROBLEM = simulate(M=11, P=4, J=2, targets=1, paths=0, seed=1, snr_db=20, basis="gaussian")


def told(problem):
    """The recovery, and what was warned of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        recovery = solve(replace(problem, truth=None), certify=False)
    return recovery, [str(one.message) for one in caught if one.category is LittleExplained]


def with_rows(change):
    source = PROBLEM.sources[0]
    return replace(PROBLEM, sources=(replace(source, rows=change(source.rows)),))


@pytest.mark.parametrize("sigma", [PROBLEM.sigma, None])
@pytest.mark.parametrize(
    ("problem", "named"),
    [
        (with_rows(np.conj), "the conjugate of the basis explains 99%: is the sign of the time axis or the I/Q order"),
        (
            replace(PROBLEM, y=PROBLEM.y[..., ::-1].conj()),
            "reversed frequencies explains 99%: is the I/Q order swapped",
        ),
        (
            replace(PROBLEM, y=PROBLEM.y[..., ::-1]),
            "basis at reversed frequencies explains 99%: is the sign of the time",
        ),
    ],
)
def test_a_swapped_sign_is_named(problem, named, sigma):
    recovery, [line] = told(replace(problem, sigma=sigma))
    assert named in line
    assert not recovery.found
    assert recovery.doubt is not None


@pytest.mark.parametrize("sigma", [PROBLEM.sigma, None])
def test_the_right_basis_is_left_alone(sigma):
    recovery, lines = told(replace(PROBLEM, sigma=sigma))
    assert (lines, recovery.found, recovery.doubt) == ([], True, None)


def test_what_is_unexplained_is_the_energy_that_the_paths_leave():
    recovery, _ = told(PROBLEM)
    model = recovery["radar"].samples().reshape(PROBLEM.shape)
    left = np.sum(np.abs(PROBLEM.y - model) ** 2) / np.sum(np.abs(PROBLEM.y) ** 2)
    assert recovery.unexplained == pytest.approx(left)
    assert recovery.unexplained == pytest.approx(0.01, rel=0.4)


def test_a_basis_of_something_else_is_told_without_a_name():
    silent = np.abs(np.arange(11) - 5) > 1
    recovery, [line] = told(with_rows(lambda rows: np.where(silent[:, None], 0, rows)))
    assert "are bases, messages and sigma those of y?" in line
    assert not recovery.found
    assert "found: no, the paths leave" in "\n".join(recovery_lines(recovery))
