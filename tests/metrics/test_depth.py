"""Depth errors over valid pixels, worked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from tmca.errors import SettingError, ShapeError
from tmca.metrics import depth_mae, depth_rmse, within_bin


def test_errors_of_a_hand_worked_map():
    truth = np.array([[1.0, 2.0], [1.0, 2.0]])
    estimate = np.array([[1.3, 2.0], [1.0, 1.6]])
    assert depth_mae(estimate, truth) == pytest.approx(0.7 / 4)
    assert depth_rmse(estimate, truth) == pytest.approx(math.sqrt(0.25 / 4))


@pytest.mark.parametrize("unknown", [np.nan, np.inf, 0.0, -1.0])
def test_unknown_depths_do_not_count(unknown):
    truth = torch.tensor([[[[1.0, unknown]]], [[[2.0, 2.0]]]])
    estimate = torch.tensor([[[[1.5, 9.0]]], [[[2.0, 2.5]]]])
    np.testing.assert_allclose(depth_mae(estimate, truth, reduction="none"), [0.5, 0.25])
    assert depth_mae(estimate, truth) == pytest.approx(0.375)


def test_a_mask_takes_pixels_out():
    truth, estimate = np.ones((1, 2, 2)), np.array([[[1.0, 2.0], [3.0, 1.0]]])
    mask = np.array([[[True, True], [False, False]]])
    assert depth_mae(estimate, truth, valid=mask) == pytest.approx(0.5)
    assert math.isnan(depth_rmse(estimate, truth, valid=np.zeros_like(mask)))


def test_bins_are_counted_in_inverse_depth():
    planes = 1 / np.array([0.5, 1.0, 1.5, 2.0])
    truth = 1 / np.array([[1.0, 1.0, 1.0, 1.0, 2.0]])
    estimate = 1 / np.array([[1.5, 0.5, 1.51, 0.49, 2.4]])
    assert within_bin(estimate, truth, planes) == pytest.approx(3 / 5)
    assert within_bin(estimate, truth, planes[::-1].copy()) == pytest.approx(3 / 5)


def test_an_impossible_estimate_is_outside_its_bin():
    truth = np.ones((1, 4))
    estimate = np.array([[1.0, np.nan, -1.0, 0.0]])
    assert within_bin(estimate, truth, [0.5, 1.0, 2.0]) == pytest.approx(0.25)
    assert math.isnan(depth_mae(estimate, truth))


def test_bad_maps_and_planes_are_refused():
    with pytest.raises(ShapeError, match=r"\(2, 2\).*\(2, 3\)"):
        depth_mae(np.ones((2, 2)), np.ones((2, 3)))
    with pytest.raises(ShapeError, match=r"\(1, 3, 2, 2\)"):
        depth_mae(np.ones((1, 3, 2, 2)), np.ones((1, 3, 2, 2)))
    for planes in ([1.0], [1.0, 1.0], [0.0, 1.0]):
        with pytest.raises(SettingError, match="planes"):
            within_bin(np.ones((2, 2)), np.ones((2, 2)), planes)
