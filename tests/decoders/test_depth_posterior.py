"""Depth from the probability of planes, against sums over a fine grid of depths."""

import numpy as np
import pytest
import torch

from tmca.decoders.likelihood import DepthPosterior
from tmca.optics import DepthPlanes


@pytest.mark.parametrize("count", [1, 2, 5, 8])
def test_the_median_halves_the_probability_and_has_least_expected_error(count):
    planes = DepthPlanes(0.4, 2.0, count)
    log_probability = 2 * torch.randn(
        2, count, 3, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(count)
    )
    found, inverse = DepthPosterior.of(log_probability + 7, planes), planes.inverse.numpy()
    parts = 4000
    within = (np.arange(parts) + 0.5) / parts - 0.5
    for sample, row, column in np.ndindex(2, 3, 4):
        shares = log_probability[sample, :, row, column].softmax(0).numpy()
        fine = (inverse[:, None] + within * planes.step).clip(inverse[0], inverse[-1]).ravel()
        weights = np.repeat(shares / parts, parts)
        errors = [(weights * np.abs(fine - guess)).sum() for guess in fine[::50]]
        own = (weights * np.abs(fine - 1 / float(found.metres[sample, 0, row, column]))).sum()
        assert own <= min(errors) + 1e-4
        plane = int(found.plane[sample, 0, row, column])
        assert plane == np.searchsorted(shares.cumsum(), 0.5)
        near = shares[max(0, plane - 1) : plane + 2].sum()
        assert float(found.confidence[sample, 0, row, column]) == pytest.approx(near)


def test_a_sure_plane_is_its_depth_and_two_equal_ones_what_lies_between():
    planes = DepthPlanes(0.5, float("inf"), 5)
    sure = torch.full((1, 5, 1, 1), -60.0)
    sure[:, 3] = 0
    assert float(DepthPosterior.of(sure, planes).metres) == pytest.approx(1 / 1.5)
    sure[:, 2] = 0
    assert float(DepthPosterior.of(sure, planes).metres) == pytest.approx(1 / 1.25)
    assert float(DepthPosterior.of(torch.zeros(1, 5, 1, 1), planes).metres) == pytest.approx(1.0)
    far = torch.tensor([0.0, -9, -60, -60, -60])[None, :, None, None]
    assert float(DepthPosterior.of(far, planes).metres) > 100
