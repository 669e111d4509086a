"""Captures with their truth, which a decoder is fine-tuned on: windows of them, and their first estimates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.data import make_folder
from tmca.sensor import Sensor
from tmca.training.patches import CubeStore

_ORDER, _PLACES = 6, 7
"""Streams of random numbers: which captures make a batch, which windows of them."""


@dataclass(frozen=True)
class Pair:
    """A capture and what it shows.

    Args:
        values: (B, C, H, W') snapshot, B the colours of a light field.
        truth: (B, L, H, W) what the decoder shall find; the last channel of spectrum and depth is inverse depth as a
            share of the range, NaN where unknown.
        sensor: that took it.
    """

    values: Tensor
    truth: NDArray[np.float32]
    sensor: Sensor


ReadPair = Callable[[str], Pair]
"""From a capture's name to the capture, its values on the planes of the camera that is known."""
FirstEstimate = Callable[[Tensor, Sensor], Tensor]
"""From a whole capture to what the network starts from, (B, L, H, W)."""


class Window(NamedTuple):
    """A part of a capture: which one, first and last (exclusive) row and column of the scene."""

    which: int
    top: int
    bottom: int
    left: int
    right: int

    @property
    def place(self) -> tuple[Any, slice, slice]:
        """Index of what lies in it of a scene (…, H, W)."""
        return ..., slice(self.top, self.bottom), slice(self.left, self.right)


@dataclass(frozen=True)
class Windows:
    """Windows of captures of one size: each a function of the run's seed, the step and its index alone.

    Args:
        count: captures, from index 0, that are drawn from: each once before any comes again.
        size: (H, W) of their scenes.
        side: rows of a window, and columns unless ``whole_rows``; all there are of smaller scenes.
        whole_rows: whether windows are as wide as the scene, because the optics mix columns.
        batch: windows per step.
        seed: of the run.
    """

    count: int
    size: tuple[int, int]
    side: int
    whole_rows: bool
    batch: int
    seed: int

    @property
    def extent(self) -> tuple[int, int]:
        """(h, w) of a window."""
        height, width = self.size
        return min(self.side, height), width if self.whole_rows else min(self.side, width)

    def __call__(self, step: int, index: int) -> Window:
        """The window with this index in the batch of this step."""
        turn, place = divmod(step * self.batch + index, self.count)
        which = int(np.random.default_rng((self.seed, _ORDER, turn)).permutation(self.count)[place])
        rng = np.random.default_rng((self.seed, _PLACES, step, index))
        height, width = self.extent
        top, left = (int(rng.integers(n - m + 1)) for n, m in zip(self.size, self.extent, strict=True))
        return Window(which, top, top + height, left, left + width)

    def covering(self, which: int, side: int) -> list[Window]:
        """Windows of at most ``side`` rows (and columns) that make up a whole capture, row by row."""
        height, width = self.size
        across = width if self.whole_rows else side
        return [
            Window(which, top, min(top + side, height), left, min(left + across, width))
            for top in range(0, height, side)
            for left in range(0, width, across)
        ]


class KeptCaptures:
    """Captures in memory, their truth and first estimates as arrays on disk, each made once.

    Args:
        names: of the captures: those that are learned from, then those that are held out.
        learned: how many of them are learned from.
        read: of one.
        folder: of the arrays, which may be deleted at any time.
    """

    def __init__(self, names: Sequence[str], learned: int, read: ReadPair, folder: Path) -> None:
        self.names, self.learned = tuple(names), learned
        self.values, self.sensors = list[Tensor](), list[Sensor]()
        self._truths, self._folder = list[NDArray[np.float32]](), folder
        for name in names:
            pair = read(name)
            self.values.append(pair.values)
            self.sensors.append(pair.sensor)
            self._truths.append(_kept(name, pair.truth, folder / "cubes"))
        self.size = (int(self._truths[0].shape[-2]), int(self._truths[0].shape[-1]))

    @property
    def held_out(self) -> range:
        """Indexes of the captures that are held out."""
        return range(self.learned, len(self.names))

    def truth(self, window: Window) -> Tensor:
        """(B, L, h, w)."""
        return torch.from_numpy(np.array(self._truths[window.which][window.place]))

    def start(self, which: int, make: FirstEstimate) -> Tensor:
        """(B, L, H, W) first estimate of a whole capture, made when it is first asked for."""

        def made() -> NDArray[np.float32]:
            return make(self.values[which], self.sensors[which]).float().numpy(force=True)

        return torch.from_numpy(np.array(_kept(self.names[which], made, self._folder / "starts")))


def _kept(name: str, values: NDArray[np.float32] | Callable[[], NDArray[np.float32]], folder: Path) -> Any:
    """An array, or what makes it, mapped from a file that is written where there is none."""
    return CubeStore([name], lambda _: values() if callable(values) else values, make_folder(folder)).cube(0)
