"""Samples that paths do not explain are not called found, and what would explain them is named."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from tmca.dbd import Channel, Chirp, Problem, Truth, simulate, solve, waveform_source
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


def scene(bandwidth, targets, seed=0, snr_db=20):
    """A chirp of so many hertz, echoes of (delay, Doppler, gain) targets, 9 pulses of 15 frequencies in noise."""
    source = waveform_source("radar", Chirp(bandwidth, 1e-6), 9, 15, 3e-6)
    points = np.array([(delay, doppler, 0) for delay, doppler, _ in targets])
    truth = Truth(points, np.array([gain for *_, gain in targets], complex), np.ones(1, complex))
    y = Channel.true(source, truth, (1, 9, 15)).samples().reshape(1, 9, 15)
    sigma = np.sqrt(np.mean(np.abs(y) ** 2)) * 10 ** (-snr_db / 20)
    noise = np.random.default_rng(seed).standard_normal((2, *y.shape)) / 2**0.5
    return Problem(y + sigma * (noise[0] + 1j * noise[1]), (source,), sigma)


THREE = ((0.09, 0.12, 1), (0.25, 0.62, 0.8j), (0.44, 0.84, -0.7))


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("share", [0.5, 0.875, pytest.param(2, marks=pytest.mark.slow)])
def test_another_pulse_than_the_one_that_was_given_is_suspected(share, known):
    problem = scene(4e6, THREE)
    wrong = replace(problem, sources=scene(4e6 * share, THREE).sources, sigma=problem.sigma if known else None)
    recovery, [line] = told(wrong)
    assert "3 with another pulse explain 99." in line
    assert line.endswith("is the pulse of radar right?")
    assert not recovery.found


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize(
    "targets",
    [
        THREE,
        [(0.1 * place, 0.3, 1j**place) for place in range(1, 6)],  # all as fast
        [(0.08, 0.2, 1), (0.3, 0.2, 0.7), (0.45, 0.2, -0.9), (0.15, 0.7, 1), (0.26, 0.7, 0.8j)],
    ],
)
def test_targets_of_one_velocity_are_left_alone_with_the_right_pulse(targets, known):
    problem = scene(4e6, targets, seed=1)
    recovery, lines = told(problem if known else replace(problem, sigma=None))
    assert (lines, len(recovery["radar"])) == ([], len(targets))


def test_the_verdict_on_a_doubtful_recovery_comes_first_and_whole():
    problem = scene(4e6, THREE)
    recovery, [line] = told(replace(problem, sources=scene(2e6, THREE).sources))
    assert recovery_lines(recovery)[0].startswith(f"found: no, {line}")
    assert line in repr(recovery)
    title = " ".join(recovery.plot().get_suptitle().split())
    assert title == f"in doubt: {line}"
