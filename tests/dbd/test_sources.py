"""A source or a problem that makes no sense is refused with what was found and what was expected."""

import numpy as np
import pytest

from tests.dbd.loops import noise, small
from tmca.dbd import Problem, Source, Truth
from tmca.errors import SettingError, ShapeError

ROWS = noise(np.random.default_rng(0), 5, 7, 2)


def refused(error, where, found, expected, call):
    with pytest.raises(error) as caught:
        call()
    text = str(caught.value)
    assert text.startswith(where)
    assert f"found {found}" in text
    assert f"expected {expected}" in text
    assert "\n" not in text


def test_one_basis_serves_all_pulses():
    source = Source("radar", ROWS[0], np.zeros(5))
    assert source.rows.shape == (5, 7, 2)
    assert (source.messages, source.subspace, source.unknowns) == (1, 2, 2)
    assert source.same_every_pulse
    assert not Source("link", ROWS, np.zeros(5)).same_every_pulse


@pytest.mark.parametrize(
    ("message", "count", "seen"), [((0, 0, 0, 0, 0), 1, True), ((0, 0, 0, 1, 1), 2, True), ((0, 1, 2, 3, 4), 5, False)]
)
def test_a_message_of_two_pulses_shows_the_doppler(message, count, seen):
    source = Source("link", ROWS, message)
    assert (source.messages, source.unknowns, source.sees_doppler) == (count, 2 * count, seen)


def test_a_signal_is_the_basis_times_the_message_of_its_pulse():
    source = Source("link", ROWS, (0, 0, 1, 1, 2))
    v = noise(np.random.default_rng(1), 6)
    expected = [[ROWS[p, n] @ v[2 * (p // 2) : 2 * (p // 2) + 2] for n in range(7)] for p in range(5)]
    np.testing.assert_allclose(source.signal(v), expected, atol=1e-14)


def test_impossible_bases_are_refused():
    spoilt = ROWS.copy()
    spoilt[1, 2, 0] = np.nan
    spoilt[3, 3, 1] = np.inf
    full = "(pulses, frequencies, subspace)"
    refused(ShapeError, "basis of x", "shape (7,)", full, lambda: Source("x", ROWS[0, :, 0], [0] * 5))
    refused(ShapeError, "basis of x", "shape (5, 7, 0)", full, lambda: Source("x", ROWS[..., :0], [0] * 5))
    refused(SettingError, "basis of x", "2 values that are NaN", "finite", lambda: Source("x", spoilt, [0] * 5))


def test_coefficients_that_do_not_show_are_refused():
    twice = np.concatenate([ROWS, ROWS[..., :1]], axis=2)
    refused(SettingError, "basis of x", "rank 2 in 35 x 3", "full column rank", lambda: Source("x", twice, [0] * 5))
    refused(SettingError, "basis of x", "rank 2 in 7 x 3", "full", lambda: Source("x", twice[0], [0] * 5))
    silent = ROWS.copy()
    silent[3] = 0
    refused(SettingError, "basis of x, message 3", "rank 0", "full", lambda: Source("x", silent, range(5)))
    Source("x", silent, [0] * 5)


@pytest.mark.parametrize("message", [(1, 1, 1, 1, 1), (0, 2, 2, 2, 2), (0, 1, 0, 1, 2), (-1, 0, 0, 0, 0)])
def test_messages_count_up_from_zero(message):
    refused(SettingError, "messages of x", str(list(message)), "0 for the first", lambda: Source("x", ROWS, message))


def test_every_pulse_has_a_message():
    refused(ShapeError, "messages of x", "4 numbers", "one for each of 5", lambda: Source("x", ROWS, [0] * 4))


@pytest.mark.parametrize("weight", [0.0, -1.0, float("nan"), float("inf")])
def test_weights_are_positive(weight):
    refused(SettingError, "weight of x", str(weight), "a positive", lambda: Source("x", ROWS, [0] * 5, weight))


@pytest.mark.parametrize("shape", [(35,), (5, 7), (1, 5, 7)])
def test_samples_may_come_as_a_vector_a_matrix_or_with_antennas(shape):
    y = noise(np.random.default_rng(2), *shape)
    problem = Problem(y, (Source("x", ROWS, [0] * 5),))
    assert problem.shape == (1, 5, 7)
    np.testing.assert_array_equal(problem.y.reshape(-1), y.reshape(-1))


@pytest.mark.parametrize("shape", [(7, 5), (34,), (3, 7, 5), (2, 1, 5, 7), ()])
def test_samples_of_another_lattice_are_refused(shape):
    source = Source("x", ROWS, [0] * 5)
    refused(ShapeError, "y", f"shape {shape}", "(5, 7) or 35 numbers", lambda: Problem(np.ones(shape), (source,)))


def test_sources_share_a_lattice():
    sources = Source("a", ROWS, [0] * 5), Source("b", ROWS[:4], [0] * 4)
    refused(ShapeError, "basis of b", "(4, 7)", "(5, 7) as a", lambda: Problem(np.ones((5, 7)), sources))
    refused(SettingError, "sources", "none", "at least one", lambda: Problem(np.ones((5, 7)), ()))


def test_samples_are_finite():
    problem = small("shared")
    y = problem.y.copy()
    y[0, 0, :3] = np.nan
    refused(SettingError, "y", "3 of 35 samples", "finite", lambda: Problem(y, problem.sources))


@pytest.mark.parametrize("sigma", [-0.1, float("nan"), float("inf")])
def test_noise_levels_are_not_negative(sigma):
    problem = small("shared")
    refused(SettingError, "sigma", str(sigma), "a standard dev", lambda: Problem(problem.y, problem.sources, sigma))


def test_sources_have_names_of_their_own():
    source = Source("radar", np.eye(4, 2), np.zeros(3, int))
    with pytest.raises(SettingError, match="sources: found radar, radar, expected a name of its own for each"):
        Problem(np.ones((3, 4)), (source, source))


def test_every_source_has_its_truth():
    problem = small("shared")
    truth = (Truth(np.zeros((0, 3)), np.zeros(0), np.ones(2)),)
    refused(ShapeError, "truth", "1", "one for each of 2", lambda: Problem(problem.y, problem.sources, truth=truth))
