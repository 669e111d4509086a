"""Errors are measured on the torus, path by path, and up to what no receiver can know."""

import numpy as np
import pytest

from tests.dbd.loops import small
from tmca.dbd import Channel, Problem, score
from tmca.dbd.atoms import Atoms
from tmca.errors import SettingError


def found(problem, shift=0.0, order=None, **changes):
    """The truth as a recovery, in another order, with Dopplers and messages turned by a shift."""
    sources = []
    for source, truth in zip(problem.sources, problem.truth, strict=True):
        order_ = list(range(len(truth.points)))[:: -1 if order == "reversed" else 1]
        points, waveform = truth.points[order_].copy(), truth.waveform
        if not source.sees_doppler:
            points[:, 1] = (points[:, 1] + shift) % 1
            waveform = waveform.reshape(source.messages, -1) * np.exp(
                2j * np.pi * shift * np.arange(source.messages)[:, None]
            )
        entry = {
            "positions": points[:, :2],
            "amplitudes": truth.amplitudes[order_],
            "waveform": 2j * np.ravel(waveform),
        }
        sources.append(Channel(Atoms(source, problem.shape, True), **(entry | changes.get(source.name, {}))))
    return sources


@pytest.mark.parametrize("kind", ["shared", "block"])
def test_the_truth_scores_in_any_order_scale_and_phase(kind):
    problem = small(kind, paths=2)
    for order in (None, "reversed"):
        result = score(found(problem, order=order), problem)
        assert result.success
        assert result.max_error < 1e-12
        assert [one.waveform_correlation for one in result.sources] == [pytest.approx(1)] * 2
        assert set(result.sources[0].errors) == {"delay", "doppler"}


def test_a_common_doppler_of_block_messages_does_not_count():
    problem = small("block", paths=2)
    result = score(found(problem, shift=0.7), problem)
    assert result.success
    assert result.sources[1].waveform_correlation == pytest.approx(1)


def test_a_relative_doppler_does_count():
    problem = small("block", paths=2)
    wrong = problem.truth[1].points[:, :2] + np.array([[0, 0.02], [0, 0]])
    result = score(found(problem, communications={"positions": wrong}), problem)
    assert not result.success
    reference = result.sources[1].reference
    assert result.sources[1].errors["doppler"][reference] == 0
    assert result.sources[1].errors["doppler"][1 - reference] == pytest.approx(0.02)
    assert result.sources[0].reference is None


def test_errors_go_the_shorter_way_around():
    problem = small("shared")
    truth = problem.truth[0].points
    wrong = truth[:, :2] + [-0.97, 0.999]
    result = score(found(problem, radar={"positions": wrong}), problem, tolerance=0.05)
    assert result.success
    np.testing.assert_allclose(result.sources[0].errors["delay"], 0.03, atol=1e-12)
    np.testing.assert_allclose(result.sources[0].errors["doppler"], 0.001, atol=1e-12)
    assert not score(found(problem, radar={"positions": wrong}), problem, tolerance=0.02).success


def test_a_wrong_number_of_paths_fails():
    problem = small("shared")
    fewer = {"positions": problem.truth[0].points[:1, :2], "amplitudes": problem.truth[0].amplitudes[:1]}
    none = {"positions": np.zeros((0, 2)), "amplitudes": np.zeros(0)}
    for change in (fewer, none):
        result = score(found(problem, radar=change), problem)
        assert not result.success
        assert result.max_error == np.inf
        assert [one.right_number for one in result.sources] == [False, True]
        assert result.sources[1].max_error < 1e-12


def test_bounds_come_in_the_order_of_the_errors():
    problem = small("shared")
    points = problem.truth[0].points[::-1, :2] + np.array([[0.01, 0], [0.03, 0]])
    limits = np.array([[1.0, 2.0, np.nan], [3.0, 4.0, np.nan]])
    one = score(found(problem, radar={"positions": points, "bounds": limits}), problem).sources[0]
    pairs = dict(zip(np.round(one.errors["delay"], 6).tolist(), one.bounds["delay"].tolist(), strict=True))
    assert pairs == {0.01: 1.0, 0.03: 3.0}


def test_without_truth_there_is_no_score():
    problem = small("shared")
    blind = Problem(problem.y, problem.sources, 0.0)
    with pytest.raises(SettingError, match="no truth, expected a simulated problem"):
        score(found(problem), blind)
