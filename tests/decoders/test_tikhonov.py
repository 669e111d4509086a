"""Least squares with a smooth scene, against the normal equations solved densely."""

import pytest
import torch

from tmca.cameras import LightFieldCamera, SpectralCamera
from tmca.decoders import first_estimate
from tmca.decoders.least_squares import _roughness, tikhonov
from tmca.sensor import Noise

WEIGHT = 0.7
CAMERAS = {
    "odd": lambda: SpectralCamera(bands=3, size=(7, 9), slots=3),
    "even, parts of pixels": lambda: SpectralCamera(bands=3, size=(6, 8), slots=2, dispersion=0.6),
    "dual disperser": lambda: SpectralCamera(bands=3, size=(5, 8), slots=2, disperser="dual"),
    "light field": lambda: LightFieldCamera(3, (6, 7), 2),
}


def operator_of(name):
    return CAMERAS[name]().double().operator()


def dense(operator, snapshot, weight):
    """The minimum by its normal equations."""
    shape = operator.scene_shape
    units = torch.eye(torch.Size(shape).numel(), dtype=torch.float64).reshape(-1, *shape)
    matrix = operator.A(units).flatten(1).T
    steps = torch.cat([units.diff(dim=-2).flatten(1), units.diff(dim=-1).flatten(1)], dim=1).T
    stiffness = weight * matrix.square().sum(0).mean()
    normal = matrix.T @ matrix + stiffness * steps.T @ steps
    return torch.linalg.solve(normal, matrix.T @ snapshot.flatten(1).T).T.reshape(-1, *shape)


def random_snapshots(operator, count=1):
    generator = torch.Generator().manual_seed(0)
    return torch.rand(count, *operator.snapshot_shape, generator=generator, dtype=torch.float64)


@pytest.mark.parametrize("name", CAMERAS)
def test_it_is_the_minimum(name):
    operator = operator_of(name)
    snapshots = random_snapshots(operator, 2)
    found = tikhonov(operator, snapshots, weight=WEIGHT, iterations=200)
    torch.testing.assert_close(found, dense(operator, snapshots, WEIGHT), rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (6, 1), (2, 2), (5, 6)])
def test_roughness_is_that_of_a_loop_over_neighbours(size):
    scene = torch.randn(2, 3, *size, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    wanted = torch.zeros_like(scene)
    for y, x in torch.cartesian_prod(*map(torch.arange, size)).reshape(-1, 2).tolist():
        for other_y, other_x in ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)):
            if 0 <= other_y < size[0] and 0 <= other_x < size[1]:
                wanted[..., y, x] += scene[..., y, x] - scene[..., other_y, other_x]
    torch.testing.assert_close(_roughness(scene), wanted)


def test_of_several_minima_one_is_kept():
    camera = SpectralCamera(bands=4, size=(6, 8), slots=1, shutter="open", dispersion=0.6).double()
    operator = camera.operator()  # scenes that are constant in every band: four numbers, told by three displacements
    snapshot = random_snapshots(operator)
    few, many = (tikhonov(operator, snapshot, iterations=count) for count in (100, 400))
    torch.testing.assert_close(many, few, rtol=0, atol=1e-8)


def test_gradients_reach_code_and_snapshot():
    camera = SpectralCamera(bands=2, size=(3, 4), slots=2).double()
    snapshot = random_snapshots(camera.operator())[:1].requires_grad_()
    code = camera.operator().taps.code.detach().clone().clamp_min(0.1).requires_grad_()

    def solved(code, snapshot):
        operator = camera.operator()
        operator.code = code
        return tikhonov(operator, snapshot, iterations=3)

    assert torch.autograd.gradcheck(solved, (code, snapshot))


def test_gradients_stop_at_a_start_that_is_not_learned_through():
    operator, noise = operator_of("odd"), Noise(0.01, 0.0)
    snapshot = random_snapshots(operator).requires_grad_()
    assert not first_estimate("tikhonov", snapshot, operator, noise).requires_grad
    assert first_estimate("tikhonov", snapshot, operator, noise, differentiable=True).requires_grad


def test_closed_codes_say_nothing():
    camera = SpectralCamera(bands=2, size=(4, 5), slots=1, aperture=torch.zeros(1, 4, 5), shutter="open")
    assert not tikhonov(camera.operator(), torch.ones(1, 1, 4, 6)).any()
