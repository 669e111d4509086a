"""From lifted weights to gains and one waveform, and the bounds on what noise leaves of them."""

import numpy as np
import pytest

from tests.dbd.loops import noise, samples, slopes, small
from tmca.dbd import Truth, simulate
from tmca.dbd.atoms.atoms import Atoms
from tmca.dbd.atoms.measure import Measure
from tmca.dbd.estimates.channels import Channel, split
from tmca.dbd.estimates.structured import bounds, fit, jacobian, residual
from tmca.dbd.signals.bases import unit_vector

AXES = ("delay", "doppler", "angle")
KINDS = ["shared", "even", "block", "three pulses a symbol", "antennas", "antennas, block", "one pulse"]


def true_channels(problem):
    found = []
    for source, truth in zip(problem.sources, problem.truth, strict=True):
        atoms = Atoms(source, problem.shape, every_axis=True)
        points = truth.points[:, [AXES.index(axis) for axis in atoms.axes]]
        found.append(Channel(atoms, points.copy(), truth.amplitudes.copy(), truth.waveform.copy()))
    return found


def truths(channels):
    return [Truth(np.nan_to_num(one.full_points()), one.amplitudes, one.waveform) for one in channels]


def slow_signal(channels):
    return samples(channels[0].atoms.shape, [one.atoms.source for one in channels], truths(channels)).reshape(-1)


def parameters(channels):
    """Positions, then gains and waveforms with their real parts first."""
    values = np.concatenate([np.concatenate([one.amplitudes, one.waveform]) for one in channels])
    return np.concatenate([*(one.points.reshape(-1) for one in channels), values.real, values.imag])


def with_parameters(channels, vector):
    places = sum(one.points.size for one in channels)
    real, imaginary = np.split(vector[places:], 2)
    found, place, value = [], 0, 0
    for one in channels:
        count, end = len(one.points), value + len(one.points) + one.waveform.size
        points = vector[place : place + one.points.size].reshape(one.points.shape)
        numbers = (real + 1j * imaginary)[value:end]
        found.append(Channel(one.atoms, points, numbers[:count], numbers[count:]))
        place, value = place + one.points.size, end
    return found


def slow_jacobian(channels):
    found = slopes(lambda x: slow_signal(with_parameters(channels, x)), parameters(channels))
    return np.vstack([found.real, found.imag])


@pytest.mark.parametrize("kind", KINDS)
def test_a_channel_is_the_model_of_the_thesis(kind):
    problem = small(kind)
    channels = true_channels(problem)
    np.testing.assert_allclose(sum(one.signal() for one in channels), problem.y.reshape(-1), atol=1e-12)
    np.testing.assert_allclose(residual(channels, problem.y), 0, atol=1e-12)


@pytest.mark.parametrize("kind", ["shared", "block", "antennas"])
def test_the_split_of_rank_one_weights_is_exact(kind):
    problem, rng = small(kind), np.random.default_rng(0)
    measure, made = Measure.empty(problem), []
    for index, atoms in enumerate(measure.atoms):
        gains, waveform = noise(rng, 3 - index), unit_vector(rng, atoms.size)
        measure.add(index, rng.random((len(gains), len(atoms.axes))))
        measure.weights[index] = np.outer(gains, waveform)
        made.append((gains, waveform))
    for one, (gains, waveform) in zip(split(problem, measure), made, strict=True):
        assert np.linalg.norm(one.waveform) == pytest.approx(1)
        largest = one.waveform[np.argmax(np.abs(one.waveform))]
        assert largest.real > 0
        assert largest.imag == pytest.approx(0, abs=1e-12)
        np.testing.assert_allclose(np.outer(one.amplitudes, one.waveform), np.outer(gains, waveform), atol=1e-12)


def test_dopplers_hidden_in_block_messages_come_out_relative_to_the_strongest_path():
    problem, rng = small("block", paths=2), np.random.default_rng(1)
    measure, dopplers, gains = Measure.empty(problem), np.array([0.82, 0.31, 0.4]), np.array([0.5, 2j, -1.0])
    waveform = unit_vector(rng, 10).reshape(5, 2)
    ramps = np.exp(-2j * np.pi * dopplers[:, None] * np.arange(5))
    delays = rng.random((3, 1))
    measure.add(1, delays)
    measure.weights[1] = (gains[:, None, None] * ramps[..., None] * waveform).reshape(3, -1)
    radar, link = split(problem, measure)
    assert len(radar.points) == 0
    np.testing.assert_allclose(link.points[:, 0], delays[:, 0])
    np.testing.assert_allclose(link.points[:, 1], [0.51, 0.0, 0.09], atol=1e-9)
    np.testing.assert_allclose(link.signal(), measure.y - measure.residual(), atol=1e-9)
    np.testing.assert_allclose(np.abs(link.amplitudes), np.abs(gains))


@pytest.mark.parametrize("kind", ["shared", "block", "antennas"])
def test_normalising_changes_no_sample(kind):
    channels = true_channels(small(kind, paths=2, amplitudes=(0.5, 2.0)))
    for one in channels:
        one.waveform = 3j * one.waveform
        normal = one.normalised()
        np.testing.assert_allclose(normal.signal(), one.signal(), atol=1e-11)
        assert np.linalg.norm(normal.waveform) == pytest.approx(1)


@pytest.mark.parametrize("kind", KINDS)
def test_the_jacobian_is_finite_differences(kind):
    channels = true_channels(small(kind))
    found, positions = jacobian(channels)
    assert positions == sum(one.points.size for one in channels)
    np.testing.assert_allclose(found, slow_jacobian(channels), atol=1e-6)


def test_a_silent_source_has_no_slopes():
    channels = true_channels(small("shared"))
    channels[1].points, channels[1].amplitudes = np.zeros((0, 2)), np.zeros(0, complex)
    found, positions = jacobian(channels)
    assert positions == 4
    np.testing.assert_allclose(found, slow_jacobian(channels), atol=1e-6)
    assert bounds(channels, 0.1)[1].shape == (0, 2)


@pytest.mark.parametrize("kind", KINDS)
def test_a_fit_from_nearby_comes_home(kind):
    problem, rng = small(kind, paths=2), np.random.default_rng(2)
    channels = true_channels(problem)
    for one in channels:
        one.points = one.points + 0.05 * rng.uniform(-1, 1, one.points.shape) / one.atoms.counts
        one.waveform = one.waveform + 0.03 * noise(rng, one.waveform.size)
    assert np.linalg.norm(residual(fit(channels, problem.y, 60), problem.y)) < 1e-9 * np.linalg.norm(problem.y)


@pytest.mark.parametrize("kind", KINDS)
def test_bounds_are_those_of_the_whole_fisher_matrix(kind):
    channels = true_channels(small(kind, paths=2, amplitudes=(0.5, 1.0)))
    channels[1].amplitudes[1] *= 3  # so that Dopplers do not count from the first path
    slope = slow_jacobian(channels)
    covariance = np.linalg.pinv(2 / 0.1**2 * slope.T @ slope, rcond=1e-9)
    start = 0
    for one, found in zip(channels, bounds(channels, 0.1), strict=True):
        for path, axis in np.ndindex(*one.points.shape):
            asked = np.zeros(len(covariance))
            asked[start + path * one.points.shape[1] + axis] = 1
            if one.atoms.axes[axis] == "doppler" and not one.atoms.source.sees_doppler:
                reference = int(np.argmax(np.abs(one.amplitudes)))
                asked[start + reference * one.points.shape[1] + axis] -= 1
            assert found[path, axis] == pytest.approx(np.sqrt(asked @ covariance @ asked), rel=1e-4, abs=1e-12)
        start += one.points.size


def test_bounds_grow_with_the_noise_and_not_with_the_unit():
    channels = true_channels(small("shared"))
    found = bounds(channels, 0.1)
    for one, twice in zip(found, bounds(channels, 0.2), strict=True):
        assert one.min() > 0
        np.testing.assert_allclose(twice, 2 * one)
    for one in channels:
        one.amplitudes = 1e-8 * one.amplitudes
    for one, other in zip(found, bounds(channels, 1e-9), strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-6)


def test_a_delay_that_the_waveform_can_take_upon_itself_has_no_bound():
    """J = M: any delay of a single path is a change of the message."""
    problem = simulate(M=5, P=4, J=5, targets=0, paths=1, basis="gaussian", messages="block")
    assert np.all(np.isinf(bounds(true_channels(problem), 0.1)[0][:, 0]))
    shared = simulate(M=5, P=4, J=5, targets=0, paths=1, basis="gaussian", messages="shared")
    assert np.all(np.isfinite(bounds(true_channels(shared), 0.1)[0]))


def test_relative_dopplers_may_count_from_any_path():
    problem = small("block", paths=3, separation=0.1)
    channels = true_channels(problem)
    second, third = (bounds(channels, 0.1, (None, path))[1] for path in (1, 2))
    assert (second[1, 1], third[2, 1]) == (0, 0)
    assert second[2, 1] == pytest.approx(third[1, 1])  # of their difference, from either end
    np.testing.assert_allclose(second[:, 0], third[:, 0], rtol=1e-6)


def test_one_path_of_a_known_signal_has_the_bounds_of_the_textbook():
    problem = simulate(M=15, P=8, J=1, targets=1, paths=0, basis="sign", known_waveforms=True)
    found = bounds(true_channels(problem), 0.2)[0][0]
    power = np.abs(problem.sources[0].rows[0, 0, 0]) ** 2
    spread = [np.sum((np.arange(size) - (size - 1) / 2) ** 2) / size for size in (15, 8)]
    expected = 0.2 / np.sqrt(2 * power * 15 * 8 * np.array(spread)) / (2 * np.pi)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("kind", ["shared", "block"])
def test_least_squares_reaches_the_bounds(kind):
    problem, rng, sigma = small(kind, paths=2, amplitudes=(0.5, 1.0)), np.random.default_rng(3), 2e-3
    channels = true_channels(problem)
    start = [one.normalised() for one in channels]
    errors = []
    for _ in range(60):
        found = fit(start, problem.y + sigma * noise(rng, *problem.shape))
        pairs = zip(found, start, strict=True)
        errors.append(np.concatenate([((a.points - b.points + 0.5) % 1 - 0.5).reshape(-1) for a, b in pairs]))
    spread = np.sqrt(np.mean(np.square(errors), axis=0))
    expected = np.concatenate([one.reshape(-1) for one in bounds(start, sigma)])
    known = expected > 0
    assert known.sum() == known.size - (kind == "block")
    np.testing.assert_allclose(spread[known] / expected[known], 1, atol=0.35)
    np.testing.assert_allclose(spread[~known], 0, atol=1e-12)
