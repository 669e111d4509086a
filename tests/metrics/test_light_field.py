"""Quality of light fields, against the metrics of single images."""

from __future__ import annotations

import numpy as np
import pytest

from tmca.errors import ShapeError
from tmca.metrics import light_field_metrics, psnr, psnr_per_view, ssim, ssim_per_view


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
