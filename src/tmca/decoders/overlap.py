"""Overlapping pieces of an image laid over each other: whole, or row by row in the memory of a few rows of pieces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import inf, pi

import torch
from torch import Tensor

from tmca.errors import SettingError
from tmca.priors.gaussian import BlockGrid

MERGES = ("median", "mean")
_SHARPNESS = 4
_BATCH = 2048


@dataclass
class Canvas:
    """Weighted sums of what blocks say about the padded frame.

    Args:
        total: (B, L, H, W) sum.
        weight: (L, H, W) sum of weights.
        window: (L, h, w) weight of each place in a block.
    """

    total: Tensor
    weight: Tensor
    window: Tensor

    @classmethod
    def blank(cls, grid: BlockGrid, batch: int, window: Tensor) -> Canvas:
        left, right, above, below = grid.padding
        shape = (window.shape[0], grid.frame[0] + above + below, grid.frame[1] + left + right)
        return cls(window.new_zeros(batch, *shape), window.new_zeros(shape), window)

    def add(self, top: int, left: int, values: Tensor) -> None:
        """Lay one block's values (B, L·h·w) with its corner at (top, left) of the padded frame."""
        _, h, w = self.window.shape
        area = (..., slice(top, top + h), slice(left, left + w))
        self.total[area] += self.window * values.unflatten(-1, self.window.shape)
        self.weight[area] += self.window

    def mean(self, grid: BlockGrid) -> Tensor:
        """(B, L, H, W) weighted mean on the frame."""
        left, _, above, _ = grid.padding
        frame = (..., slice(above, above + grid.frame[0]), slice(left, left + grid.frame[1]))
        return self.total[frame] / self.weight[frame]


class RowBuffer:
    """The rows of an image that later rows of pieces still reach.

    Args:
        values: (..., h, W) what an untouched row holds, as many rows as a piece has.
    """

    def __init__(self, values: Tensor) -> None:
        self.values, self._blank = values, values[..., :1, :].clone()

    def leave(self, count: int) -> Tensor:
        """Take out the first ``count`` rows; untouched ones come in at the other end."""
        done = self.values[..., :count, :].clone()
        self.values = self.values.roll(-count, -2)
        self.values[..., self.values.shape[-2] - count :, :] = self._blank
        return done


class MergedPatches:
    """Patches merged by the median or the mean of all that cover a pixel, row of patches by row of patches.

    Patches that may overlap lie in layers of their own, so the memory is that of the patches which cover one row of the
    image, whatever its height.

    Args:
        grid: of the patches.
        batch: B.
        merge: ``"median"`` or ``"mean"``.
        like: tensor whose type and device the image gets.

    Raises:
        SettingError: another merge.
    """

    def __init__(self, grid: BlockGrid, batch: int, merge: str, like: Tensor) -> None:
        if merge not in MERGES:
            raise SettingError("merge", repr(merge), f"one of {', '.join(MERGES)}")
        self.grid, self.merge = grid, merge
        channels, h, w = grid.model.block
        self.layers = (_layers(grid.tops, h), _layers(grid.lefts, w))
        self.buffer = RowBuffer(like.new_full((*self.layers, batch, channels, h, max(grid.lefts) + w), inf))
        self.row = 0

    def add(self, patches: Tensor) -> Tensor:
        """Lay the next row of patches (P, B, L, h, w); returns (B, L, rows, W) finished rows of the image."""
        slot, tops = self.row % self.layers[0], (*self.grid.tops, self.grid.frame[0])
        for i, (left, patch) in enumerate(zip(self.grid.lefts, patches, strict=True)):
            self.buffer.values[slot, i % self.layers[1], ..., left : left + patch.shape[-1]] = patch
        self.row += 1
        covers = self.buffer.leave(tops[self.row] - tops[self.row - 1])
        return merged(covers[..., : self.grid.frame[1]].flatten(0, 1), self.merge)


def merged(covers: Tensor, merge: str) -> Tensor:
    """(...) median or mean over the finite values along the first axis of covers (N, ...); ``inf`` marks gaps."""
    there = covers.isfinite()
    count = there.sum(0)
    if merge == "mean":
        return torch.where(there, covers, 0).sum(0) / count
    ranked = covers.sort(0).values
    lower, upper = (ranked.gather(0, (rank // 2)[None])[0] for rank in (count - 1, count))
    return (lower + upper) / 2


def _layers(starts: tuple[int, ...], length: int) -> int:
    """Layers so that patches of a length, dealt out in turn, never overlap in a layer."""
    for layers in range(1, len(starts)):
        if all(late - early >= length for early, late in zip(starts, starts[layers:], strict=False)):
            return layers
    return len(starts)


@dataclass(frozen=True)
class WindowRows:
    """Windows of m pixels that cover an image, a step apart, the last ones flush with its far edges.

    Args:
        size: (H, W) of the image, at least a window.
        window: m, pixels.
        step: pixels between windows, at most m; windows of equal corner modulo the step see equal codes.
    """

    size: tuple[int, int]
    window: int
    step: int

    @cached_property
    def tops(self) -> list[int]:
        """First rows, from top to bottom."""
        return self._starts(self.size[0])

    @cached_property
    def lefts(self) -> list[int]:
        """First columns, the same in every row of windows."""
        return self._starts(self.size[1])

    def _starts(self, length: int) -> list[int]:
        return sorted({*range(0, length - self.window + 1, self.step), length - self.window})

    @cached_property
    def regular(self) -> int:
        """How many windows of a row are a step apart; at most one more is flush with the right edge."""
        return len(range(0, self.size[1] - self.window + 1, self.step))

    def batches(self) -> Iterator[list[int]]:
        """Rows of windows of equal phase, from top to bottom, as many together as are worth a matrix product."""
        together, batch = max(1, _BATCH // len(self.lefts)), list[int]()
        for top in self.tops:
            if batch and (len(batch) == together or (top - batch[0]) % self.step):
                yield batch
                batch = []
            batch.append(top)
        yield batch

    def columns(self) -> Iterator[tuple[int, slice]]:
        """Phase of the windows of a row, and which of them have it."""
        yield 0, slice(0, self.regular)
        if self.regular < len(self.lefts):
            yield self.lefts[-1] % self.step, slice(self.regular, None)

    def cut(self, image: Tensor, top: int, which: slice) -> Tensor:
        """(B, P, C·m·m) windows of an image (B, C, H, W) that begin in this row, some of its columns, float64."""
        strip = image[:, :, top : top + self.window].unfold(3, self.window, 1)
        return strip[:, :, :, self.lefts[which]].permute(0, 3, 1, 2, 4).flatten(2).double()


class RowBlend:
    """Windows laid over each other with weights that fall to their rims, row of windows by row of windows.

    Args:
        rows: where the windows are.
        like: a tensor (B, …) of the type that is summed in.
        channels: C.
    """

    def __init__(self, rows: WindowRows, like: Tensor, channels: int) -> None:
        self.rows, self.next, window = rows, 0, rows.window
        ramp = _ramp(window, like)
        self.share = torch.outer(ramp, ramp).to(like)
        covered = (rows.regular + -(-window // rows.step) - 1) * rows.step
        self.buffer = RowBuffer(like.new_zeros(len(like), channels, window, max(covered, rows.size[1])))
        self.weights = [
            _total(ramp, starts, length).to(like)
            for starts, length in zip((rows.tops, rows.lefts), rows.size, strict=True)
        ]

    def add(self, values: Tensor) -> tuple[slice, Tensor]:
        """Lay the next row of windows (B, P, C, m, m); returns the rows that are done and what they are,
        (B, C, rows, W)."""
        self._lay((values * self.share).permute(0, 2, 3, 1, 4))
        tops = (*self.rows.tops, self.rows.size[0])
        done = slice(tops[self.next], tops[self.next + 1])
        self.next += 1
        weight = self.weights[0][done, None] * self.weights[1]
        return done, self.buffer.leave(done.stop - done.start)[..., : self.rows.size[1]] / weight

    def _lay(self, values: Tensor) -> None:
        """Add (B, C, m, P, m): equal parts of all windows that are a step apart lie side by side."""
        count, step, window = self.rows.regular, self.rows.step, self.rows.window
        for start in range(0, window, step):
            part = values[..., :count, start : start + step]
            place = self.buffer.values[..., start : start + count * step].unflatten(-1, (count, step))
            place[..., : part.shape[-1]] += part
        if count < len(self.rows.lefts):
            self.buffer.values[..., self.rows.lefts[-1] : self.rows.lefts[-1] + window] += values[..., -1, :]


class RowMean:
    """Mean of what windows say as a whole, with weights that fall with their distance from a pixel, row by row.

    Args:
        rows: where the windows are.
        like: a tensor (B, …) of the type that is summed in.
        channels: C.
        reach: pixels beyond its rim at which a window still counts.
    """

    def __init__(self, rows: WindowRows, like: Tensor, channels: int, reach: int = 0) -> None:
        self.rows, self.reach, self.next, height = rows, reach, 0, rows.window + 2 * reach
        self.ramp = _ramp(height, like)
        lefts, across = (torch.tensor(rows.lefts), torch.arange(rows.size[1]))
        place = (across - lefts[:, None] + reach).to(like.device)
        share = self.ramp[place.clamp(0, height - 1)] * ((place >= 0) & (place < height))
        self.share = (share / share.sum(0)).to(like)
        self.weights = _total(self.ramp, rows.tops, rows.size[0] + 2 * reach).to(like)
        self.buffer = RowBuffer(like.new_zeros(len(like), channels, height, rows.size[1]))

    def add(self, values: Tensor) -> tuple[slice, Tensor]:
        """Take the next row of windows, (B, P, C); returns the rows that are done and their means, (B, C, rows, W)."""
        self.buffer.values += (values.transpose(1, 2) @ self.share)[:, :, None] * self.ramp.to(values)[:, None]
        tops, height = (*self.rows.tops, self.rows.size[0] + 2 * self.reach), self.rows.size[0]
        top, end = tops[self.next : self.next + 2]
        self.next += 1
        first = max(top, self.reach)
        last = max(first, min(end, height + self.reach))
        image = self.buffer.leave(end - top)[..., first - top : last - top, :] / self.weights[first:last, None]
        return slice(first - self.reach, last - self.reach), image


def _ramp(length: int, like: Tensor) -> Tensor:
    """(length,) weights along an axis, float64."""
    return torch.sin(pi * (torch.arange(length, dtype=torch.float64, device=like.device) + 0.5) / length) ** _SHARPNESS


def _total(ramp: Tensor, starts: list[int], length: int) -> Tensor:
    """(length,) sum of the weights of all windows along an axis."""
    total = ramp.new_zeros(length)
    for start in starts:
        total[start : start + len(ramp)] += ramp
    return total
