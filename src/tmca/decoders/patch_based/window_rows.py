"""Overlapping windows of an image, row by row: where they are, and their blend in the memory of a few rows of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import pi

import torch
from torch import Tensor

_SHARPNESS = 4
_BATCH = 2048


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
    """Windows laid over each other with weights that fall to their rims.

    Rows of windows are added from top to bottom; rows of the image that no later window covers leave at once, so that
    the memory is that of one row of windows, whatever the image's height.

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
        self.held = like.new_zeros(len(like), channels, window, max(covered, rows.size[1]))
        self.weights = [
            _total(ramp, starts, length).to(like)
            for starts, length in zip((rows.tops, rows.lefts), rows.size, strict=True)
        ]

    def add(self, values: Tensor) -> tuple[slice, Tensor]:
        """Lay the next row of windows (B, P, C, m, m); returns the rows that are done and what they are,
        (B, C, rows, W)."""
        self._lay((values * self.share).permute(0, 2, 3, 1, 4))
        tops, top = self.rows.tops, self.rows.tops[self.next]
        self.next += 1
        end = tops[self.next] if self.next < len(tops) else self.rows.size[0]
        done, ready = slice(top, end), end - top
        weight = self.weights[0][done, None] * self.weights[1]
        image = self.held[..., :ready, : self.rows.size[1]] / weight
        self.held = self.held.roll(-ready, -2)
        self.held[..., -ready:, :] = 0
        return done, image

    def _lay(self, values: Tensor) -> None:
        """Add (B, C, m, P, m): equal parts of all windows that are a step apart lie side by side."""
        count, step, window = self.rows.regular, self.rows.step, self.rows.window
        for start in range(0, window, step):
            part = values[..., :count, start : start + step]
            place = self.held[..., start : start + count * step].unflatten(-1, (count, step))
            place[..., : part.shape[-1]] += part
        if count < len(self.rows.lefts):
            self.held[..., self.rows.lefts[-1] : self.rows.lefts[-1] + window] += values[..., -1, :]


class RowMean:
    """Mean of what windows say as a whole, with weights that fall with their distance from a pixel.

    Rows of windows are added from top to bottom; rows of the image leave as soon as no later window reaches them.

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
        spread = self.ramp[place.clamp(0, height - 1)] * ((place >= 0) & (place < height))
        self.spread = (spread / spread.sum(0)).to(like)
        self.weights = _total(self.ramp, rows.tops, rows.size[0] + 2 * reach).to(like)
        self.held = like.new_zeros(len(like), channels, height, rows.size[1])

    def add(self, values: Tensor) -> tuple[slice, Tensor]:
        """Take the next row of windows, (B, P, C); returns the rows that are done and their means, (B, C, rows, W)."""
        self.held += (values.transpose(1, 2) @ self.spread)[:, :, None] * self.ramp.to(values)[:, None]
        tops, top = self.rows.tops, self.rows.tops[self.next]
        self.next += 1
        end = tops[self.next] if self.next < len(tops) else self.rows.size[0] + 2 * self.reach
        first = max(top, self.reach)
        last = max(first, min(end, self.rows.size[0] + self.reach))
        image = self.held[..., first - top : last - top, :] / self.weights[first:last, None]
        self.held = self.held.roll(-(end - top), -2)
        self.held[..., self.held.shape[-2] - (end - top) :, :] = 0
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
