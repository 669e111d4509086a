"""Sparse recovery in a learned dictionary of patches: the light-field decoder of Marwah et al. (2013)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from typing import Any, ClassVar

import torch
from torch import Tensor

from tmca.decoders.decoder import Decoder, Progress
from tmca.decoders.sparse import batch_omp, lasso_admm
from tmca.errors import SettingError, check_choice, check_range, check_shape
from tmca.operators.block_layout import Places, equal_windows
from tmca.operators.blocks import BlockGrid, BlockModel
from tmca.operators.taps import Taps
from tmca.operators.windows import RowBuffer
from tmca.priors.dictionary import PatchDictionary
from tmca.sensor import Noise

METHODS = ("omp", "lasso")
# Bytes of the dictionaries as patches see them that are held at once; more would leave the processor's cache.
_MEMORY = 2**25
_FLOOR = 1e-6


class DictionaryEstimator:
    """Every patch of the scene from its own h·w measurements, as few atoms; the median of overlapping patches.

    What a patch sees of the dictionary is ``A D``, atoms behind its own part of the code, and one constant atom for
    its mean, which is taken first (OMP) or free of penalty (LASSO). Measurements are weighed by their deviation: of
    the noise, and of what sparse codes leave of the scene, which is all there is in a snapshot without noise. The
    penalty of an atom is the inverse of its typical coefficient. A weight of 1 would be the most probable code under
    Laplacian coefficients; those of patches have heavier tails, and what codes leave is not independent from entry
    to entry, so that far less is best.

    Args:
        dictionary: of patches (L, h, w).
        taps, noise: of the camera, all without offset, and its sensor.
        method: ``"lasso"`` (by ADMM) or ``"omp"``.
        stride: rows and columns from patch to patch.
        slack: OMP stops at a residual of so many times the expected one, or a quarter as many atoms as measurements.
        weight: of the absolute coefficients, for the LASSO; the default was chosen on training light fields.
        tolerance, max_iterations: of the LASSO's ADMM.
        dtype: of the arithmetic.

    Raises:
        SettingError: unknown method, impossible numbers, negative noise, or a camera that disperses.
        ShapeError: a dictionary of other views than the taps'.
    """

    def __init__(
        self,
        dictionary: PatchDictionary,
        taps: Taps,
        noise: Noise = Noise(),  # noqa: B008
        method: str = "lasso",
        *,
        stride: tuple[int, int] = (3, 3),
        slack: float = 1.0,
        weight: float = 0.1,
        tolerance: float = 1e-2,
        max_iterations: int = 200,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        check_choice("method", method, METHODS)
        check_range("stride", min(stride), 1)
        check_range("slack", slack, 0)
        model = BlockModel.of(taps, dictionary.block)
        if model.span:
            raise SettingError("camera", f"a dispersion of {model.span} pixels", "none, for a dictionary", "use lmmse")
        self.taps, self.noise, self.method = taps, noise, method
        self.slack, self.weight, self.tolerance, self.max_iterations = slack, weight, tolerance, max_iterations
        step = (min(stride[0], model.block[1]), min(stride[1], model.block[2]))
        self.grid = BlockGrid.cover(model, (taps.code.shape[1], taps.code.shape[2]), step)
        self.code = self.grid.pad_code(taps.code.to(dtype))
        dictionary = dictionary.to(taps.code.device)
        scales = dictionary.scales.clamp_min(1e-3 * dictionary.scales.mean())[:, None, None, None]
        atoms = torch.cat([torch.ones_like(dictionary.atoms[:1]), dictionary.atoms * scales])
        self.atoms, self.left = atoms.flatten(1).to(dtype), dictionary.residual
        self.rows = self.atoms.mT[model.pixels()]

    @torch.no_grad()
    def __call__(self, snapshot: Tensor, progress: Progress | None = None) -> Tensor:
        """The scenes (B, L, H, W) behind snapshots (B, 1, H, W)."""
        check_shape("snapshot", snapshot, ("B", *self.taps.snapshot_shape))
        values = self.grid.pad_snapshot(snapshot.to(self.atoms.dtype))
        patches, image = MergedPatches(self.grid, len(snapshot), values), []
        for row, top in enumerate(self.grid.tops):
            image.append(patches.add(self._row(values, [(top, left) for left in self.grid.lefts])))
            if progress:
                progress((row + 1) / len(self.grid.tops))
        return torch.cat(image, -2).to(snapshot.dtype)

    def _row(self, snapshot: Tensor, places: Places) -> Tensor:
        """(P, B, L, h, w) patches at places in one row."""
        model = self.grid.model
        row = snapshot.new_empty(len(places), len(snapshot), *model.block)
        index = {place: i for i, place in enumerate(places)}
        most = max(1, _MEMORY // (model.measurements * len(self.atoms) * self.atoms.dtype.itemsize))
        for groups in _batches(equal_windows(self.grid, self.code, places), most):
            windows = self.grid.code_windows(self.code, [group[0] for group in groups])
            measured = torch.stack([self.grid.snapshot_windows(snapshot, group) for group in groups])
            patches = self._codes(*self._weighed(windows, measured.flatten(1, 2))) @ self.atoms
            where = torch.tensor([index[place] for group in groups for place in group], device=row.device)
            row[where] = patches.reshape(len(where), len(snapshot), *model.block)
        return row

    def _weighed(self, windows: Tensor, measured: Tensor) -> tuple[Tensor, Tensor]:
        """(G, m, 1 + K) atoms behind code windows (G, L, h, w) and measurements (G, P, m), by their deviation."""
        code = self.grid.model.complete(windows)
        seen = self.grid.model.cross_covariance(code, self.rows).transpose(0, 1)
        energy = code.square().sum(1).flatten(1)
        noise = self.noise.variance(measured.clamp_min(0).mean(1))
        weights = (noise + self.left * energy + _FLOOR**2).rsqrt()
        return seen * weights[..., None], measured * weights[:, None]

    def _codes(self, atoms: Tensor, measured: Tensor) -> Tensor:
        """(G, P, 1 + K) codes of measurements (G, P, m) in units of their deviation."""
        m = measured.shape[-1]
        if self.method == "omp":
            return batch_omp(atoms, measured, m // 4, self.slack * m, forced=1)
        most, tolerance = self.max_iterations, self.tolerance
        return lasso_admm(atoms, measured, self.weight, 1, max_iterations=most, tolerance=tolerance).codes


class MergedPatches:
    """Patches merged by the median of all that cover a pixel, row of patches by row of patches.

    Patches that may overlap lie in layers of their own, so the memory is that of the patches which cover one row of the
    image, whatever its height. The image is ``like`` a tensor in type and device.
    """

    def __init__(self, grid: BlockGrid, batch: int, like: Tensor) -> None:
        self.grid = grid
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
        return _median(covers[..., : self.grid.frame[1]].flatten(0, 1))


def _median(covers: Tensor) -> Tensor:
    """(...) median over the finite values along the first axis of covers (N, ...); ``inf`` marks gaps."""
    ranked, count = covers.sort(0).values, covers.isfinite().sum(0)
    lower, upper = (ranked.gather(0, (rank // 2)[None])[0] for rank in (count - 1, count))
    return (lower + upper) / 2


def _layers(starts: tuple[int, ...], length: int) -> int:
    """Layers so that patches of a length, dealt out in turn, never overlap in a layer."""
    for layers in range(1, len(starts)):
        if all(late - early >= length for early, late in zip(starts, starts[layers:], strict=False)):
            return layers
    return len(starts)


def _batches(groups: list[Places], most: int) -> Iterator[list[Places]]:
    """Groups of equal size together, at most so many at once."""
    sizes: dict[int, list[Places]] = {}
    for group in groups:
        sizes.setdefault(len(group), []).append(group)
    for same in sizes.values():
        for start in range(0, len(same), most):
            yield same[start : start + most]


@dataclass
class DictionaryDecoder(Decoder):
    """Sparse patches in a learned dictionary, by the LASSO (Marwah et al. 2013)."""

    name, label, cameras = "dictionary", "dictionary (LASSO)", frozenset({"light-field"})
    prior_kind = "dictionary"
    needs_taps = True
    method: ClassVar[str] = "lasso"

    def setup(self, camera: Any, prior: Any) -> DictionaryEstimator:
        return DictionaryEstimator(prior, camera.taps(), camera.noise, self.method)

    def reconstruct(self, prepared: DictionaryEstimator, values: Tensor, progress: Progress | None) -> Tensor:
        return prepared(values, progress)


@dataclass
class PursuitDecoder(DictionaryDecoder):
    """Sparse patches in a learned dictionary, by orthogonal matching pursuit."""

    name, label, method = "dictionary-omp", "dictionary (OMP)", "omp"
