"""Patterns on imperfect devices, against exposures that are followed in time and pixels that are followed in space."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import affine_transform

from tmca.codes import leaked, misplaced, slot_overlap, through_time
from tmca.errors import ShapeError
from tmca.lab.calibration.registration import register

FINE = 2000


def aperture_at(time, patterns, switching):
    """(K, …) patterns of a device that repeats, at a time in slots."""
    slot = int(np.floor(time))
    share = 1.0 if switching == 0 else min((time - slot) / switching, 1.0)
    return share * patterns[slot % len(patterns)] + (1 - share) * patterns[(slot - 1) % len(patterns)]


def exposed(aperture, shutter, starts, ends, switching):
    """∫ T(t) S(t) dt of the slots as they run, step by step."""
    total = np.zeros_like(aperture[0])
    for pattern, start, end in zip(shutter, starts, ends, strict=True):
        for time in start + (np.arange(FINE) + 0.5) / FINE * (end - start):
            total += aperture_at(time, aperture, switching) * pattern * (end - start) / FINE
    return total


@pytest.mark.parametrize("slots", [1, 2, 5])
@pytest.mark.parametrize("switching", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("late", [0.0, 0.4, -0.7, 3.2])
def test_slots_that_run_into_each_other_record_what_time_says(slots, switching, late):
    rng = np.random.default_rng(slots)
    aperture, shutter = rng.random((slots, 3)), rng.random((slots, 3))
    starts = np.arange(slots) + late + 0.2 * rng.random(slots)
    ends = starts + 0.5 * rng.random(slots)
    overlap = slot_overlap(slots, torch.tensor(starts), torch.tensor(ends), switching).numpy()
    found = np.einsum("km,kp,mp->p", overlap, shutter, aperture)
    np.testing.assert_allclose(found, exposed(aperture, shutter, starts, ends, switching), atol=2e-3)


@settings(max_examples=40, deadline=None)
@given(
    slots=st.integers(1, 9),
    switching=st.floats(0, 1),
    starts=st.lists(st.floats(-9, 9), min_size=9, max_size=9),
    lasts=st.lists(st.floats(0, 1), min_size=9, max_size=9),
)
def test_every_pattern_is_shown_as_long_as_it_is_open(slots, switching, starts, lasts):
    begin, last = torch.tensor(starts[:slots]).double(), torch.tensor(lasts[:slots]).double()
    overlap = slot_overlap(slots, begin, begin + last, switching)
    torch.testing.assert_close(overlap.sum(-1), last, atol=1e-9, rtol=0)
    assert float(overlap.min()) > -1e-9


def test_rows_may_have_their_own_times():
    shutter = torch.rand(3, 4, 5)
    overlap = torch.stack([torch.eye(3), torch.eye(3).roll(1, 1), torch.eye(3).roll(2, 1), torch.eye(3)])
    found = through_time(shutter, overlap)
    torch.testing.assert_close(found[:, 0], shutter[:, 0])
    torch.testing.assert_close(found[:, 1], shutter[:, 1].roll(1, 0))
    torch.testing.assert_close(found[:, 2], shutter[:, 2].roll(2, 0))


def test_an_overlap_of_other_rows_is_refused():
    with pytest.raises(ShapeError, match="3, 3"):
        through_time(torch.rand(3, 4, 5), torch.rand(5, 3, 3))


def test_closed_pixels_leak():
    torch.testing.assert_close(leaked(torch.tensor([0.0, 0.5, 1.0]), 0.1), torch.tensor([0.1, 0.55, 1.0]))


@pytest.mark.parametrize("size", [(8, 11), (9, 10), (13, 13)])
@pytest.mark.parametrize(
    ("shift", "magnification", "rotation"),
    [((0.25, -1.5), 1.0, 0.0), ((0, 0), 1.1, 0.0), ((0, 0), 1.0, 7.0), ((0.3, 0.6), 0.95, -12.0)],
)
def test_an_image_is_where_its_middle_scale_and_turn_put_it(size, shift, magnification, rotation):
    patterns = torch.rand(2, *size, dtype=torch.float64)
    found = misplaced(patterns, shift, magnification, rotation)
    turn = -np.deg2rad(rotation)
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) / magnification
    middle = (np.array(size) - 1) / 2
    offset = middle - matrix @ (middle + np.array(shift))
    wanted = [affine_transform(p, matrix, offset, order=1, mode="nearest") for p in patterns.numpy()]
    np.testing.assert_allclose(found.numpy(), wanted, atol=1e-9)


def test_a_turn_carries_rows_towards_columns_as_a_registration_says():
    drawn = torch.rand(6, 40, 44).round()
    patterns = torch.cat([torch.ones(1, 40, 44), torch.zeros(1, 40, 44), drawn]).double()
    matrix = register(1000 * misplaced(patterns, rotation=1.0).numpy(), patterns.numpy()).matrix
    assert np.rad2deg(np.arctan2(matrix[1, 0], matrix[0, 0])) == pytest.approx(1, abs=0.05)
    point = torch.zeros(1, 21, 21)
    point[0, 20, 10] = 1
    assert misplaced(point, rotation=30.0)[0].argmax() == 19 * 21 + 15


@pytest.mark.parametrize("size", [(7, 12), (4, 6)])
def test_another_size_is_seen_around_the_same_middle(size):
    patterns = torch.rand(2, 5, 8)
    found = misplaced(patterns, size=size)
    top, left = (size[0] - 5) / 2, (size[1] - 8) / 2
    if top == int(top):
        assert found.shape == (2, *size)
        inner = found[:, int(top) : int(top) + 5, int(left) : int(left) + 8]
        torch.testing.assert_close(inner, patterns, atol=1e-5, rtol=0)
    else:
        torch.testing.assert_close(found[0, 0, 0], patterns[0, :2, 1].mean(), atol=1e-5, rtol=0)
