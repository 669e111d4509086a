"""Captures with their truth, which a decoder is fine-tuned on: windows of them, and their first estimates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.sensor import Sensor
from tmca.training.patches import CubeStore, Patch

_ORDER, _PLACES = 6, 7
"""Streams of random numbers: which captures make a batch, which windows of them."""


@dataclass(frozen=True)
class Pair:
    """A capture and what it shows.

    Args:
        values: (B, C, H, W') snapshot, B the colours of a light field.
        truth: (B, L, H, W) what the decoder shall estimate; the last channel of spectrum and depth is inverse depth as
            a share of the range, NaN where unknown.
        sensor: that took it.
    """

    values: Tensor
    truth: NDArray[np.float32]
    sensor: Sensor


ReadPair = Callable[[str], Pair]
"""From a capture's name to the capture, its values on the planes of the calibrated camera."""


class Window(NamedTuple):
    """A part of a capture: which one, its rows and columns of the scene."""

    which: int
    rows: slice
    columns: slice


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

    def __call__(self, step: int, index: int) -> Window:
        """The window with this index in the batch of this step."""
        turn, place = divmod(step * self.batch + index, self.count)
        which = int(np.random.default_rng((self.seed, _ORDER, turn)).permutation(self.count)[place])
        rng = np.random.default_rng((self.seed, _PLACES, step, index))
        extent = (min(self.side, self.size[0]), self.size[1] if self.whole_rows else min(self.side, self.size[1]))
        top, left = (int(rng.integers(n - m + 1)) for n, m in zip(self.size, extent, strict=True))
        return Window(which, slice(top, top + extent[0]), slice(left, left + extent[1]))


class Captures:
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
        self._truths, self._folder = CubeStore(names, lambda _: pair.truth, folder / "cubes"), folder / "starts"
        for index, name in enumerate(names):
            pair = read(name)
            self.values.append(pair.values)
            self.sensors.append(pair.sensor)
            self._truths.cube(index)  # written at once: truths of all captures need not fit into memory
        self.size = (int(pair.truth.shape[-2]), int(pair.truth.shape[-1]))

    @property
    def held_out(self) -> range:
        """Indexes of the captures that are held out."""
        return range(self.learned, len(self.names))

    def truth(self, which: int, rows: slice = slice(None), columns: slice = slice(None)) -> Tensor:
        """(B, L, h, w) of a part of a capture."""
        return torch.from_numpy(np.array(self._truths.cube(which)[..., rows, columns]))

    def patch(self, window: Window) -> Patch:
        """The truth of a window, as an example of the training loop."""
        truth, place = self.truth(*window), f"row {window.rows.start}, column {window.columns.start}"
        return Patch(truth, truth, f"{self.names[window.which]} at {place}")

    def start(self, which: int, compute: Callable[[], Tensor]) -> Tensor:
        """(B, L, H, W) first estimate of a whole capture, computed when it is first asked for."""
        store = CubeStore(self.names, lambda _: compute().float().numpy(force=True), self._folder)
        return torch.from_numpy(np.array(store.cube(which)))
