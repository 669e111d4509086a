"""In noise: the right number of paths, errors as small as the bounds allow, and nothing where there is nothing."""

from dataclasses import replace

import numpy as np
import pytest

from tests.dbd.loops import noise, small
from tmca.dbd import Channel, Problem, simulate, solve
from tmca.dbd.noise import noise_level, selected


@pytest.mark.parametrize("seed", [0, 2, 3])
def test_at_20_db_the_order_is_right_and_errors_are_a_few_bounds(seed):
    problem = simulate(M=13, P=9, J=3, targets=2, paths=2, snr_db=20, seed=seed)
    recovery = solve(problem)
    assert (recovery.exact, recovery.certificate) == (False, None)
    assert recovery.sigma == problem.sigma
    assert recovery.residual == pytest.approx(0.1, rel=0.2)
    for one in recovery.score().sources:
        assert one.right_number
        assert one.waveform_correlation > 0.99
        assert set(one.errors) == set(one.bounds) == {"delay", "doppler"}
        for axis, errors in one.errors.items():
            assert np.all(one.bounds[axis] > 0)
            assert np.all(errors < 5 * one.bounds[axis])


def test_block_messages_in_noise_have_relative_dopplers_and_bounds():
    settings = {"messages": "block", "basis": "gaussian", "snr_db": 20, "amplitudes": (0.5, 1.0)}
    problem = simulate(M=13, P=4, J=1, targets=1, paths=2, seed=1, **settings)
    recovery = solve(problem)
    link, score = recovery["communications"], recovery.score()
    reference = int(np.argmax(np.abs(link.amplitudes)))
    assert [one.right_number for one in score.sources] == [True, True]
    assert link.points[reference, 1] == 0
    assert link.bounds[reference, 1] == 0
    assert link.bounds[1 - reference, 1] > 0
    assert np.all(score.sources[1].errors["delay"] < 5 * score.sources[1].bounds["delay"])
    assert np.all(score.sources[1].errors["doppler"] < 5 * link.bounds[1 - reference, 1])


@pytest.mark.parametrize("seed", [0, 2])
def test_an_unknown_noise_level_is_estimated(seed):
    problem = simulate(M=13, P=9, J=3, targets=2, paths=2, snr_db=20, seed=seed)
    recovery = solve(replace(problem, sigma=None))
    assert recovery.sigma == pytest.approx(problem.sigma, rel=0.15)
    assert [one.right_number for one in recovery.score().sources] == [True, True]


def test_samples_without_noise_are_taken_for_what_they_are():
    problem = simulate(M=9, P=5, J=2, targets=1, paths=1, seed=2)
    recovery = solve(replace(problem, sigma=None))
    assert recovery.exact
    assert recovery.sigma == 0
    assert recovery.score().success


def test_in_pure_noise_nothing_is_found():
    sources = small("shared").sources
    found = [solve(Problem(noise(np.random.default_rng(seed), 5, 7), sources, 1.0)).found for seed in range(12)]
    assert sum(found) <= 1


def test_noise_alone_passes_its_level_once_in_twenty_draws():
    problem, rng = small("shared"), np.random.default_rng(5)
    level = noise_level(problem)
    places = [(i / 28, k / 20, 0) for i in range(28) for k in range(20)]
    waves = np.array([np.outer(np.exp(2j * np.pi * np.arange(5) * nu), np.exp(2j * np.pi * np.arange(7) * tau)).ravel()
                      for tau, nu, _ in places])  # fmt: skip
    passed = 0
    for _ in range(300):
        q = noise(rng, 35)
        sums = [waves @ (source.rows.reshape(35, -1).conj() * q[:, None]) for source in problem.sources]
        passed += max(np.linalg.norm(one, axis=1).max() for one in sums) > level
    assert 2 <= passed <= 36


def nearly_true(problem, extra=(), missing=0):
    """The true channels, less some paths and with more of little strength."""
    radar, link = (Channel.true(*pair, problem.shape) for pair in zip(problem.sources, problem.truth, strict=True))
    positions = np.vstack([radar.positions[missing:], *([x] for x in extra)])
    gains = np.append(radar.amplitudes[missing:], [0.02] * len(extra))
    return [replace(radar, positions=positions, amplitudes=gains), link]


@pytest.mark.parametrize(("extra", "missing"), [((), 0), (((0.5, 0.5), (0.21, 0.9)), 0), ((), 1)])
def test_paths_too_many_go_and_paths_too_few_come(extra, missing):
    problem = simulate(M=11, P=6, J=2, targets=3, paths=1, snr_db=20, seed=4)
    found = selected(nearly_true(problem, extra, missing), problem.y, problem.sigma)
    assert [len(one) for one in found] == [3, 1]
    for x in problem.truth[0].points[:, :2]:
        assert np.abs((found[0].positions - x + 0.5) % 1 - 0.5).max(-1).min() < 0.01
