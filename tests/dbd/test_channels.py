"""From lifted weights to gains and one waveform, and the bounds on what noise leaves of them."""

from dataclasses import replace

import numpy as np
import pytest

from tests.dbd.loops import lifted, noise, samples, slopes, small
from tmca.dbd import Channel, Truth, simulate
from tmca.dbd.channel import fit, no_paths, normal_equations, relative_residual, residual
from tmca.dbd.noise import bounds
from tmca.dbd.simulation import unit_vector

KINDS = ["shared", "even", "block", "three pulses a symbol", "antennas", "antennas, block", "one pulse"]


def true_channels(problem):
    pairs = zip(problem.sources, problem.truth, strict=True)
    return [Channel.true(*pair, problem.shape) for pair in pairs]


def slow_signal(channels):
    truth = [Truth(np.nan_to_num(one.points), one.amplitudes, one.waveform) for one in channels]
    return samples(channels[0].atoms.shape, [one.atoms.source for one in channels], truth).reshape(-1)


def slow_jacobian(channels):
    """By real parts and imaginary parts of gains and waveforms, then by positions."""
    sizes = [len(one) + one.waveform.size for one in channels]
    moves = [one.positions.size for one in channels]

    def signal(step):
        real, imaginary, shift = np.split(step, [sum(sizes), 2 * sum(sizes)])
        changes = np.split(real + 1j * imaginary, np.cumsum(sizes)[:-1])
        shifts = np.split(shift, np.cumsum(moves)[:-1])
        return slow_signal([one.moved(*both) for one, *both in zip(channels, shifts, changes, strict=True)])

    found = slopes(signal, np.zeros(2 * sum(sizes) + sum(moves)))
    return np.vstack([found.real, found.imag])


@pytest.mark.parametrize("kind", KINDS)
def test_a_channel_is_the_model_of_the_thesis(kind):
    problem = small(kind)
    np.testing.assert_allclose(residual(true_channels(problem), problem.y), 0, atol=1e-12)


@pytest.mark.parametrize("kind", ["shared", "block", "antennas"])
def test_the_structure_of_rank_one_weights_is_exact(kind):
    problem, rng = small(kind), np.random.default_rng(0)
    for index, empty in enumerate(no_paths(problem)):
        gains, waveform = noise(rng, 3 - index), unit_vector(rng, empty.atoms.size)
        weights = np.outer(gains, waveform)
        one = Channel.from_weights(empty.atoms, rng.random((len(gains), len(empty.atoms.axes))), weights).structured()
        assert np.linalg.norm(one.waveform) == pytest.approx(1)
        largest = one.waveform[np.argmax(np.abs(one.waveform))]
        assert largest.real > 0
        assert largest.imag == pytest.approx(0, abs=1e-12)
        np.testing.assert_allclose(one.weights, weights, atol=1e-12)


def test_dopplers_hidden_in_block_messages_come_out_relative_to_the_strongest_path():
    problem, rng = small("block", paths=2), np.random.default_rng(1)
    dopplers, gains = np.array([0.82, 0.31, 0.4]), np.array([0.5, 2j, -1.0])
    waveform = unit_vector(rng, 10).reshape(5, 2)
    ramps = np.exp(-2j * np.pi * dopplers[:, None] * np.arange(5))
    delays = rng.random((3, 1))
    weights = (gains[:, None, None] * ramps[..., None] * waveform).reshape(3, -1)
    channels = lifted(problem, (np.zeros((0, 2)), delays), (np.zeros((0, 2)), weights))
    radar, link = [one.structured() for one in channels]
    assert len(radar) == 0
    np.testing.assert_allclose(link.positions[:, 0], delays[:, 0])
    np.testing.assert_allclose(link.positions[:, 1], [0.51, 0.0, 0.09], atol=1e-9)
    np.testing.assert_allclose(link.samples(), channels[1].samples(), atol=1e-9)
    np.testing.assert_allclose(np.abs(link.amplitudes), np.abs(gains))


@pytest.mark.parametrize("kind", [*KINDS, "silent"])
def test_normal_equations_are_those_of_finite_differences(kind):
    problem = small("shared" if kind == "silent" else kind)
    channels = true_channels(problem)
    if kind == "silent":
        channels[1] = channels[1].taken(np.zeros(len(channels[1]), bool))
        assert bounds(channels, 0.1)[1].shape == (0, 2)
    y = problem.y + noise(np.random.default_rng(0), *problem.shape)
    slope, left = slow_jacobian(channels), residual(channels, y)
    curvature, gradient = normal_equations(channels, left)
    np.testing.assert_allclose(curvature, slope.T @ slope, atol=1e-6 * np.abs(curvature).max())
    expected = -slope.T @ np.concatenate([left.real, left.imag])
    np.testing.assert_allclose(gradient, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("kind", KINDS)
def test_a_fit_from_nearby_comes_home(kind):
    problem, rng = small(kind, paths=2), np.random.default_rng(2)
    channels = []
    for one in true_channels(problem):
        positions = one.positions + 0.05 * rng.uniform(-1, 1, one.positions.shape) / one.atoms.counts
        waveform = one.waveform + 0.03 * noise(rng, one.waveform.size)
        channels.append(replace(one, positions=positions, waveform=waveform))
    assert relative_residual(fit(channels, problem.y, 60), problem.y) < 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_bounds_are_those_of_the_whole_fisher_matrix(kind):
    channels = true_channels(small(kind, paths=2, amplitudes=(0.5, 1.0)))
    gains = channels[1].amplitudes * [1, 3]  # so that Dopplers do not count from the first path
    channels[1] = replace(channels[1], amplitudes=gains)
    slope = slow_jacobian(channels)
    covariance = np.linalg.pinv(2 / 0.1**2 * slope.T @ slope, rcond=1e-9)
    start = slope.shape[1] - sum(one.positions.size for one in channels)
    for one, found in zip(channels, bounds(channels, 0.1), strict=True):
        for path, axis in np.ndindex(*one.positions.shape):
            asked = np.zeros(len(covariance))
            asked[start + path * one.positions.shape[1] + axis] = 1
            if one.atoms.axes[axis] == "doppler" and not one.atoms.source.sees_doppler:
                asked[start + one.strongest * one.positions.shape[1] + axis] -= 1
            assert found[path, axis] == pytest.approx(np.sqrt(asked @ covariance @ asked), rel=1e-4, abs=1e-12)
        start += one.positions.size


def test_a_delay_that_the_waveform_can_take_upon_itself_has_no_bound():
    """J = M: any delay of a single path is a change of the message."""
    problem = simulate(M=5, P=4, J=5, targets=0, paths=1, basis="gaussian", messages="block")
    assert np.all(np.isinf(bounds(true_channels(problem), 0.1)[0][:, 0]))
    shared = simulate(M=5, P=4, J=5, targets=0, paths=1, basis="gaussian", messages="shared")
    assert np.all(np.isfinite(bounds(true_channels(shared), 0.1)[0]))


@pytest.mark.parametrize("kind", ["shared", "block"])
def test_least_squares_reaches_the_bounds(kind):
    problem, rng, sigma = small(kind, paths=2, amplitudes=(0.5, 1.0)), np.random.default_rng(3), 2e-3
    channels = true_channels(problem)
    start = [one.normalised() for one in channels]
    errors = []
    for _ in range(60):
        found = fit(start, problem.y + sigma * noise(rng, *problem.shape))
        pairs = zip(found, start, strict=True)
        errors.append(np.concatenate([((a.positions - b.positions + 0.5) % 1 - 0.5).reshape(-1) for a, b in pairs]))
    spread = np.sqrt(np.mean(np.square(errors), axis=0))
    expected = np.concatenate([one.reshape(-1) for one in bounds(start, sigma)])
    known = expected > 0
    assert known.sum() == known.size - (kind == "block")
    np.testing.assert_allclose(spread[known] / expected[known], 1, atol=0.35)
    np.testing.assert_allclose(spread[~known], 0, atol=1e-12)
