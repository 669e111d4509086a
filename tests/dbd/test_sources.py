"""What a source is, and sources, problems and truths that make no sense."""

import numpy as np
import pytest

from tests.dbd.loops import noise
from tmca.dbd import Problem, Source, Truth
from tmca.errors import SettingError, ShapeError

ROWS = noise(np.random.default_rng(0), 5, 7, 2)


SPOILT = ROWS.copy()
SPOILT[3, 3, 1] = np.inf
TWICE = np.concatenate([ROWS, ROWS[..., :1]], axis=2)
SILENT = ROWS * (np.arange(5) != 3)[:, None, None]
SAME = [0] * 5


def test_one_basis_serves_all_pulses():
    source = Source("radar", ROWS[0], np.zeros(5))
    assert source.rows.shape == (5, 7, 2)
    assert (source.messages, source.subspace, source.unknowns) == (1, 2, 2)
    np.testing.assert_array_equal(source.rows[3], ROWS[0])


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


@pytest.mark.parametrize(
    ("error", "where", "given"),
    [
        (ShapeError, "basis of x", (ROWS[0, :, 0], SAME)),
        (ShapeError, "basis of x", (ROWS[..., :0], SAME)),
        (SettingError, "basis of x", (SPOILT, SAME)),
        (SettingError, "basis of x", (TWICE, SAME)),
        (SettingError, "basis of x", (TWICE[0], SAME)),
        (SettingError, "basis of x, message 3", (SILENT, range(5))),
        *((SettingError, "messages of x", (ROWS, one)) for one in
          [(1, 1, 1, 1, 1), (0, 2, 2, 2, 2), (0, 1, 0, 1, 2), (-1, 0, 0, 0, 0), (0, 0.5, 1, 1, 1)]),
        (ShapeError, "messages of x", (ROWS, [0] * 4)),
        *((SettingError, "weight of x", (ROWS, SAME, one)) for one in (0.0, -1.0, np.nan, np.inf)),
    ],
)  # fmt: skip
def test_impossible_sources_are_refused(error, where, given):
    with pytest.raises(error) as caught:
        Source("x", *given)
    assert caught.value.where == where


@pytest.mark.parametrize("shape", [(35,), (5, 7), (1, 5, 7)])
def test_samples_may_come_as_a_vector_a_matrix_or_with_antennas(shape):
    y = noise(np.random.default_rng(2), *shape)
    problem = Problem(y, (Source("x", ROWS, [0] * 5),))
    assert problem.shape == (1, 5, 7)
    np.testing.assert_array_equal(problem.y.reshape(-1), y.reshape(-1))


@pytest.mark.parametrize(
    ("error", "where", "changed"),
    [
        *((ShapeError, "y", {"y": np.ones(shape)}) for shape in [(7, 5), (34,), (3, 7, 5), (2, 1, 5, 7), ()]),
        (ShapeError, "basis of b", {"sources": (Source("a", ROWS, SAME), Source("b", ROWS[:4], [0] * 4))}),
        (SettingError, "sources", {"sources": ()}),
        (SettingError, "sources", {"sources": (Source("a", ROWS, SAME), Source("a", ROWS, SAME))}),
        (SettingError, "y", {"y": SPOILT[..., 1]}),
        *((SettingError, "sigma", {"sigma": one}) for one in (-0.1, np.nan, np.inf)),
        (ShapeError, "truth", {"truth": ()}),
    ],
)
def test_impossible_problems_are_refused(error, where, changed):
    with pytest.raises(error) as caught:
        Problem(**{"y": np.ones((5, 7)), "sources": (Source("a", ROWS, SAME),), **changed})
    assert caught.value.where == where


@pytest.mark.parametrize(
    ("error", "where", "points"),
    [(ShapeError, "points of the truth", np.zeros((1, 2))), (SettingError, "truth", np.full((1, 3), np.nan))],
)
def test_impossible_truths_are_refused(error, where, points):
    with pytest.raises(error) as caught:
        Truth(points, np.ones(1), np.ones(2))
    assert caught.value.where == where
