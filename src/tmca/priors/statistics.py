"""First and second moments of scene blocks, from example scenes."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

from tmca.errors import DataError, ShapeError


def scenes(cubes: Iterable[Tensor], block: tuple[int, int]) -> list[Tensor]:
    """The example cubes (L, H, W) as float64, checked against each other and the block (h, w).

    Raises:
        ShapeError: no cube, different band counts, or a block larger than a cube.
        DataError: values that are not finite.
    """
    examples = [torch.as_tensor(cube).to(torch.float64) for cube in cubes]
    if not examples:
        raise ShapeError("cubes", "none", "at least one cube (L, H, W)")
    for i, cube in enumerate(examples):
        if cube.ndim != 3 or cube.shape[0] != examples[0].shape[0]:
            raise ShapeError(f"cube {i}", f"{tuple(cube.shape)}", f"(L, H, W) with L = {examples[0].shape[0]}")
        if min(block) < 1 or cube.shape[1] < block[0] or cube.shape[2] < block[1]:
            raise ShapeError(
                f"cube {i}",
                f"{tuple(cube.shape[1:])} pixels",
                f"at least the block {block}",
                "choose a smaller block",
            )
        if not torch.isfinite(cube).all():
            raise DataError(f"cube {i}", "values that are not finite", "irradiance", "mask or fill them first")
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


def toeplitz(moments: Tensor) -> Tensor:
    """(n, n) covariance of a block from its covariance by distance (L, L, h, w)."""
    channels, _, h, w = moments.shape
    rows, columns = torch.arange(h), torch.arange(w)
    dy, dx = (rows[:, None] - rows).abs(), (columns[:, None] - columns).abs()
    full = moments[:, :, dy[:, None, :, None], dx[None, :, None, :]]
    return full.permute(0, 2, 3, 1, 4, 5).reshape(channels * h * w, -1)


def toeplitz_rows(moments: Tensor, pixels: Tensor) -> Tensor:
    """Rows (..., n) of ``toeplitz`` that belong to the flat indices ``pixels`` (...)."""
    channels, _, h, w = moments.shape
    both = torch.cat([moments[:, :, 1:].flip(2), moments], 2)
    both = torch.cat([both[..., 1:].flip(3), both], 3)
    channel, row, column = torch.unravel_index(pixels, (channels, h, w))
    return both.unfold(2, h, 1).unfold(3, w, 1)[channel, :, h - 1 - row, w - 1 - column].flatten(-3)


def random_blocks(examples: list[Tensor], block: tuple[int, int], count: int, seed: int, mirrored: bool) -> Tensor:
    """(count, L, h, w) blocks at uniformly random places, each axis mirrored half of the time if ``mirrored``."""
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
        out[i] = cube[:, y : y + h, x : x + w].flip(axes)
    return out


def sample_moments(examples: list[Tensor], block: tuple[int, int], count: int, seed: int) -> tuple[Tensor, Tensor]:
    """Mean (L, h, w) and covariance (n, n) of ``count`` random blocks, mirrored at random."""
    mean, square, batch = torch.zeros(()), torch.zeros(()), 4000
    for start in range(0, count, batch):
        part = random_blocks(examples, block, min(batch, count - start), seed + start, mirrored=True).flatten(1)
        mean, square = mean + part.sum(0), square + part.mT @ part
    mean = mean / count
    return mean.reshape(-1, *block), square / count - torch.outer(mean, mean)
