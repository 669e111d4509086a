import numpy as np
import pytest
import torch
from small_cameras import blocky_scene, coded_camera, matrix
from torch import Tensor, nn

from tests.small_scenes import noisy
from tmca.decoders import (
    admm_tv,
    nl_means_denoiser,
    per_band,
    pnp_admm,
    total_variation,
    tv_denoiser,
)
from tmca.decoders.pnp import sigma_schedule

SHAPE = (3, 6, 7)
SIZE = 3 * 6 * 7


class GaussianDenoiser(nn.Module):
    """The Wiener filter of scenes with a given mean and covariance."""

    def __init__(self, mean: Tensor, covariance: Tensor) -> None:
        super().__init__()
        self.mean, self.covariance = mean, covariance

    def forward(self, cube: Tensor, sigma: float) -> Tensor:
        noise = sigma**2 * torch.eye(len(self.covariance), dtype=cube.dtype)
        gain = torch.linalg.solve(self.covariance + noise, self.covariance)
        return (self.mean + (cube.flatten(1) - self.mean) @ gain).view_as(cube)


@pytest.mark.parametrize("sigma", [0.1, (0.5, 0.05)])
def test_a_gaussian_prior_leads_to_the_closed_form_estimate(sigma: float | tuple[float, float]) -> None:
    camera, noise = coded_camera(SHAPE), 0.05
    index = torch.arange(SIZE, dtype=torch.float64)
    covariance = 0.04 * torch.exp(-(index[:, None] - index).abs() / 5)
    mean = torch.full((SIZE,), 0.4, dtype=torch.float64)
    snapshot = noisy(camera.A(blocky_scene((2, *SHAPE))), noise)
    system = matrix(camera)
    spread = system @ covariance @ system.mT + noise**2 * torch.eye(len(system), dtype=torch.float64)
    gain = torch.linalg.solve(spread, system @ covariance)
    closed = mean + (snapshot.flatten(1) - mean @ system.mT) @ gain
    result = pnp_admm(
        camera,
        snapshot,
        GaussianDenoiser(mean, covariance),
        noise_sigma=noise,
        sigma=sigma,
        max_iterations=1000,
        tolerance=1e-7,
    )
    assert result.converged
    assert torch.allclose(result.estimate.flatten(1), closed, atol=1e-5)


@pytest.mark.parametrize("joint", [pytest.param(False, marks=pytest.mark.slow), True])
def test_variation_plugged_in_leads_to_the_solution_of_admm_tv(joint: bool) -> None:
    camera = coded_camera(SHAPE)
    snapshot = noisy(camera.A(blocky_scene((1, *SHAPE))), 0.02)
    strength, noise = 30.0, 0.03
    direct = admm_tv(camera, snapshot, strength * noise**2, joint=joint, max_iterations=2000, tolerance=1e-6)

    denoise = tv_denoiser(strength, joint=joint, max_iterations=100)
    plugged = pnp_admm(camera, snapshot, denoise, noise_sigma=noise, sigma=0.1, max_iterations=300, tolerance=1e-4)
    misfit = 0.5 * (camera.A(plugged.estimate) - snapshot).square().sum()
    objective = misfit + strength * noise**2 * total_variation(plugged.estimate, joint).sum()
    assert objective.item() == pytest.approx(direct.objective[-1], rel=2e-3)
    assert torch.allclose(plugged.estimate, direct.estimate, atol=0.01)


def test_sigma_falls_in_equal_ratios_and_is_then_held() -> None:
    assert sigma_schedule(0.2, 3) == [0.2, 0.2, 0.2]
    falling = sigma_schedule((0.8, 0.1), 6)
    assert falling == pytest.approx([0.8, 0.4, 0.2, 0.1, 0.1, 0.1])
    assert falling[3:] == [falling[-1]] * 3


@pytest.mark.parametrize("make", [tv_denoiser, nl_means_denoiser])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_denoisers_take_noise_away_from_every_band(make: object, dtype: torch.dtype) -> None:
    clean = torch.full((2, 3, 24, 21), 0.3, dtype=dtype)
    clean[..., :, 10:] = 0.8
    cube = noisy(clean, 0.1)
    denoised = make()(cube, 0.1)
    assert denoised.dtype == dtype
    error = (denoised - clean).square().mean(dim=(2, 3))
    assert (error < 0.5 * (cube - clean).square().mean(dim=(2, 3))).all()


def test_bands_reach_a_library_function_one_by_one_and_in_order() -> None:
    cube = torch.arange(2 * 3 * 4 * 5, dtype=torch.float32).reshape(2, 3, 4, 5)
    seen: list[np.ndarray] = []
    denoise = per_band(lambda band, sigma: seen.append(band) or band + sigma)
    assert torch.equal(denoise(cube, 0.5), cube + 0.5)
    assert [band[0, 0] for band in seen] == [0, 20, 40, 60, 80, 100]
