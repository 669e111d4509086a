"""Coordinates that wrap around at 1, and what they are in metres, metres a second and degrees."""

from itertools import permutations

import numpy as np
import pytest

from tmca.dbd import Units
from tmca.dbd.model import distance, matched
from tmca.dbd.simulation import separated_points
from tmca.errors import SettingError


def way_around(a, b):
    return min(abs(a - b + turns) for turns in (-1, 0, 1))


def test_distances_broadcast():
    a, b = np.random.default_rng(0).random((2, 4))
    table = [[way_around(x, y) for y in b] for x in a]
    np.testing.assert_allclose(distance(a[:, None], b), table, atol=1e-15)


@pytest.mark.parametrize("separation", [(0.3,), (0.2, 0.4), (0.25, 0.5, 0.5)])
def test_any_two_points_are_apart_in_a_coordinate(separation):
    points = separated_points(np.random.default_rng(1), 3, separation)
    assert points.shape == (3, len(separation))
    for i, j in ((0, 1), (0, 2), (1, 2)):
        assert any(way_around(a, b) >= s for a, b, s in zip(points[i], points[j], separation, strict=True))


def test_more_points_than_fit_are_refused(monkeypatch):
    monkeypatch.setattr("tmca.dbd.simulation._TRIES", 200)
    with pytest.raises(SettingError) as caught:
        separated_points(np.random.default_rng(0), 3, (0.4,))
    assert caught.value.where == "separation"


@pytest.mark.parametrize("seed", range(6))
def test_no_other_pairs_are_nearer(seed):
    estimate, truth = np.random.default_rng(seed).random((2, 4, 2))

    def cost(order):
        pairs = zip(estimate, truth[list(order)], strict=True)
        return sum(max(way_around(a, b) for a, b in zip(x, z, strict=True)) for x, z in pairs)

    here, there = matched(estimate, truth)
    assert sorted(here) == sorted(there) == [0, 1, 2, 3]
    assert cost(there[np.argsort(here)]) == pytest.approx(min(cost(order) for order in permutations(range(4))))


def test_spare_points_stay_alone():
    here, there = matched(np.array([[0.1], [0.99], [0.5]]), np.array([[0.0], [0.52]]))
    assert dict(zip(here.tolist(), there.tolist(), strict=True)) == {1: 0, 2: 1}


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("name", ["radar", "communications"])
def test_deviations_are_slopes_times_deviations(axis, name):
    units, step, at = Units(3e-6, 2e5, 77e9, 0.6), 1e-5, np.array([0.21])
    ahead, behind = (units.physical(at + shift, axis, name) for shift in (step, -step))
    np.testing.assert_allclose(units.deviation(at, step, axis, name), (ahead - behind) / 2, rtol=1e-6)


def test_an_angle_of_thirty_degrees_is_half_a_spacing_of_turn():
    assert Units(1, 1, 1, 0.5).physical(np.array(0.25), 2, "radar") == pytest.approx(30)
