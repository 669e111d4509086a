"""Unwrapping: over frequencies at every pixel on its own, over neighbours where surfaces hang together."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tmca.errors import DataError, SettingError
from tmca.lab.ground_truth.phase import Phases, graph_cut_unwrap, ladder, spatial_unwrap, temporal_unwrap, wrapped

TURN = 2 * np.pi


def phases_of(share, fringes, std=0.01, noise=0.0, seed=0):
    """Phases of positions given as shares of the projector's extent."""
    rng = np.random.default_rng(seed)
    phase = np.stack([wrapped(TURN * f * share) for f in fringes])
    phase = wrapped(phase + noise * rng.standard_normal(phase.shape))
    ones = np.ones_like(phase)
    return Phases(phase, 100 * ones, 100 * ones, 0 * ones, 1.0, std * ones)


@settings(max_examples=30, deadline=None)
@given(
    fringes=st.sampled_from([(1,), (1, 4, 16, 64), (1, 3, 9), (59, 64, 70), (15, 16), (1, 50)]),
    seed=st.integers(0, 999),
)
def test_the_position_comes_back_at_every_pixel_alone(fringes, seed):
    share = np.random.default_rng(seed).uniform(0.001, 0.999, (5, 6))
    found, disagreement, _ = temporal_unwrap(phases_of(share, fringes), fringes)
    assert np.allclose(found, TURN * fringes[-1] * share)
    assert disagreement.max() < 1e-3


def test_noise_below_the_limit_numbers_no_fringe_wrongly():
    share, fringes = np.random.default_rng(1).uniform(0.01, 0.99, (60, 61)), (1, 4, 16, 64)
    found, _, risk = temporal_unwrap(phases_of(share, fringes, 0.15, 0.15), fringes)
    assert risk[0, 0] == pytest.approx(0.15 * np.sqrt(17))
    assert np.abs(found - TURN * 64 * share).max() < 6 * 0.15


def test_the_temporal_phase_is_the_best_of_all_positions():
    fringes = (1, 3, 8)
    share = np.random.default_rng(2).uniform(0.02, 0.98, (4, 5))
    phases = phases_of(share, fringes, 0.1, 0.1)
    found, _, _ = temporal_unwrap(phases, fringes)
    places = np.linspace(0, 1, 20001)
    for y, x in product(range(4), range(5)):
        cost = sum(wrapped(phases.phase[i, y, x] - TURN * f * places) ** 2 for i, f in enumerate(fringes))
        # the finest fringes say where within a fringe, the others only which
        assert abs(found[y, x] / (TURN * 8) - places[np.argmin(cost)]) < 0.02


def test_frequencies_that_tell_different_phases_disagree():
    phases = phases_of(np.full((2, 2), 0.3), (1, 4))
    phases.phase[1, 0, 0] += 1.0
    _, disagreement, _ = temporal_unwrap(phases, (1, 4))
    assert disagreement[0, 0] > 4 > 1 > disagreement[1, 1]


def test_beats_lead_to_one_fringe():
    rungs = ladder((59, 64, 70))
    assert [count for count, _ in rungs] == [1, 5, 6, 59, 64, 70]
    assert rungs[0][1].tolist() == [1, -2, 1]


@pytest.mark.parametrize("fringes", [(2,), (4, 16, 64), (10, 20)])
def test_fringes_that_do_not_lead_to_one_are_refused(fringes):
    with pytest.raises(SettingError, match="fringes that lead to one"):
        ladder(fringes)


@pytest.mark.parametrize("how", ["spatial", "graph-cut"])
@pytest.mark.parametrize("size", [(20, 21), (25, 24)])
def test_neighbours_unwrap_a_smooth_surface_with_too_few_frequencies_for_time(how, size):
    y, x = np.mgrid[: size[0], : size[1]] / max(size)
    share = 0.2 + 0.5 * x + 0.1 * np.sin(3 * y)
    phases = phases_of(share, (1, 12), 0.2, 0.2)
    found = spatial_unwrap(phases, (1, 12), np.ones(size, bool), how)
    assert np.abs(found - TURN * 12 * share).max() < 6 * 0.2


@pytest.mark.parametrize("how", ["spatial", "graph-cut"])
def test_each_region_gets_its_own_number_of_fringes(how):
    share = np.full((12, 20), 0.2)
    share[:, 10:] = 0.7
    inside = np.ones(share.shape, bool)
    inside[:, 9:11] = False
    found = spatial_unwrap(phases_of(share, (1, 9)), (1, 9), inside, how)
    assert np.allclose(found[inside], TURN * 9 * share[inside])
    assert np.isnan(found[~inside]).all()


def test_no_pixel_is_refused():
    with pytest.raises(DataError, match="no pixel with fringes"):
        spatial_unwrap(phases_of(np.ones((3, 3)) / 2, (1, 2)), (1, 2), np.zeros((3, 3), bool), "spatial")


@pytest.mark.parametrize("seed", range(4))
def test_graph_cuts_find_the_least_energy_of_all_whole_turns(seed):
    phase = np.random.default_rng(seed).uniform(-np.pi, np.pi, (2, 3))
    found = graph_cut_unwrap(phase, np.ones((2, 3), bool), phase, threshold=np.inf)

    def energy(values):
        return (np.diff(values, axis=0) ** 2).sum() + (np.diff(values, axis=1) ** 2).sum()

    best = min(energy(phase + TURN * np.reshape(k, (2, 3))) for k in product((-1, 0, 1), repeat=6))
    assert energy(found) == pytest.approx(best, rel=1e-3)
    assert np.allclose(wrapped(found - phase), 0, atol=1e-9)


def test_graph_cuts_of_a_ramp_are_numpys():
    ramp = np.linspace(0, 40, 41)
    found = graph_cut_unwrap(wrapped(ramp)[None], np.ones((1, 41), bool), wrapped(ramp)[None], np.inf)[0]
    assert np.allclose(found - found[0], np.unwrap(wrapped(ramp)) - wrapped(ramp)[0])


def test_a_wall_that_grows_is_kept_by_the_truncated_energy_and_bent_by_the_square():
    surface = np.zeros((40, 50))
    surface[:, 25:] = np.linspace(0, 3 * TURN, 40)[:, None]
    inside, bent = np.ones(surface.shape, bool), {}
    for threshold in (np.pi, np.inf):
        off = graph_cut_unwrap(wrapped(surface), inside, wrapped(surface), threshold) - surface
        bent[threshold] = max(np.ptp(off[:, :25]), np.ptp(off[:, 25:]))
    assert bent[np.pi] < 1e-6
    assert bent[np.inf] > 0.9 * TURN
