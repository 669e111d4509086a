"""The light field's network: convolutions over its two grids, steps on the exact operator."""

import pytest
import torch
from test_networks import decoded, operator_of, scenes, trained
from torch.nn.functional import conv2d

from tmca.decoders import build_network
from tmca.decoders.nets.spatial_angular import AngularConv, grid_of_views
from tmca.sensor import Noise


@pytest.mark.parametrize("views", [(3, 3), (5, 5), (1, 3), (7, 1), (5, 3)])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("layout", [torch.channels_last, torch.contiguous_format])
@pytest.mark.parametrize("batch", [1, 2])
def test_the_angular_convolution_is_a_convolution_over_the_views_of_each_pixel(views, dtype, layout, batch):
    torch.manual_seed(1)
    height, width, inputs, outputs = 5, 4, 3, 6
    layer = AngularConv(inputs, outputs, views).to(dtype)
    light = torch.randn(batch, *views, inputs, height, width, dtype=dtype)
    found = layer(light.flatten(0, 2).contiguous(memory_format=layout)).reshape(batch, *views, outputs, height, width)
    for row, column in ((0, 0), (4, 3), (2, 1)):
        grid = light[..., row, column].permute(0, 3, 1, 2)
        expected = conv2d(grid, layer.weight[..., 0], layer.bias, padding=1)
        torch.testing.assert_close(found[..., row, column].permute(0, 3, 1, 2), expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("name", ["views, consistent", "views, shared"])
def test_without_noise_the_estimate_explains_the_snapshot(name):
    camera = operator_of((3, 3), dtype=torch.float64)
    network, snapshot = trained(name, (3, 3), torch.float64), camera.A(scenes(camera))
    estimate = decoded(network, camera, snapshot, Noise())
    torch.testing.assert_close(camera.A(estimate), snapshot, rtol=0, atol=1e-10)
    assert (estimate - camera.A_dagger(snapshot)).abs().max() > 1e-3


def test_the_step_is_the_best_linear_one_for_an_error_of_known_size():
    camera = operator_of((3, 1), (3, 4), torch.float64)
    network = build_network("spatial-angular", bands=3, views=[3, 1], stages=1, start="dagger").double()
    flat = torch.full((1, 3, 3, 4), 0.5, dtype=torch.float64)
    snapshot = camera.A(flat) + 0.1
    matrix = torch.stack([camera.A(unit.reshape(1, 3, 3, 4)).flatten() for unit in torch.eye(36).double()], dim=1)
    spread = 0.5 * float(torch.nn.functional.softplus(network.error[0].detach()))
    inverse = torch.linalg.inv(spread**2 * matrix @ matrix.T + 0.1**2 * torch.eye(12, dtype=torch.float64))
    estimate = flat.flatten()
    for _ in range(2):  # before it is trained a stage is its step alone; one more step closes the chain
        estimate = estimate + spread**2 * matrix.T @ inverse @ (snapshot.flatten() - matrix @ estimate)
    found = network(snapshot, camera, Noise(0.1), flat)
    torch.testing.assert_close(found.flatten(), estimate, rtol=0, atol=1e-9)


def test_a_square_grid_needs_no_name():
    assert grid_of_views(25, None) == (5, 5)
    assert grid_of_views(15, [3, 5]) == (3, 5)
