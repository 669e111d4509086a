"""Figures of cubes and light fields against other libraries, slow loops and cases worked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
import xarray
from scipy.stats import spearmanr

from tmca.errors import SettingError, ShapeError
from tmca.metrics import (
    all_metrics,
    certainty,
    coverage_1s,
    coverage_2s,
    dd,
    ergas,
    light_field_metrics,
    psnr,
    psnr_per_view,
    rank_correlation,
    sam,
    ssim,
    ssim_per_view,
    uiqi,
)


def _cubes(shape, seed=0, noise=0.1):
    rng = np.random.default_rng(seed)
    truth = rng.random(shape)
    return truth + noise * rng.standard_normal(shape), truth


def test_identical_cubes_are_perfect():
    _, truth = _cubes((3, 40, 41))
    found = all_metrics(truth, truth)
    one = pytest.approx(1)
    assert found == {"psnr": math.inf, "ssim": one, "uiqi": one, "sam": 0, "ergas": 0, "dd": 0}


def test_psnr_is_averaged_over_images_not_pooled():
    truth = torch.zeros(2, 1, 4, 4)
    estimate = truth + torch.tensor([0.1, 0.01]).view(2, 1, 1, 1)
    assert psnr(estimate, truth) == pytest.approx(30.0, abs=1e-5)
    np.testing.assert_allclose(psnr(estimate, truth, reduction="none"), [20, 40], atol=1e-5)


def _ssim_loop(x, y, data_range):
    taps = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)
    weights, values = np.outer(taps, taps) / taps.sum() ** 2, []
    c1, c2 = (0.01 * data_range) ** 2, (0.03 * data_range) ** 2
    for i in range(x.shape[0] - 10):
        for j in range(x.shape[1] - 10):
            a, b = x[i : i + 11, j : j + 11], y[i : i + 11, j : j + 11]
            u, v = np.sum(weights * a), np.sum(weights * b)
            covariance, variances = np.sum(weights * (a - u) * (b - v)), np.sum(weights * ((a - u) ** 2 + (b - v) ** 2))
            values.append((2 * u * v + c1) * (2 * covariance + c2) / ((u**2 + v**2 + c1) * (variances + c2)))
    return np.mean(values)


@pytest.mark.parametrize("shape", [(2, 3, 14, 23), (1, 2, 11, 11), (1, 1, 20, 12)])
def test_ssim_agrees_with_a_slow_loop(shape):
    estimate, truth = _cubes(shape)
    expected = [
        [_ssim_loop(a, b, 1.3) for a, b in zip(x, y, strict=True)] for x, y in zip(estimate, truth, strict=True)
    ]
    found = ssim(estimate, truth, data_range=1.3, reduction="none")
    np.testing.assert_allclose(found, np.mean(expected, axis=1), rtol=1e-10)


def _uiqi_loop(x, y, window):
    values = []
    for i in range(x.shape[0] - window + 1):
        for j in range(x.shape[1] - window + 1):
            a, b = x[i : i + window, j : j + window], y[i : i + window, j : j + window]
            denominator = (a.var() + b.var()) * (a.mean() ** 2 + b.mean() ** 2)
            if denominator == 0:
                values.append(float(np.array_equal(a, b)))
            else:
                values.append(4 * np.mean((a - a.mean()) * (b - b.mean())) * a.mean() * b.mean() / denominator)
    return np.mean(values)


@pytest.mark.parametrize("size", [(10, 12), (11, 13), (9, 16)])
@pytest.mark.parametrize("window", [2, 3, 7, 8])
def test_uiqi_agrees_with_a_slow_loop(size, window):
    estimate, truth = _cubes((2, *size))
    estimate[0, :, 4:] = truth[0, :, 4:] = 0.5
    estimate[0, 5:, 4:] = 0.25
    expected = np.mean([_uiqi_loop(a, b, window) for a, b in zip(estimate, truth, strict=True)])
    assert uiqi(estimate, truth, window=window) == pytest.approx(expected, abs=1e-12)


def test_uiqi_of_flat_windows_is_one_if_equal_and_zero_if_not():
    # 0.1 and 0.3 are not exact in binary: rounding must not pass for structure.
    flat = np.full((1, 33, 35), 0.1)
    assert uiqi(flat, flat) == 1
    assert uiqi(flat + 0.2, flat) == 0
    assert uiqi(np.zeros_like(flat), np.zeros_like(flat)) == 1


def test_uiqi_is_not_disturbed_by_a_bright_neighbour():
    estimate, truth = _cubes((1, 16, 64), noise=0.01)
    dark = uiqi(estimate[..., :16] * 1e-7, truth[..., :16] * 1e-7, window=16)
    assert dark == pytest.approx(uiqi(estimate[..., :16], truth[..., :16], window=16), rel=1e-9)


def _positive(shape=(2, 5, 9, 8)):
    """Spectra that are nowhere zero."""
    estimate, truth = _cubes(shape, seed=1, noise=0.05)
    return estimate + 0.1, truth + 0.1


@pytest.mark.parametrize(
    ("metric", "theirs", "settings", "tolerance"),
    [
        # torchmetrics keeps reflected borders of half a window: only the interior is common.
        (ssim, "structural_similarity_index_measure", {"data_range": 1.0, "sigma": 1.5}, {"abs": 5e-3}),
        (psnr, "peak_signal_noise_ratio", {"data_range": 1.0}, {"rel": 1e-6}),
        (lambda *cubes: math.radians(sam(*cubes)), "spectral_angle_mapper", {}, {"rel": 1e-6}),
        # torchmetrics multiplies by its ratio where Wald divides: they meet at 1.
        (ergas, "error_relative_global_dimensionless_synthesis", {"ratio": 1}, {"rel": 1e-6}),
    ],
)
def test_figures_agree_with_torchmetrics(metric, theirs, settings, tolerance):
    functional = pytest.importorskip("torchmetrics.functional.image")
    estimate, truth = (torch.from_numpy(c) for c in _positive((1, 3, 32, 37)))
    expected = float(getattr(functional, theirs)(estimate, truth, **settings))
    assert metric(estimate, truth) == pytest.approx(expected, **tolerance)


def test_zero_true_spectra_are_left_out_and_counted():
    estimate, truth = _positive((2, 4, 3, 3))
    expected = sam(estimate[:1, :, 1:], truth[:1, :, 1:])
    truth[0, :, 0] = 0
    angle, excluded = sam(estimate, truth, reduction="none", return_excluded=True)
    assert excluded.tolist() == [3, 0]
    assert angle[0] == pytest.approx(expected)
    assert sam(estimate, truth, return_excluded=True)[1] == 3


def test_ergas_of_a_hand_worked_case():
    truth = np.stack([np.full((2, 2), 1.0), np.full((2, 2), 4.0)])
    estimate = truth + np.array([0.3, 1.6]).reshape(2, 1, 1)
    # relative errors 0.3 and 0.4: sqrt((0.09 + 0.16) / 2).
    assert ergas(estimate, truth) == pytest.approx(100 * math.sqrt(0.125))
    assert ergas(estimate, truth, ratio=4) == pytest.approx(25 * math.sqrt(0.125))


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


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_tensors_arrays_and_labelled_arrays_agree(dtype):
    estimate, truth = (torch.from_numpy(c).to(dtype) for c in _cubes((3, 33, 40)))
    labelled = xarray.DataArray(estimate.numpy(), dims=("wavelength", "y", "x")).transpose("y", "x", "wavelength")
    expected = all_metrics(estimate.numpy(), truth.numpy())
    assert all_metrics(estimate, truth) == expected
    assert all_metrics(labelled, truth) == expected
    assert all(isinstance(value, float) for value in expected.values())


SIDE, DIAGONAL = np.array([1.0, 0.0]), np.array([1.0, 1.0])


@pytest.mark.parametrize(
    ("estimate", "truth", "degrees"),
    [
        (5 * SIDE, SIDE, 0), (DIAGONAL, SIDE, 45), (SIDE[::-1], 2 * SIDE, 90), (0 * SIDE, SIDE, 90),
        (1e-200 * DIAGONAL, 1e-200 * SIDE, 45), (SIDE, 0 * SIDE, math.nan),
        *(([math.cos(a), math.sin(a)], SIDE, math.degrees(a)) for a in (1e-9, 1e-7, 1e-3)),
    ],
)  # fmt: skip
def test_sam_of_known_angles(estimate, truth, degrees):
    found = sam(np.reshape(estimate, (2, 1, 1)), truth.reshape(2, 1, 1))
    assert found == pytest.approx(degrees, rel=1e-9, nan_ok=True)


CUBE, EVERY = np.ones((1, 32, 32)), (psnr, ssim, uiqi, sam, ergas, dd)


@pytest.mark.parametrize(
    ("call", "error"),
    [
        *((lambda metric=metric: metric(CUBE, CUBE[..., 1:]), ShapeError) for metric in EVERY),
        (lambda: uiqi(CUBE[:, :20], CUBE[:, :20]), ShapeError), (lambda: ssim(CUBE[:, :10], CUBE[:, :10]), ShapeError),
        (lambda: psnr(CUBE[0], CUBE[0]), ShapeError),
        (lambda: psnr(CUBE, CUBE, data_range=0), SettingError), (lambda: ssim(CUBE, CUBE, data_range=-1), SettingError),
        (lambda: uiqi(CUBE, CUBE, window=1), SettingError), (lambda: psnr(CUBE, CUBE, reduction="sum"), SettingError),
        (lambda: psnr(CUBE + 1j, CUBE), SettingError), (lambda: ergas(CUBE, CUBE, ratio=0), SettingError),
    ],
)  # fmt: skip
def test_what_has_no_figure_is_refused(call, error):
    with pytest.raises(error):
        call()


def test_psnr_of_a_uniform_error_is_known():
    truth = np.zeros((2, 3, 4))
    assert psnr(truth + 0.1, truth) == pytest.approx(20.0)
    assert psnr(truth + 25.5, truth, data_range=255) == pytest.approx(20.0)


@pytest.mark.parametrize("colours", [(), (3,)])
def test_every_view_has_the_quality_of_its_image(colours):
    rng = np.random.default_rng(0)
    truth = rng.random((*colours, 3, 5, 12, 13))
    estimate = truth + rng.normal(size=truth.shape) * np.linspace(0.01, 0.2, 15).reshape(3, 5, 1, 1)
    images = [(a[..., 2, 1, :, :].reshape(-1, 12, 13)) for a in (estimate, truth)]
    assert psnr_per_view(estimate, truth).shape == (3, 5)
    assert psnr_per_view(estimate, truth)[2, 1] == pytest.approx(psnr(*images))
    assert ssim_per_view(estimate, truth)[2, 1] == pytest.approx(ssim(*images))
    found = light_field_metrics(estimate, truth)
    assert found["ssim"] == pytest.approx(ssim_per_view(estimate, truth).mean())
    assert found["psnr"] == pytest.approx(-10 * np.log10(np.mean((estimate - truth) ** 2)))
    assert found["psnr_min"] < found["psnr"] < found["psnr_max"]


def test_views_without_a_window_have_no_ssim():
    assert np.isnan(light_field_metrics(np.ones((1, 1, 4, 4)), np.zeros((1, 1, 4, 4)))["ssim"])
    with pytest.raises(ShapeError, match="V, U, H, W"):
        light_field_metrics(np.ones((4, 4, 4)), np.ones((4, 4, 4)))


@pytest.mark.parametrize("wrong_by", [0.5, 1.0, 2.0])
def test_normal_errors_lie_within_a_deviation_as_often_as_the_error_function_says(wrong_by):
    draw = np.random.default_rng(5)
    sigma = draw.uniform(0.1, 0.2, (5, 90, 91))
    truth = draw.uniform(0, 1, sigma.shape)
    estimate = truth + sigma * draw.standard_normal(sigma.shape)
    expected = math.erf(wrong_by / math.sqrt(2))
    assert coverage_1s(estimate, truth, wrong_by * sigma) == pytest.approx(expected, abs=0.01)
    assert coverage_2s(estimate, truth, wrong_by / 2 * sigma) == pytest.approx(expected, abs=0.01)
    with pytest.raises(ShapeError, match="deviation"):
        coverage_1s(estimate, truth, sigma[0])


def test_ranks_of_deviation_and_error_are_compared_as_a_slow_loop_does_it():
    draw = np.random.default_rng(6)
    truth, estimate = draw.uniform(0, 1, (2, 3, 4, 5))
    sigma = draw.integers(1, 5, truth.shape) / 10  # with ties
    error, ranks = np.abs(estimate - truth).ravel(), []
    for values in (error, sigma.ravel()):
        ranks.append([np.sum(values < one) + (np.sum(values == one) - 1) / 2 for one in values])
    found = rank_correlation(estimate, truth, sigma)
    assert found == pytest.approx(np.corrcoef(ranks)[0, 1])
    assert found == pytest.approx(spearmanr(error, sigma.ravel()).statistic)


def test_a_deviation_that_is_the_error_has_its_ranks_and_a_constant_one_none():
    truth, estimate = np.random.default_rng(7).uniform(0, 1, (2, 3, 4, 5))
    assert rank_correlation(estimate, truth, np.abs(estimate - truth)) == pytest.approx(1)
    assert np.isnan(rank_correlation(estimate, truth, np.ones_like(truth)))
    names = {"coverage_1s", "coverage_2s", "rank_correlation"}
    assert set(certainty(estimate, truth, np.ones_like(truth))) == names
