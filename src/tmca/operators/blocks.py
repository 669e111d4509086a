"""What blocks of a scene explain of a snapshot, where they are laid over a frame, and what is known of them beforehand.

A block (L, h, w) explains the snapshot's columns whose light comes wholly from inside it; the others are left to the
blocks that see them whole. Blocks may hang over the image's edge, where the code is zero.

Covariances that depend on the displacement of two pixels alone need no row for every pixel: where all blocks see other
parts of a code, the covariance of their measurements and its products with blocks are all that a linear estimate takes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from tmca.errors import ShapeError
from tmca.operators.taps import Taps


@dataclass(frozen=True)
class BlockModel:
    """Geometry shared by every block of shape (L, h, w) under the same taps.

    Measurement (r, i, c) of a block is bucket r of snapshot row i and the c-th complete column.

    Args:
        block: (L, h, w).
        channels: channel of each tap of a bucket.
        offsets: offset of each tap past the smallest one, in pixels.
        origin: the smallest offset, in pixels.
        buckets: number R of buckets of a sensor pixel.
    """

    block: tuple[int, int, int]
    channels: tuple[int, ...]
    offsets: tuple[int, ...]
    origin: int
    buckets: int = 1

    @classmethod
    def of(cls, taps: Taps, block: tuple[int, int, int]) -> BlockModel:
        """The model of blocks (L, h, w) seen through ``taps``.

        Raises:
            ShapeError: other channel count, or a block no wider than the dispersion.
        """
        origin, span = min(taps.offsets), max(taps.offsets) - min(taps.offsets)
        if block[0] != taps.scene_channels:
            found, wanted = f"{block[0]} channels", f"the {taps.scene_channels} of the codes"
            raise ShapeError("prior", found, wanted, "learn the prior on the same bands")
        if block[2] <= span:
            found, wanted = f"blocks {block[2]} columns wide", f"more than the dispersion of {span}"
            raise ShapeError("prior", found, wanted, "learn wider blocks")
        offsets = tuple(o - origin for o in taps.of_bucket(taps.offsets))
        return cls(block, taps.of_bucket(taps.channels), offsets, origin, taps.buckets)

    def for_buckets(self, buckets: int) -> BlockModel:
        """The same blocks before a sensor with another number of buckets a pixel."""
        return replace(self, buckets=buckets)

    @cached_property
    def span(self) -> int:
        """Columns between the first and the last tap."""
        return max(self.offsets)

    @property
    def columns(self) -> int:
        """Complete snapshot columns of a block."""
        return self.block[2] - self.span

    @property
    def measurements(self) -> int:
        """Complete measurements of a block."""
        return self.buckets * self.block[1] * self.columns

    @cached_property
    def valid(self) -> tuple[int, int]:
        """First and one-past-last block column whose light lands on complete snapshot columns in the most taps."""
        count = [sum(self.span <= x + o < self.block[2] for o in self.offsets) for x in range(self.block[2])]
        seen = [x for x, taps in enumerate(count) if taps == max(count)]
        return seen[0], seen[-1] + 1

    def in_valid(self, values: Tensor) -> Tensor:
        """The part of values (..., L·h·w) that belongs to the valid columns, flat again."""
        first, last = self.valid
        return values.unflatten(-1, self.block)[..., first:last].flatten(-3)

    def pixels(self) -> Tensor:
        """(measurements, taps) flat index, in the block, of the pixel that each tap brings to each measurement."""
        (_, h, w), row = self.block, torch.arange(self.block[1])[:, None, None]
        column = self.span + torch.arange(self.columns)[None, :, None] - torch.tensor(self.offsets)
        seen = (torch.tensor(self.channels) * h * w + row * w + column).flatten(0, 1)
        return seen.repeat(self.buckets, 1)

    def complete(self, windows: Tensor) -> Tensor:
        """(P, T, R·h, columns) the part of code windows (P, R·T, h, w) that feeds the complete measurements: weights of
        the T taps of a bucket, the rows of all buckets below each other."""
        if windows.shape[1] != self.buckets * len(self.offsets):
            found, expected = f"{windows.shape[1]} taps", f"{len(self.offsets)} for each of {self.buckets} buckets"
            raise ShapeError("code", found, expected, "take a model of this camera")
        every = windows.unflatten(1, (self.buckets, -1))
        parts = [every[:, :, t, :, self.span - o : self.span - o + self.columns] for t, o in enumerate(self.offsets)]
        return torch.stack(parts, 1).flatten(2, 3)

    def measure(self, weights: Tensor, blocks: Tensor) -> Tensor:
        """A applied to blocks (..., P, n), with weights (P, T, R·h, columns): (..., P, measurements)."""
        bands, weights = blocks.unflatten(-1, self.block).unbind(-3), weights.unflatten(2, (self.buckets, -1))
        total = blocks.new_zeros(*blocks.shape[:-1], self.buckets, self.block[1], self.columns)
        for t, (channel, o) in enumerate(zip(self.channels, self.offsets, strict=True)):
            light = bands[channel][..., None, :, self.span - o : self.span - o + self.columns]
            total = torch.addcmul(total, light, weights[:, t])
        return total.flatten(-3)

    def correlate(self, measured: Tensor, blocks: Tensor) -> Tensor:
        """(P, T, R·h, columns) gradient in the weights of ``measure`` of blocks (N, P, n), given the gradient
        ``measured`` (N, P, m) in what it makes."""
        bands, seen = blocks.unflatten(-1, self.block), measured.unflatten(-1, (self.buckets, -1, self.columns))
        parts = [
            (bands[:, :, channel, None, :, self.span - o : self.span - o + self.columns] * seen).sum(0)
            for channel, o in zip(self.channels, self.offsets, strict=True)
        ]
        return torch.stack(parts, 1).flatten(2, 3)

    def spread(self, weights: Tensor, measured: Tensor) -> Tensor:
        """(N, n) Aᵀ of measurements (N, m) of blocks whose taps have weights (N, T, R·h, columns)."""
        sides = (self.buckets, self.block[1], self.columns)
        light = (weights.unflatten(2, sides[:2]) * measured.unflatten(-1, sides)[:, None]).sum(2)
        blocks = measured.new_zeros(len(measured), *self.block)
        for t, (channel, o) in enumerate(zip(self.channels, self.offsets, strict=True)):
            blocks[:, channel, :, self.span - o : self.span - o + self.columns] += light[:, t]
        return blocks.flatten(1)

    def cross_covariance(self, weights: Tensor, rows: Tensor, some: slice = slice(None)) -> Tensor:
        """(measurements, P, n) covariance A S of ``some`` of the measurements with pixels; ``rows`` is
        ``covariance[pixels()]`` of these."""
        return torch.bmm(weights.permute(2, 3, 0, 1).flatten(0, 1)[some], rows)


@dataclass(frozen=True)
class BlockGrid:
    """Where blocks are laid over a frame: corners may hang over its edges.

    Args:
        model: geometry of one block.
        frame: (H, W) of the scene.
        tops: first row of each row of blocks.
        lefts: first column of each column of blocks, may be negative.
    """

    model: BlockModel
    frame: tuple[int, int]
    tops: tuple[int, ...]
    lefts: tuple[int, ...]

    @classmethod
    def cover(cls, model: BlockModel, frame: tuple[int, int], stride: tuple[int, int]) -> BlockGrid:
        """Blocks ``stride`` (rows, columns) apart, the last ones flush, whose valid columns cover the frame."""
        (_, h, _), (first, last) = model.block, model.valid
        tops = _starts(frame[0] - h, stride[0])
        lefts = [x - first for x in _starts(frame[1] - (last - first), min(stride[1], model.columns, last - first))]
        return cls(model, frame, tuple(tops), tuple(lefts))

    @property
    def positions(self) -> list[tuple[int, int]]:
        """(top, left) of every block, row by row."""
        return [(top, left) for top in self.tops for left in self.lefts]

    @cached_property
    def padding(self) -> tuple[int, int, int, int]:
        """Zeros to add left, right, above and below the frame so that every block lies inside."""
        _, h, w = self.model.block
        right, below = max(self.lefts) + w - self.frame[1], max(self.tops) + h - self.frame[0]
        return max(0, -min(self.lefts)), max(0, right), 0, max(0, below)

    def pad_code(self, code: Tensor) -> Tensor:
        """A code (taps, H, W) with zeros around, where blocks hang over the frame."""
        return torch.nn.functional.pad(code, self.padding)

    def pad_snapshot(self, snapshot: Tensor) -> Tensor:
        """Snapshots (B, R, H, W') with zeros around: no light falls there."""
        left, _, _, below = self.padding
        right = max(0, max(self.lefts) + self.model.block[2] + self.model.origin - snapshot.shape[-1])
        return torch.nn.functional.pad(snapshot, (left, right, 0, below))

    def code_windows(self, padded: Tensor, positions: list[tuple[int, int]]) -> Tensor:
        """(P, taps, h, w) windows of a padded code."""
        (_, h, w), left = self.model.block, self.padding[0]
        return torch.stack([padded[:, y : y + h, x + left : x + left + w] for y, x in positions])

    def snapshot_windows(self, padded: Tensor, positions: list[tuple[int, int]]) -> Tensor:
        """(P, B, measurements) complete measurements of each block in padded snapshots."""
        model, first = self.model, self.padding[0] + self.model.origin + self.model.span
        views = [padded[..., y : y + model.block[1], x + first : x + first + model.columns] for y, x in positions]
        return torch.stack(views).flatten(2)


def _starts(slack: int, stride: int) -> list[int]:
    """0, stride, 2·stride … and ``slack`` itself as the last; [0] where there is no slack."""
    return [*range(0, slack, stride), max(0, slack)]


class MeasurementCovariance:
    """Covariance A S Aᵀ of the measurements of blocks.

    Args:
        displaced: (L, L, 2h-1, 2w-1) covariance of two pixels by their channels and displacement.
        model: geometry of the camera's taps on the blocks.
    """

    def __init__(self, displaced: Tensor, model: BlockModel) -> None:
        self.model = model
        h, offset, channel = model.block[1], torch.tensor(model.offsets), torch.tensor(model.channels)
        rows = displaced[channel[:, None], channel].movedim(2, 0)[h - 1 :]
        place = model.span + offset[:, None, None] - offset[:, None] + torch.arange(2 * model.columns - 1)
        self.between = [row.gather(2, place) for row in rows]
        """Of rows d apart: (T, T, 2·columns-1) of the light of two taps, by the distance of their columns."""

    def _from(self, apart: int, column: int) -> Tensor:
        """(T, T·columns) of the light on a column with that on all columns of the row so many rows below."""
        last = self.model.columns - 1 - column
        return self.between[apart][..., last : last + self.model.columns].flatten(1)

    def _sides(self, weights: Tensor) -> tuple[Tensor, Tensor]:
        """Weights of the first and of the second measurements: (columns, h, P, R, T) and (R, h, P, T, columns)."""
        every = weights.unflatten(2, (self.model.buckets, self.model.block[1]))
        return every.permute(4, 3, 0, 2, 1).contiguous(), every.permute(2, 3, 0, 1, 4).contiguous()

    def __call__(self, weights: Tensor) -> Tensor:
        """(P, m, m) of blocks whose taps have the weights (P, T, R·h, columns)."""
        buckets, h, columns = self.model.buckets, self.model.block[1], self.model.columns
        first, second = self._sides(weights)
        total = weights.new_empty(len(weights), buckets, h, columns, buckets, h, columns)
        for apart in range(h):
            upper, lower = total.diagonal(apart, 2, 5), total.diagonal(-apart, 2, 5)
            for column in range(columns):
                light = (first[column, : h - apart] @ self._from(apart, column)).unflatten(-1, (-1, columns))
                for bucket in range(buckets):
                    pairs = (light * second[bucket, apart:, :, None]).sum(-2)
                    upper[:, :, column, bucket] = pairs.permute(1, 2, 3, 0)
                    if apart:
                        lower[:, bucket, :, :, column] = pairs.permute(1, 3, 2, 0)
        return total.reshape(len(weights), self.model.measurements, -1)

    def slope(self, weights: Tensor, gradient: Tensor) -> Tensor:
        """(P, T, R·h, columns) gradient in the weights, given the ``gradient`` (P, m, m) in the covariance."""
        sides = (self.model.buckets, self.model.block[1], self.model.columns)
        first, second = self._sides(weights)
        of_first, of_second = torch.zeros_like(first), torch.zeros_like(second)
        owed = (gradient + gradient.mT).unflatten(2, sides).unflatten(1, sides)
        for apart in range(sides[1]):
            pairs = owed.diagonal(apart, 2, 5).permute(2, 3, 5, 0, 1, 4).contiguous()
            above, below = slice(sides[1] - apart), slice(apart, None)
            for column, shares in enumerate(pairs):
                between = self._from(apart, column)
                light = (first[column, above] @ between).unflatten(-1, (-1, sides[2]))
                for bucket, share in enumerate(shares[..., None, :]):
                    of_second[bucket, below] += (light * share).sum(2)
                    if apart:
                        of_first[column, above] += (second[bucket, below, :, None] * share).flatten(-2) @ between.mT
        return (of_first.permute(2, 4, 3, 1, 0) + of_second.permute(2, 3, 0, 1, 4)).flatten(2, 3)


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
    waves = estimates * 64 * h * (w + 1) * channels**2
    return (taps * m) ** 2 + waves + variance * row * (last - first) < by_rows
