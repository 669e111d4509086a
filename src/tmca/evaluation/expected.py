"""Does what is predicted of codes hold? Errors of blocks, and the order of codes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from tmca.applications.imaging import NOISE_STREAM
from tmca.cameras import SpectralCamera
from tmca.errors import SettingError
from tmca.operators import TapOperator
from tmca.priors import BlockGrid, BlockModel, GaussianPrior, expected_mse
from tmca.priors.gaussian_posterior import GaussianSolver

_PLACES = 16
PREDICTED = (
    ("placed", "error on training scenes at drawn depths (bins)", ".2f"),
    ("flat", "on flat ones (bins)", ".2f"),
    ("confusion", "predicted confusion (bins)", ".3f"),
    ("fisher", "Fisher information (m²)", ".0f"),
    ("kullback_leibler", "nats from the nearest rival", ".1f"),
    ("psnr", "predicted PSNR (dB)", ".2f"),
)
PREDICTED_BY = (
    "The patch likelihood's error on some training scenes at drawn depths, with edges, and standing at every plane in "
    "turn; and under the prior alone, of windows of {study[search][searched]} pixels, means over planes (of Fisher "
    "information the geometric one); beside what the patch likelihood made of the test scenes."
)
_ORDERED = {"fisher": ("depth_mae", -1), "kullback_leibler": ("depth_mae", -1), "psnr": ("psnr", 1)}
"""What is predicted → what it predicts, and the sign of its correlation with that; of all else depth errors, 1."""


def predicted_and_measured(
    prior: GaussianPrior, camera: SpectralCamera, cubes: Sequence[Tensor], *, count: int = 24_000, seed: int = 0
) -> tuple[float, float]:
    """PSNR that the prior predicts for single blocks, and the PSNR measured on patches of scenes.

    Both are means over the valid columns of blocks at random places of the code; nothing is blended.
    Patches lie inside the scenes, scattered evenly; the prior also counts the frame's border as often as the rest.
    That leaves a difference, the larger the larger blocks are against the scenes: 0.1 to 0.2 dB at 512×512 pixels,
    0.3 to 0.5 dB and more at 96×96; the prediction is too high where the border is darker than the rest, too low where
    it is brighter.

    Args:
        prior: Gaussian.
        camera: its codes, dispersion and sensor; relay blur is not covered.
        cubes: (L, H, W) scenes from which patches are drawn, all equally often.
        count: patches in all, about.
        seed: of places, patches and noise.

    Returns:
        (predicted, measured) in dB.

    Raises:
        SettingError: a camera with relay blur.
    """
    operator, noise = camera.operator(), camera.noise
    if not isinstance(operator, TapOperator):
        raise SettingError("relay blur", str(camera.relay_blur), "0 for the expected error")
    predicted = expected_mse(prior, operator.taps, noise, blocks=64, seed=seed)
    each = max(1, count // (_PLACES * len(cubes)))
    errors = [_block_errors(prior, operator, camera, cube, each, seed + 1 + index) for index, cube in enumerate(cubes)]
    return _decibels(predicted), _decibels(torch.cat(errors).mean())


def _block_errors(
    prior: GaussianPrior, operator: TapOperator, camera: SpectralCamera, cube: Tensor, each: int, seed: int
) -> Tensor:
    """Mean squared errors of the estimates of random patches of one scene, ``each`` at every place of the code."""
    taps, noise = operator.taps, camera.noise
    placing, recording = (torch.Generator().manual_seed(seed + stream) for stream in (0, NOISE_STREAM))
    model, (_, rows, columns) = BlockModel.of(taps, prior.block), prior.block
    frame = (taps.code.shape[1], taps.code.shape[2])
    grid = BlockGrid.cover(model, frame, frame)
    padded = grid.pad_code(taps.code)
    solver = GaussianSolver(prior, model, noise, torch.float64)
    first, last = model.valid
    errors = []
    for place in _random_places(_PLACES, (frame[0] - rows, frame[1] - columns), placing):
        windows = grid.code_windows(padded, [place])
        corners = _scattered(each, (cube.shape[1] - rows + 1, cube.shape[2] - columns + 1), placing)
        truth = torch.stack([cube[:, y : y + rows, x : x + columns] for y, x in corners]).double()
        weights = model.complete(windows.double())
        recorded = camera.record(model.measure(weights, truth.flatten(1)), recording)
        estimate = solver.posterior(windows).estimate(0, recorded).reshape(truth.shape)
        errors.append((estimate - truth)[..., first:last].square().mean((1, 2, 3)))
    return torch.cat(errors)


def _random_places(count: int, room: tuple[int, int], generator: torch.Generator) -> list[tuple[int, int]]:
    share = torch.rand(count, 2, generator=generator).tolist()
    return [(int(v * (room[0] + 1)), int(u * (room[1] + 1))) for v, u in share]


def _scattered(count: int, size: Sequence[int], generator: torch.Generator) -> list[tuple[int, int]]:
    """About ``count`` pixels, one at random in each cell of a grid over the image: every part of it has its share."""
    side = max(1, round(count**0.5))
    share = torch.rand(side, side, 2, generator=generator).tolist()
    return [
        (int((i + v) * size[0] / side), int((j + u) * size[1] / side))
        for i, row in enumerate(share)
        for j, (v, u) in enumerate(row)
    ]


def _decibels(mse: Tensor) -> float:
    return float(-10 * torch.log10(mse))


def order(found: Mapping[str, Any], labels: Mapping[str, str]) -> list[dict[str, Any]]:
    """Spearman's rank correlation over codes, noise by noise and decoder by decoder, of what is predicted with what was
    measured; its sign is such that 1 is the right order."""
    from scipy.stats import spearmanr

    rows, own_rows = [], found["predicted"]
    for noise, decoder in dict.fromkeys((row["noise"], decoder) for row in own_rows for decoder in row["measured"]):
        own = [row for row in own_rows if row["noise"] == noise and decoder in row["measured"]]
        if len(own) < 3:
            continue
        row = {"noise": noise, "decoder": labels[decoder], "codes": len(own)}
        for name in (name for name, *_ in PREDICTED if all(name in one for one in own)):
            result, sign = _ORDERED.get(name, ("depth_mae", 1))
            predicted, made = [one[name] for one in own], [one["measured"][decoder][result] for one in own]
            row[name] = sign * float(spearmanr(predicted, made).statistic)
        rows.append(row)
    return rows
