"""Expected error of a code under a Gaussian prior, before anything is captured."""

from __future__ import annotations

import torch
from torch import Tensor

from tmca.errors import SettingError
from tmca.operators.taps import Taps
from tmca.priors.blocks import BlockGrid, BlockModel
from tmca.priors.gaussian import GaussianPrior
from tmca.priors.posterior import GaussianSolver

_TOGETHER = 8
"""Blocks whose matrices are held at once."""


def expected_mse(
    prior: GaussianPrior,
    taps: Taps,
    read_noise: float = 0.0,
    shot: float = 0.0,
    *,
    period: tuple[int, int] | None = None,
    blocks: int = 32,
    seed: int = 0,
    dtype: torch.dtype = torch.float64,
) -> Tensor:
    """Expected mean squared error of the linear estimate of single blocks; differentiable in ``taps.code``.

    The mean of the posterior variance over the judged columns of the blocks, over ``blocks`` random places of the
    frame, or every phase of a tiled code where its ``period`` (rows, columns) is given. Overlapping blocks, blended,
    do somewhat better than this.

    Args:
        read_noise: standard deviation, in snapshot units.
        shot: variance of the shot noise per snapshot unit (full scale / full well).

    Returns:
        Scalar, in squared irradiance. ``-10 log10`` of it is the expected PSNR.

    Raises:
        ShapeError: the prior's bands or block do not fit the taps.
        SettingError: negative noise, or no blocks.
    """
    if blocks < 1:
        raise SettingError("blocks", f"{blocks}", "at least 1")
    model = BlockModel.of(taps, prior.block)
    height, width = taps.code.shape[1:]
    grid = BlockGrid.cover(model, (height, width), (height, width))
    places = _phases(grid, period) if period else _places(grid, blocks, seed)
    solver, padded = GaussianSolver(prior, model, read_noise, shot, dtype), grid.pad_code(taps.code)
    first, last = model.judged
    total = padded.new_zeros((), dtype=dtype)
    for start in range(0, len(places), _TOGETHER):
        windows = grid.code_windows(padded, places[start : start + _TOGETHER])
        variance = solver.posterior(windows).error_variance().unflatten(1, prior.block)
        total = total + variance[..., first:last].mean((1, 2, 3)).sum()
    return total / len(places)


def expected_psnr(prior: GaussianPrior, taps: Taps, read_noise: float = 0.0, shot: float = 0.0, **where: int) -> float:
    """``expected_mse`` as a peak signal-to-noise ratio in dB."""
    return float(-10 * torch.log10(expected_mse(prior, taps, read_noise, shot, **where)))  # type: ignore[arg-type]


def _places(grid: BlockGrid, count: int, seed: int) -> list[tuple[int, int]]:
    """Corners (top, left) of ``count`` blocks, uniformly random over the frame."""
    generator = torch.Generator().manual_seed(seed)
    share = torch.rand(count, 2, generator=generator).tolist()
    (top, bottom), (left, right) = (grid.tops[0], grid.tops[-1]), (grid.lefts[0], grid.lefts[-1])
    return [(top + int(v * (bottom - top + 1)), left + int(u * (right - left + 1))) for v, u in share]


def _phases(grid: BlockGrid, period: tuple[int, int]) -> list[tuple[int, int]]:
    """Corners of one block at each phase of the tile, inside the frame; a frame too small for a phase leaves it out."""
    rows = min(period[0], grid.tops[-1] - grid.tops[0] + 1)
    columns = min(period[1], grid.lefts[-1] - grid.lefts[0] + 1)
    return [(grid.tops[0] + y, grid.lefts[0] + x) for y in range(rows) for x in range(columns)]
