"""Does the expected error hold? Predicted and measured errors of codes, block by block."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from tmca.cameras import SpectralCamera
from tmca.errors import SettingError
from tmca.operators import TapOperator
from tmca.priors import BlockGrid, BlockModel, GaussianPrior, expected_mse
from tmca.priors.posterior import GaussianSolver
from tmca.sensor import Noise


def predicted_and_measured(
    prior: GaussianPrior, camera: SpectralCamera, cubes: Sequence[Tensor], *, count: int = 400, seed: int = 0
) -> tuple[float, float]:
    """PSNR that the prior predicts for single blocks, and the PSNR measured on patches of scenes.

    Both are means over the judged columns of blocks at random places of the code; nothing is blended.

    Args:
        prior: Gaussian.
        camera: its codes, dispersion and sensor; relay blur is not covered.
        cubes: (L, H, W) scenes from which patches are drawn, all equally often.
        count: patches.
        seed: of places, patches and noise.

    Returns:
        (predicted, measured) in dB.

    Raises:
        SettingError: a camera with relay blur.
    """
    operator, noise = camera.operator(), camera.noise
    if not isinstance(operator, TapOperator):
        raise SettingError("relay blur", str(camera.relay_blur), "0 for the expected error")
    predicted = expected_mse(prior, operator.taps, noise.read, noise.shot, blocks=64, seed=seed)
    errors = [
        _block_errors(prior, operator, noise, cube, max(1, count // len(cubes)), seed + 1 + index)
        for index, cube in enumerate(cubes)
    ]
    measured = torch.cat(errors).mean()
    return _decibels(predicted), _decibels(measured)


def _block_errors(
    prior: GaussianPrior, operator: TapOperator, noise: Noise, cube: Tensor, count: int, seed: int
) -> Tensor:
    """(count,) mean squared error of the estimates of random patches of one scene."""
    taps, generator = operator.taps, torch.Generator().manual_seed(seed)
    model = BlockModel.of(taps, prior.block)
    frame = (taps.code.shape[1], taps.code.shape[2])
    grid = BlockGrid.cover(model, frame, frame)
    places = _random_places(count, (frame[0] - prior.block[1], frame[1] - prior.block[2]), generator)
    corners = _random_places(
        count, (cube.shape[1] - prior.block[1], cube.shape[2] - prior.block[2]), generator
    )
    solver = GaussianSolver(prior, model, noise.read, noise.shot, torch.float64)
    first, last = model.judged
    errors = []
    for place, (y, x) in zip(places, corners, strict=True):
        truth = cube[:, y : y + prior.block[1], x : x + prior.block[2]].double()
        windows = grid.code_windows(taps.code, [place])
        exact = model.measure(model.complete(windows.double()), truth.reshape(1, -1))
        spread = noise.variance(exact).sqrt()
        recorded = exact + spread * torch.randn(exact.shape, generator=generator, dtype=torch.float64)
        estimate = solver.posterior(windows).estimate(0, recorded).reshape(prior.block)
        errors.append((estimate - truth)[..., first:last].square().mean())
    return torch.stack(errors)


def _random_places(count: int, room: tuple[int, int], generator: torch.Generator) -> list[tuple[int, int]]:
    share = torch.rand(count, 2, generator=generator).tolist()
    return [(int(v * (room[0] + 1)), int(u * (room[1] + 1))) for v, u in share]


def _decibels(mse: Tensor) -> float:
    return float(-10 * torch.log10(mse))
