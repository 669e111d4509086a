"""First and second moments of scene blocks, from example scenes."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

from tmca.errors import DataError, ShapeError


def scenes(cubes: Iterable[Tensor], block: tuple[int, int], views: tuple[int, int] | None = None) -> list[Tensor]:
    """The example cubes (L, H, W) as float64, checked against each other, the block (h, w) and a grid of views (V, U).

    Raises:
        ShapeError: no cube, different band counts, a block larger than a cube, or another number of views.
        DataError: values that are not finite.
    """
    examples = [torch.as_tensor(cube).to(torch.float64) for cube in cubes]
    if not examples:
        raise ShapeError("cubes", "none", "at least one cube (L, H, W)")
    for i, cube in enumerate(examples):
        if cube.ndim != 3 or cube.shape[0] != examples[0].shape[0]:
            raise ShapeError(f"cube {i}", f"{tuple(cube.shape)}", f"(L, H, W) with L = {examples[0].shape[0]}")
        if min(block) < 1 or cube.shape[1] < block[0] or cube.shape[2] < block[1]:
            found, wanted = f"{tuple(cube.shape[1:])} pixels", f"at least the block {block}"
            raise ShapeError(f"cube {i}", found, wanted, "choose a smaller block")
        if not torch.isfinite(cube).all():
            raise DataError(f"cube {i}", "values that are not finite", "irradiance", "mask or fill them first")
    if views is not None and views[0] * views[1] != len(examples[0]):
        raise ShapeError("views", f"{views[0]}×{views[1]}", f"{len(examples[0])} in all, as the examples have")
    return examples


def autocovariance(examples: list[Tensor], block: tuple[int, int]) -> tuple[Tensor, Tensor]:
    """Mean (L, h, w) and covariance (L, L, h, w) by distance, averaged over every position and mirror image.

    Each cube is continued by its mirror images and correlated with itself around the resulting torus. That keeps the
    block covariance positive semidefinite, which averages over the pairs inside the frame alone do not.
    """
    (h, w), pixels = block, sum(cube[0].numel() for cube in examples)
    mean = sum((cube.sum((1, 2)) for cube in examples), torch.zeros(())) / pixels
    total = torch.zeros(len(mean), len(mean), h, w, dtype=torch.float64)
    for cube in examples:
        mirrored = torch.cat([cube, cube.flip(-1)], -1) - mean[:, None, None]
        spectrum = torch.fft.rfft2(torch.cat([mirrored, mirrored.flip(-2)], -2))
        torus = (2 * cube.shape[1], 2 * cube.shape[2])
        for band, other in enumerate(spectrum):
            # A mirrored torus holds four copies of the cube.
            total[band] += torch.fft.irfft2(other * spectrum.conj(), s=torus)[:, :h, :w] / 4
    total = (total + total.transpose(0, 1)) / (2 * pixels)
    return mean[:, None, None].expand(-1, h, w).clone(), total


def directed_autocovariance(
    examples: list[Tensor], block: tuple[int, int], views: tuple[int, int]
) -> tuple[Tensor, Tensor]:
    """Mean (L, h, w) and covariance (L, L, 2h-1, 2w-1) by displacement of light fields whose views are the channels.

    ``moments[c, o, h-1 + dy, w-1 + dx]`` is that of channel c at one pixel with channel o dy rows and dx columns on:
    what parallax couples depends on the direction. Averaged over every position and over what turns a light field into
    another one of the same depths: mirroring pixels and views together along an axis and, where views and block are
    square, exchanging the axes. Each example is dark beyond its frame, around its mean, which keeps the block
    covariance positive semidefinite.

    Args:
        examples: (V·U, H, W), views row by row.
        block: (h, w).
        views: (V, U).
    """
    (h, w), pixels = block, sum(cube[0].numel() for cube in examples)
    turned = h == w and views[0] == views[1]
    mean = sum((cube.sum((1, 2)) for cube in examples), torch.zeros(())) / pixels
    mean = _symmetric(mean.reshape(views), [(0,), (1,)], [1, 0] if turned else None).flatten()
    total = torch.zeros(len(mean), len(mean), 2 * h - 1, 2 * w - 1, dtype=torch.float64)
    rows, columns = torch.arange(1 - h, h), torch.arange(1 - w, w)
    for cube in examples:
        frame = (cube.shape[1] + h - 1, cube.shape[2] + w - 1)
        spectrum = torch.fft.rfft2(cube - mean[:, None, None], s=frame)
        for channel, one in enumerate(spectrum):
            total[channel] += torch.fft.irfft2(spectrum * one.conj(), s=frame)[:, rows[:, None], columns]
    grid = total.unflatten(1, views).unflatten(0, views) / pixels
    grid = _symmetric(grid, [(0, 2, 4), (1, 3, 5)], [1, 0, 3, 2, 5, 4] if turned else None)
    return mean[:, None, None].expand(-1, h, w).clone(), grid.flatten(2, 3).flatten(0, 1)


def _symmetric(values: Tensor, mirrors: list[tuple[int, ...]], exchange: list[int] | None) -> Tensor:
    """The mean over mirror images along groups of axes, and over an exchange of axes."""
    for axes in mirrors:
        values = (values + values.flip(axes)) / 2
    return values if exchange is None else (values + values.permute(exchange)) / 2


def two_sided(moments: Tensor) -> Tensor:
    """Covariance by distance (L, L, h, w) as one by displacement (L, L, 2h-1, 2w-1)."""
    both = torch.cat([moments[:, :, 1:].flip(2), moments], 2)
    return torch.cat([both[..., 1:].flip(3), both], 3)


def toeplitz_rows(moments: Tensor, pixels: Tensor) -> Tensor:
    """(..., n) covariances of the flat indices ``pixels`` (...) of a block with all of it, from its covariance by
    displacement (L, L, 2h-1, 2w-1)."""
    channels, h, w = moments.shape[0], (moments.shape[2] + 1) // 2, (moments.shape[3] + 1) // 2
    channel, row, column = torch.unravel_index(pixels, (channels, h, w))
    return moments.unfold(2, h, 1).unfold(3, w, 1)[channel, :, h - 1 - row, w - 1 - column].flatten(-3)


def random_blocks(
    examples: list[Tensor],
    block: tuple[int, int],
    count: int,
    seed: int,
    mirrored: bool,
    views: tuple[int, int] | None = None,
) -> Tensor:
    """(count, L, h, w) blocks at uniformly random places, each axis mirrored half of the time if ``mirrored``; where
    the channels are (V, U) views, together with these."""
    (h, w), generator = block, torch.Generator().manual_seed(seed)
    areas = torch.tensor([cube[0].numel() for cube in examples], dtype=torch.float64)
    chosen = torch.multinomial(areas, count, replacement=True, generator=generator).tolist()
    places = torch.rand(count, 2, generator=generator, dtype=torch.float64).tolist()
    flips = (torch.rand(count, 2, generator=generator) < 0.5).tolist()
    out = torch.empty(count, examples[0].shape[0], h, w, dtype=torch.float64)
    for i, (which, (v, u), flip) in enumerate(zip(chosen, places, flips, strict=True)):
        cube = examples[which]
        y, x = int(v * (cube.shape[1] - h + 1)), int(u * (cube.shape[2] - w + 1))
        axes = [axis for axis, turn in zip((-2, -1), flip, strict=True) if turn and mirrored]
        cut = cube[:, y : y + h, x : x + w].unflatten(0, views or (-1, 1))
        out[i] = cut.flip(axes + [axis - 2 for axis in axes if views]).flatten(0, 1)
    return out
