"""Filters over the sensor's pixels, and what its channels see."""

import numpy as np
import pytest
import torch
from colour import MSDS_CAMERA_SENSITIVITIES

from tmca.errors import SettingError, ShapeError
from tmca.sensor import ColourCodedAperture, channel_response, feasible_filters

BANDS = tuple((440 + 30 * k) * 1e-9 for k in range(9))


def test_camera_channels_are_the_measured_ones():
    table = MSDS_CAMERA_SENSITIVITIES["Nikon 5100 (NPL)"]
    found = channel_response("rgb", BANDS)
    for band, row in zip(BANDS, found.T, strict=True):
        np.testing.assert_allclose(row, table[band * 1e9], atol=1e-6)
    assert channel_response("rgb", [300e-9, *BANDS])[:, 0].sum() == 0
    with pytest.raises(SettingError, match="blind at 850 to 900 nm"):
        channel_response("rgb", [850e-9, 900e-9])
    assert torch.equal(channel_response("monochrome", BANDS), torch.ones(1, 9))


def test_gaussian_filters_lie_side_by_side():
    filters = feasible_filters("gaussian", BANDS, 3)
    middles = torch.tensor([480.0, 560.0, 640.0]) * 1e-9
    expected = torch.exp(-0.5 * ((torch.tensor(BANDS) - middles[:, None]) / 40e-9) ** 2)
    torch.testing.assert_close(filters, expected)
    assert feasible_filters("rgbw", BANDS).shape == (4, 9)


@pytest.mark.parametrize("size", [(8, 12), (7, 9)])
def test_frozen_cells_show_one_filter_each_and_repeat(size):
    filters = feasible_filters("gaussian", BANDS)
    cells = torch.tensor([[0, 1], [2, 3]])
    shown = ColourCodedAperture(filters, size, cells=cells)
    for i in range(size[0]):
        for j in range(size[1]):
            assert torch.equal(shown()[:, i, j], filters[cells[i % 2, j % 2]])
    assert torch.equal(shown.cells(), cells)


def test_relaxed_cells_are_mixtures_and_learn():
    shown = ColourCodedAperture(feasible_filters("gaussian", BANDS), (8, 8), learnable=True)
    shown.relax(True)
    weights = shown.plane()
    torch.testing.assert_close(weights.sum(0), torch.ones(8, 8))
    assert float(weights.detach().max()) < 1
    shown()[0].sum().backward()
    assert float(shown.plane.latent.grad.abs().max()) > 0


def test_what_is_no_filter_is_refused():
    for wrong in (torch.ones(9), 1.5 * torch.ones(2, 9), -torch.ones(2, 9)):
        with pytest.raises((SettingError, ShapeError), match="filters"):
            ColourCodedAperture(wrong, (8, 8))
    with pytest.raises(SettingError, match="cells"):
        ColourCodedAperture(torch.ones(2, 9), (8, 8), cells=torch.tensor([[0.5]]))
    with pytest.raises(SettingError, match="rgbw"):
        feasible_filters("infrared", BANDS)
    with pytest.raises(SettingError, match="blind"):
        channel_response(torch.zeros(1, 9), BANDS)
