"""Covariances of blocks that depend on the displacement of two pixels alone, without a row for every pixel.

Where all blocks see other parts of a code, the covariance of their measurements and its products with blocks are all
that a linear estimate takes.
"""

from __future__ import annotations

import torch
from torch import Tensor

from tmca.operators.blocks import BlockModel


class MeasurementCovariance:
    """Covariance A S Aᵀ of the measurements of blocks.

    Args:
        displaced: (L, L, 2h-1, 2w-1) covariance of two pixels by their channels and displacement.
        model: geometry of the camera's taps on the blocks.
    """

    def __init__(self, displaced: Tensor, model: BlockModel) -> None:
        self.model = model
        _, h, w = model.block
        column, offset, channel = torch.arange(model.columns), torch.tensor(model.offsets), torch.tensor(model.channels)
        across = (column[None, None, None] - column[:, None, None, None]) + (offset[:, None, None] - offset[:, None])
        rows = displaced[channel[:, None], channel].movedim(2, 0)[h - 1 :]
        one, other = torch.arange(len(offset))[:, None, None], torch.arange(len(offset))[:, None]
        self.between = [row[one, other, w - 1 + across].flatten(2) for row in rows]
        """Of rows d apart: (columns, T, T·columns) of the light of two taps on two columns."""

    def __call__(self, weights: Tensor) -> Tensor:
        """(P, m, m) of blocks whose taps have the weights (P, T, R·h, columns)."""
        buckets, h, columns = self.model.buckets, self.model.block[1], self.model.columns
        every = weights.unflatten(2, (buckets, h))
        first, second = every.permute(4, 0, 2, 3, 1).contiguous(), every.permute(2, 0, 3, 1, 4).contiguous()
        total = weights.new_zeros(len(weights), buckets, h, columns, buckets, h, columns)
        for apart, between in enumerate(self.between):
            upper = total.diagonal(apart, 2, 5)
            share = 0.5 if apart == 0 else 1.0
            for column in range(columns):
                light = (first[column, :, :, : h - apart] @ between[column]).unflatten(-1, (-1, columns))
                for bucket in range(buckets):
                    pairs = (light * second[bucket, :, None, apart:]).sum(-2)
                    upper[:, :, column, bucket] = (share * pairs).movedim(-1, 2)
        whole = total.reshape(len(weights), self.model.measurements, -1)
        return whole + whole.mT


class Smoothing:
    """Products S x of the covariance with blocks, by Fourier transforms.

    Args:
        displaced: (L, L, 2h-1, 2w-1) covariance of two pixels by their channels and displacement.
    """

    def __init__(self, displaced: Tensor) -> None:
        channels, h, w = len(displaced), (displaced.shape[2] + 1) // 2, (displaced.shape[3] + 1) // 2
        self.block, self.sides = (channels, h, w), (2 * h, 2 * w)
        kernel = torch.nn.functional.pad(displaced.flip(2, 3), (0, 1, 0, 1))
        spectrum = torch.fft.rfft2(kernel.roll((1 - h, 1 - w), (2, 3)))
        self.spectrum = spectrum.permute(2, 3, 1, 0).flatten(0, 1).contiguous()

    def __call__(self, blocks: Tensor) -> Tensor:
        """(N, n) of blocks (N, n)."""
        waves = torch.fft.rfft2(blocks.unflatten(-1, self.block), self.sides)
        shape = waves.shape[2:]
        smooth = waves.flatten(2).permute(2, 0, 1) @ self.spectrum
        values = torch.fft.irfft2(smooth.permute(1, 2, 0).unflatten(-1, shape), self.sides)
        return values[..., : self.block[1], : self.block[2]].flatten(1)


def displacement_pays(model: BlockModel, estimates: float, variance: bool) -> bool:
    """Whether blocks are solved faster so than by rows of the covariance, where each is to be estimated so often.

    Operations are weighted by the time that they take on a processor.

    Args:
        variance: of valid columns is asked for too.
    """
    (channels, h, w), m, taps = model.block, model.measurements, len(model.offsets)
    first, last = model.valid
    row = 2 * m * taps * channels * h
    by_rows = row * w + 20 * taps * m**2 + estimates * m * channels * h * w / 4
    waves = estimates * 16 * 2 * h * (w + 1) * channels**2
    return (taps * m) ** 2 + waves + variance * row * (last - first) < by_rows
