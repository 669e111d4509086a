"""Random patches of scenes with depth: cube and inverse depth, each a function of seed, step and index alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from tmca.data.spectral_depth import drawn_nearness
from tmca.errors import DataError
from tmca.training.patches import CubeStore, Patch, in_other_light, turned

_KINDS = ("plane", "slanted", "pieces", "smooth")
_LEAST_RANGE = 0.3
"""Share of the depth range that a redrawn patch covers at least."""


@dataclass(frozen=True)
class DepthPatchSource:
    """Square patches (L + 1, h, w): a random scene, place, turn, mirror image, brightness, and depth.

    The last channel is inverse depth as a share of the camera's range, 0 = far, 1 = near, NaN where unknown. A patch
    keeps its scene's depth, moved and squeezed within the range at random, or is put at drawn depths: real textures at
    every distance.

    Args:
        store: of the scenes' channels (L + 1, H, W).
        patch: side, pixels.
        seed: of the run.
        brightness: stops by which a patch is made darker at most, or brighter by one; never above 1.
        tint: standard deviation of a random smooth change of the spectrum, natural logarithm.
        redrawn: share of the patches at drawn depths.
    """

    store: CubeStore
    patch: int
    seed: int
    brightness: float = 0.0
    tint: float = 0.0
    redrawn: float = 0.5

    def __call__(self, step: int, index: int) -> Patch:
        """The patch with this index in the batch of this step.

        Raises:
            DataError: a scene that cannot be read, or is smaller than a patch.
        """
        rng = np.random.default_rng((self.seed, step, index))
        which = int(rng.integers(len(self.store)))
        scene, side = self.store.cube(which), self.patch
        if min(scene.shape[1:]) < side:
            name, size = self.store.scenes[which], f"{scene.shape[1]}×{scene.shape[2]} pixels"
            raise DataError(name, size, f"at least {side}×{side}", "use smaller patches or leave the scene out")
        top, left = (int(rng.integers(length - side + 1)) for length in scene.shape[1:])
        part = turned(scene[:, top : top + side, left : left + side], int(rng.integers(4)), bool(rng.integers(2)))
        cube = in_other_light(part[:-1], rng, self.brightness, self.tint)
        values = torch.from_numpy(np.concatenate((cube, self._place(part[-1], rng)[None]), dtype=np.float32))
        return Patch(values, values, f"{self.store.scenes[which]} at row {top}, column {left}")

    def _place(self, known: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float64]:
        extent = rng.uniform(_LEAST_RANGE, 1)
        begin = rng.uniform(0, 1 - extent)
        if rng.random() >= self.redrawn and np.isfinite(known).any():
            return begin + extent * known.astype(np.float64)
        kind = _KINDS[rng.integers(len(_KINDS))]
        drawn = drawn_nearness((known.shape[0], known.shape[1]), rng, kind)  # type: ignore[arg-type]
        return drawn if kind == "plane" else begin + extent * drawn
