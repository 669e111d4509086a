"""PSNR, SSIM and UIQI against other libraries, slow loops and cases worked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
import xarray
from skimage.metrics import structural_similarity

from tmca.errors import SettingError, ShapeError
from tmca.metrics import all_metrics, psnr, ssim, uiqi


def _cubes(shape, seed=0, noise=0.1):
    rng = np.random.default_rng(seed)
    truth = rng.random(shape)
    return truth + noise * rng.standard_normal(shape), truth


def test_psnr_of_a_uniform_error_is_known():
    truth = np.zeros((2, 3, 4))
    assert psnr(truth + 0.1, truth) == pytest.approx(20.0)
    assert psnr(truth + 25.5, truth, data_range=255) == pytest.approx(20.0)


def test_identical_cubes_are_perfect():
    _, truth = _cubes((3, 40, 41))
    found = all_metrics(truth, truth)
    assert found == {
        "psnr": math.inf,
        "ssim": pytest.approx(1),
        "uiqi": pytest.approx(1),
        "sam": 0,
        "ergas": 0,
        "dd": 0,
    }


def test_psnr_is_averaged_over_images_not_pooled():
    truth = torch.zeros(2, 1, 4, 4)
    estimate = truth + torch.tensor([0.1, 0.01]).view(2, 1, 1, 1)
    assert psnr(estimate, truth) == pytest.approx(30.0, abs=1e-5)
    np.testing.assert_allclose(psnr(estimate, truth, reduction="none"), [20, 40], atol=1e-5)


@pytest.mark.parametrize("shape", [(2, 3, 24, 33), (1, 2, 11, 11), (1, 1, 20, 12)])
def test_ssim_agrees_with_scikit_image(shape):
    estimate, truth = _cubes(shape)
    options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False, "data_range": 1.3}
    expected = [
        [structural_similarity(a, b, **options) for a, b in zip(x, y, strict=True)]
        for x, y in zip(estimate, truth, strict=True)
    ]
    np.testing.assert_allclose(
        ssim(estimate, truth, data_range=1.3, reduction="none"), np.mean(expected, axis=1), rtol=1e-10
    )


def test_ssim_and_psnr_agree_with_torchmetrics():
    functional = pytest.importorskip("torchmetrics.functional.image")
    estimate, truth = (torch.from_numpy(c) for c in _cubes((1, 3, 32, 37)))
    theirs = functional.structural_similarity_index_measure(estimate, truth, data_range=1.0, sigma=1.5)
    # torchmetrics keeps reflected borders of half a window: only the interior is common.
    assert ssim(estimate, truth) == pytest.approx(float(theirs), abs=5e-3)
    assert psnr(estimate, truth) == pytest.approx(
        float(functional.peak_signal_noise_ratio(estimate, truth, data_range=1.0))
    )


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


def test_uiqi_of_a_scaled_image_is_known():
    _, truth = _cubes((1, 32, 32))
    # x = 2y: covariance 2v, variances 4v + v, means 2m and m: Q = 4 · 2v · 2m² / (5v · 5m²).
    assert uiqi(2 * truth, truth) == pytest.approx(16 / 25)


def test_uiqi_is_not_disturbed_by_a_bright_neighbour():
    estimate, truth = _cubes((1, 16, 64), noise=0.01)
    dark = uiqi(estimate[..., :16] * 1e-7, truth[..., :16] * 1e-7, window=16)
    assert dark == pytest.approx(uiqi(estimate[..., :16], truth[..., :16], window=16), rel=1e-9)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_tensors_arrays_and_labelled_arrays_agree(dtype):
    estimate, truth = (torch.from_numpy(c).to(dtype) for c in _cubes((3, 33, 40)))
    labelled = xarray.DataArray(estimate.numpy(), dims=("wavelength", "y", "x")).transpose("y", "x", "wavelength")
    expected = all_metrics(estimate.numpy(), truth.numpy())
    assert all_metrics(estimate, truth) == expected
    assert all_metrics(labelled, truth) == expected
    assert all(isinstance(value, float) for value in expected.values())


def test_gradients_do_not_get_in_the_way():
    estimate, truth = (torch.from_numpy(c) for c in _cubes((1, 32, 32)))
    assert psnr(estimate.requires_grad_(), truth) == psnr(estimate.detach(), truth)


@pytest.mark.parametrize("metric", [psnr, ssim, uiqi])
def test_different_shapes_are_refused_by_name(metric):
    with pytest.raises(ShapeError, match=r"\(3, 32, 32\).*\(3, 32, 33\)"):
        metric(np.ones((3, 32, 32)), np.ones((3, 32, 33)))


def test_images_smaller_than_the_window_are_refused_with_a_remedy():
    small = np.ones((1, 20, 40))
    with pytest.raises(ShapeError, match=r"20 × 40.*32 × 32; pass a smaller window="):
        uiqi(small, small)
    with pytest.raises(ShapeError, match="11 × 11"):
        ssim(small[:, :10], small[:, :10])


def test_impossible_settings_are_refused():
    cube = np.ones((1, 32, 32))
    for call in (
        lambda: psnr(cube, cube, data_range=0),
        lambda: ssim(cube, cube, data_range=-1),
        lambda: uiqi(cube, cube, window=1),
        lambda: psnr(cube, cube, reduction="sum"),
        lambda: psnr(cube + 1j, cube),
    ):
        with pytest.raises(SettingError):
            call()
    with pytest.raises(ShapeError):
        psnr(cube[0], cube[0])
