"""Windows of an image laid over each other row by row, in the memory of a few rows of them."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

import torch
from torch import Tensor

_SHARPNESS = 4
_BATCH = 2048


class RowBuffer:
    """The rows (..., h, W) of an image that later rows of pieces, each of h rows, still reach."""

    def __init__(self, values: Tensor) -> None:
        self.values, self._blank = values, values[..., :1, :].clone()

    def leave(self, count: int) -> Tensor:
        """Take out the first ``count`` rows; untouched ones come in at the other end."""
        done = self.values[..., :count, :].clone()
        self.values = self.values.roll(-count, -2)
        self.values[..., self.values.shape[-2] - count :, :] = self._blank
        return done


class WindowRows:
    """Windows of m pixels that cover an image, a step apart, the last ones flush with its far edges.

    ``tops`` and ``lefts`` are their first rows and columns; ``regular`` windows of a row are a step apart, and at most
    one more is flush with the right edge.

    Args:
        size: (H, W) of the image, at least a window.
        window: m, pixels.
        step: pixels between windows, at most m; windows of equal corner modulo the step see equal codes.
    """

    def __init__(self, size: tuple[int, int], window: int, step: int) -> None:
        self.size, self.window, self.step = size, window, step
        self.tops, self.lefts = (sorted({*range(0, n - window + 1, step), n - window}) for n in size)
        self.regular = len(range(0, size[1] - window + 1, step))

    def batches(self) -> Iterator[tuple[list[int], list[tuple[tuple[int, int], slice]]]]:
        """Rows of windows of equal phase, from top to bottom, as many together as are worth a matrix product; and the
        phases (row, column) of their windows, with which of a row have them."""
        together, batch = max(1, _BATCH // len(self.lefts)), list[int]()
        for top in self.tops:
            if batch and (len(batch) == together or (top - batch[0]) % self.step):
                yield batch, self._phases(batch[0])
                batch = []
            batch.append(top)
        yield batch, self._phases(batch[0])

    def _phases(self, top: int) -> list[tuple[tuple[int, int], slice]]:
        row = top % self.step
        phases = [((row, 0), slice(0, self.regular)), ((row, self.lefts[-1] % self.step), slice(self.regular, None))]
        return phases if self.regular < len(self.lefts) else phases[:1]

    def cut(self, image: Tensor, tops: list[int], which: slice) -> Tensor:
        """(B, R, P, C·m·m) windows of an image (B, C, H, W) that begin in some rows and columns, float64."""
        strips = torch.stack([image[:, :, top : top + self.window] for top in tops], 1)
        windows = strips.unfold(4, self.window, 1)[:, :, :, :, self.lefts[which]]
        return windows.permute(0, 1, 4, 2, 3, 5).flatten(3).double()


class _RowSum:
    """A sum of windows that is filled and left row of windows by row of windows.

    It is ``like`` a tensor (B, …) in batch and type; a window still counts ``reach`` pixels beyond its rim.
    """

    def __init__(self, rows: WindowRows, like: Tensor, channels: int, reach: int, width: int) -> None:
        self.rows, self.reach, self.next, height = rows, reach, 0, rows.window + 2 * reach
        self.ramp = _ramp(height, like)
        self.weights = _total(self.ramp, rows.tops, rows.size[0] + 2 * reach).to(like)
        self.buffer = RowBuffer(like.new_zeros(len(like), channels, height, width))

    def _leave(self) -> tuple[slice, Tensor]:
        """The rows that no later window reaches, and what they are, (B, C, rows, width)."""
        tops, height = (*self.rows.tops, self.rows.size[0] + 2 * self.reach), self.rows.size[0]
        top, end = tops[self.next : self.next + 2]
        self.next += 1
        first = max(top, self.reach)
        last = max(first, min(end, height + self.reach))
        image = self.buffer.leave(end - top)[..., first - top : last - top, :] / self.weights[first:last, None]
        return slice(first - self.reach, last - self.reach), image


class RowBlend(_RowSum):
    """Windows laid over each other with weights that fall to their rims."""

    def __init__(self, rows: WindowRows, like: Tensor, channels: int) -> None:
        covered = (rows.regular + -(-rows.window // rows.step) - 1) * rows.step
        super().__init__(rows, like, channels, 0, max(covered, rows.size[1]))
        self.share = torch.outer(self.ramp, self.ramp).to(like)
        self.across = _total(self.ramp, rows.lefts, rows.size[1]).to(like)

    def add(self, values: Tensor) -> tuple[slice, Tensor]:
        """Lay the next row of windows (B, P, C, m, m); returns the rows that are done and what they are,
        (B, C, rows, W)."""
        self._lay((values * self.share).permute(0, 2, 3, 1, 4))
        done, image = self._leave()
        return done, image[..., : self.rows.size[1]] / self.across

    def _lay(self, values: Tensor) -> None:
        """Add (B, C, m, P, m): equal parts of all windows that are a step apart lie side by side."""
        count, step, window = self.rows.regular, self.rows.step, self.rows.window
        for start in range(0, window, step):
            part = values[..., :count, start : start + step]
            place = self.buffer.values[..., start : start + count * step].unflatten(-1, (count, step))
            place[..., : part.shape[-1]] += part
        if count < len(self.rows.lefts):
            self.buffer.values[..., self.rows.lefts[-1] : self.rows.lefts[-1] + window] += values[..., -1, :]


class RowMean(_RowSum):
    """Mean of what windows say as a whole, with weights that fall with their distance from a pixel."""

    def __init__(self, rows: WindowRows, like: Tensor, channels: int, reach: int = 0) -> None:
        super().__init__(rows, like, channels, reach, rows.size[1])
        lefts, across = (torch.tensor(rows.lefts), torch.arange(rows.size[1]))
        place = (across - lefts[:, None] + reach).to(like.device)
        share = self.ramp[place.clamp(0, len(self.ramp) - 1)] * ((place >= 0) & (place < len(self.ramp)))
        self.share = (share / share.sum(0)).to(like)

    def add(self, values: Tensor) -> tuple[slice, Tensor]:
        """Take the next row of windows, (B, P, C); returns the rows that are done and their means, (B, C, rows, W)."""
        self.buffer.values += (values.transpose(1, 2) @ self.share)[:, :, None] * self.ramp.to(values)[:, None]
        return self._leave()


def _ramp(length: int, like: Tensor) -> Tensor:
    """(length,) weights along an axis, float64."""
    return torch.sin(pi * (torch.arange(length, dtype=torch.float64, device=like.device) + 0.5) / length) ** _SHARPNESS


def _total(ramp: Tensor, starts: list[int], length: int) -> Tensor:
    """(length,) sum of the weights of all windows along an axis."""
    total = ramp.new_zeros(length)
    for start in starts:
        total[start : start + len(ramp)] += ramp
    return total
