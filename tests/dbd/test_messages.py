"""What block messages hide, and what a late clock does."""

import warnings

import numpy as np
import pytest

from tests.dbd.loops import moved, noise, polynomial, samples, small
from tmca.dbd import Source, Truth, simulate, solve
from tmca.dbd.simulation import beyond_prefix, lagged
from tmca.errors import SettingError


def test_block_messages_take_any_doppler_upon_themselves_and_shared_ones_do_not():
    block, shared, turn = small("block", paths=2), small("shared", paths=2), 0.237
    radar, link = block.truth
    waveform = (link.waveform.reshape(5, 2) * np.exp(2j * np.pi * turn * np.arange(5))[:, None]).reshape(-1)
    other = moved(Truth(link.points, link.amplitudes, waveform), (0, turn, 0))
    np.testing.assert_allclose(samples(block.shape, block.sources, (radar, other)), block.y, atol=1e-12)
    radar, link = shared.truth
    turned = samples(shared.shape, shared.sources, (radar, moved(link, (0, turn, 0))))
    assert np.abs(turned - shared.y).max() > 0.1


@pytest.mark.parametrize(("kind", "varies"), [("block", False), ("shared", True), ("three pulses a symbol", True)])
def test_the_dual_polynomial_of_block_messages_is_a_ridge_along_the_doppler(kind, varies):
    problem = small(kind)
    q = noise(np.random.default_rng(0), *problem.shape)
    norms = [np.linalg.norm(polynomial(problem.sources[1], q, (0.3, nu, 0))) for nu in (0.0, 0.21, 0.5, 0.83)]
    assert (np.ptp(norms) > 1e-2) == varies
    assert np.ptp(norms) < 1e-12 or varies


def test_a_lag_nobody_knows_only_adds_to_the_delays():
    late = small("shared", paths=2, lag=0.17)
    on_time, (radar, link) = small("shared", paths=2).sources, late.truth
    other = moved(link, (0.17, 0, 0))
    np.testing.assert_allclose(samples(late.shape, on_time, (radar, other)), late.y, atol=1e-12)


@pytest.mark.parametrize("frequencies", [7, 8])
@pytest.mark.parametrize("late", [2, 3, 5])
@pytest.mark.parametrize("kind", ["shared", "block"])
def test_beyond_the_prefix_an_interval_still_hears_the_message_before(kind, late, frequencies):
    rng = np.random.default_rng(late)
    source = small(kind, M=frequencies).sources[1]
    before = noise(rng, frequencies, 2)
    received = beyond_prefix(source, before, late)
    shared = kind == "shared"
    v = noise(rng, 1 if shared else 6, 2)  # the message before the first interval comes first
    sent = [before @ v[0]] + [source.rows[p] @ v[0 if shared else p + 1] for p in range(5)]
    n = np.arange(frequencies) - frequencies // 2
    time = np.arange(frequencies)
    stream = np.concatenate([[np.sum(s * np.exp(2j * np.pi * n * t / frequencies)) for t in time] for s in sent])
    heard = []
    for p in range(5):
        window = stream[(p + 1) * frequencies - late : (p + 2) * frequencies - late]
        heard.append([np.sum(window * np.exp(-2j * np.pi * k * time / frequencies)) / frequencies for k in n])
    np.testing.assert_allclose(received.signal(v.reshape(-1)), heard, atol=1e-12)


def test_within_the_prefix_a_lag_of_samples_is_a_ramp():
    source = small("shared").sources[1]
    v = noise(np.random.default_rng(1), 2)
    in_time = np.fft.ifft(np.fft.ifftshift(source.signal(v), axes=1), axis=1)
    turned = np.fft.ifft(np.fft.ifftshift(lagged(source, 3 / 7).signal(v), axes=1), axis=1)
    np.testing.assert_allclose(turned, np.roll(in_time, 3, axis=1), atol=1e-13)


def test_late_messages_that_pulses_share_in_groups_are_refused():
    source = Source("link", noise(np.random.default_rng(0), 4, 5, 1), (0, 0, 1, 1))
    with pytest.raises(SettingError, match="messages of several pulses, expected shared or block"):
        beyond_prefix(source, np.ones((5, 1)), 2)


@pytest.mark.parametrize(("late", "columns"), [(0, 10), (1, 11), (4, 12), (6, 11), (7, 10)])
def test_of_a_block_message_that_is_heard_in_part_only_what_shows_counts(late, columns):
    source = small("block", basis="gaussian").sources[1]
    received = beyond_prefix(source, noise(np.random.default_rng(0), 7, 2), late)
    assert received.rows.shape == (5, 7, columns)  # six messages of two coefficients


def test_with_the_radar_known_fewer_samples_are_enough():
    asked = {"M": 7, "P": 4, "J": 5, "targets": 2, "paths": 1, "seed": 1, "basis": "gaussian", "separation": 0.25}
    known, blind = (simulate(**asked, known=one) for one in ("radar", None))
    assert [one.unknowns for one in known.sources] == [1, 5]
    assert known.truth[0].points.tolist() == blind.truth[0].points.tolist()
    assert solve(known, certify=False).score().success
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert not solve(blind, certify=False).score().success


def test_with_the_radar_known_gains_and_messages_are_least_squares_at_the_recovered_points():
    problem = simulate(M=9, P=5, J=2, targets=2, paths=1, seed=0, snr_db=20, known="radar")
    recovery = solve(problem)
    radar, link = recovery
    numbers = (np.arange(9) - 4, np.arange(5)[:, None])
    waves = [np.exp(-2j * np.pi * (numbers[0] * x[0] + numbers[1] * x[1])) for x in (*radar.points, *link.points)]
    sent = problem.sources[0].rows[..., 0]
    columns = [(sent * wave).ravel() for wave in waves[:2]]
    columns += [(problem.sources[1].rows[..., one] * waves[2]).ravel() for one in range(2)]
    numbers = np.linalg.lstsq(np.stack(columns, 1), problem.y.ravel(), rcond=None)[0]
    np.testing.assert_allclose(numbers[:2], radar.amplitudes * radar.waveform[0], atol=1e-5)
    np.testing.assert_allclose(numbers[2:], link.amplitudes[0] * link.waveform, atol=1e-5)


def test_only_transmitters_can_be_known():
    with pytest.raises(SettingError, match="one of radar, communications, both"):
        simulate(known="nobody")
