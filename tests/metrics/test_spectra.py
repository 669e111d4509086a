"""SAM, ERGAS and DD against torchmetrics and cases worked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from tmca.errors import SettingError, ShapeError
from tmca.metrics import dd, ergas, sam


def _cubes(shape=(2, 5, 9, 8)):
    rng = np.random.default_rng(1)
    truth = rng.random(shape) + 0.1
    return truth + 0.05 * rng.standard_normal(shape), truth


def test_sam_agrees_with_torchmetrics_in_degrees():
    functional = pytest.importorskip("torchmetrics.functional.image")
    estimate, truth = (torch.from_numpy(c) for c in _cubes())
    theirs = functional.spectral_angle_mapper(estimate, truth)
    assert sam(estimate, truth) == pytest.approx(math.degrees(float(theirs)), rel=1e-6)


def test_sam_of_known_angles():
    truth = np.zeros((2, 1, 3))
    truth[0] = 2.0
    estimate = np.array([[[5.0, 1.0, 0.0]], [[0.0, 1.0, 7.0]]])
    assert sam(estimate, truth) == pytest.approx((0 + 45 + 90) / 3)


def test_sam_ignores_brightness():
    _, truth = _cubes()
    assert sam(0.3 * truth, truth) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("angle", [1e-9, 1e-7, 1e-3])
def test_sam_resolves_tiny_angles(angle):
    truth = np.array([1.0, 0.0]).reshape(2, 1, 1)
    estimate = np.array([math.cos(angle), math.sin(angle)]).reshape(2, 1, 1)
    assert sam(estimate, truth) == pytest.approx(math.degrees(angle), rel=1e-9)


def test_sam_of_very_dark_spectra_is_the_same():
    estimate, truth = _cubes()
    assert sam(estimate * 1e-200, truth * 1e-200) == pytest.approx(sam(estimate, truth))


def test_zero_true_spectra_are_left_out_and_counted():
    estimate, truth = _cubes((2, 4, 3, 3))
    expected = sam(estimate[:1, :, 1:], truth[:1, :, 1:])
    truth[0, :, 0] = 0
    angle, excluded = sam(estimate, truth, reduction="none", return_excluded=True)
    assert excluded.tolist() == [3, 0]
    assert angle[0] == pytest.approx(expected)
    assert sam(estimate, truth, return_excluded=True)[1] == 3


def test_a_zero_estimate_counts_a_right_angle():
    _, truth = _cubes((1, 4, 1, 2))
    estimate = truth.copy()
    estimate[..., 0] = 0
    assert sam(estimate, truth) == pytest.approx(45)


def test_an_image_without_any_spectrum_has_no_angle():
    assert math.isnan(sam(np.ones((2, 2, 2)), np.zeros((2, 2, 2))))


def test_ergas_of_a_hand_worked_case():
    truth = np.stack([np.full((2, 2), 1.0), np.full((2, 2), 4.0)])
    estimate = truth + np.array([0.3, 1.6]).reshape(2, 1, 1)
    # relative errors 0.3 and 0.4: sqrt((0.09 + 0.16) / 2).
    assert ergas(estimate, truth) == pytest.approx(100 * math.sqrt(0.125))
    assert ergas(estimate, truth, ratio=4) == pytest.approx(25 * math.sqrt(0.125))


def test_ergas_agrees_with_torchmetrics():
    functional = pytest.importorskip("torchmetrics.functional.image")
    estimate, truth = (torch.from_numpy(c) for c in _cubes())
    # torchmetrics multiplies by its ratio where Wald divides: they meet at 1.
    theirs = functional.error_relative_global_dimensionless_synthesis(estimate, truth, ratio=1)
    assert ergas(estimate, truth) == pytest.approx(float(theirs), rel=1e-6)


def test_ergas_of_a_dark_band():
    truth = np.stack([np.zeros((2, 2)), np.ones((2, 2))])
    assert ergas(truth, truth) == 0
    assert ergas(truth + 0.1, truth) == math.inf


def test_dd_is_the_mean_absolute_difference():
    truth = torch.zeros(2, 1, 2, 2)
    estimate = truth.clone()
    estimate[0, 0, 0, 0], estimate[1, 0, 1, 1] = 0.4, -0.8
    np.testing.assert_allclose(dd(estimate, truth, reduction="none"), [0.1, 0.2], rtol=1e-6)
    assert dd(estimate, truth) == pytest.approx(0.15)


@pytest.mark.parametrize("metric", [sam, ergas, dd])
def test_different_shapes_are_refused_by_name(metric):
    with pytest.raises(ShapeError, match=r"\(3, 4, 4\).*\(2, 4, 4\)"):
        metric(np.ones((3, 4, 4)), np.ones((2, 4, 4)))


def test_a_ratio_of_zero_is_refused():
    with pytest.raises(SettingError, match="ratio"):
        ergas(np.ones((1, 2, 2)), np.ones((1, 2, 2)), ratio=0)
