"""Sparse recovery in a learned dictionary of patches: the light-field decoder of Marwah et al. (2013)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from tmca.decoders.blocks import check_snapshot, equal_windows
from tmca.decoders.decoder import Decoder, Progress
from tmca.decoders.overlap import MERGES, MergedPatches
from tmca.decoders.sparse import batch_omp, lasso_admm
from tmca.errors import SettingError
from tmca.operators.taps import Taps
from tmca.priors.dictionary import PatchDictionary
from tmca.priors.gaussian import BlockGrid, BlockModel
from tmca.sensor import Noise

METHODS = ("omp", "lasso")
# Bytes of the dictionaries as patches see them that are held at once; more would leave the processor's cache.
_MEMORY = 2**25
_FLOOR = 1e-6


class DictionaryEstimator:
    """Every patch of the scene from its own h·w measurements, as few atoms; overlapping patches are merged.

    What a patch sees of the dictionary is ``A D``, atoms behind its own part of the code, and one constant atom for
    its mean, which is taken first (OMP) or free of penalty (LASSO). Measurements are weighed by their deviation: of
    the noise, and of what sparse codes leave of the scene, which is all there is in a snapshot without noise. The
    penalty of an atom is the inverse of its typical coefficient. A weight of 1 would be the most probable code under
    Laplacian coefficients; those of patches have heavier tails, and what codes leave is not independent from entry
    to entry, so that far less is best.

    Args:
        dictionary: of patches (L, h, w).
        taps: of the camera, all without offset.
        noise: of its sensor.
        method: ``"lasso"`` (by ADMM) or ``"omp"``.
        stride: rows and columns from patch to patch.
        merge: ``"median"`` or ``"mean"`` of the patches that cover a pixel.
        sparsity: largest number of atoms of a patch, for OMP; None takes a quarter of its measurements.
        slack: OMP stops at a residual of so many times the expected one.
        weight: of the absolute coefficients, for the LASSO; the default was chosen on training light fields.
        tolerance, max_iterations: of the LASSO's ADMM.
        dtype: of the arithmetic.

    Raises:
        SettingError: unknown method or merge, impossible numbers, negative noise, or a camera that disperses.
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
        merge: str = "median",
        sparsity: int | None = None,
        slack: float = 1.0,
        weight: float = 0.1,
        tolerance: float = 1e-2,
        max_iterations: int = 200,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        for name, word, choices in (("method", method, METHODS), ("merge", merge, MERGES)):
            if word not in choices:
                raise SettingError(name, repr(word), f"one of {', '.join(choices)}")
        for name, value, least in (("stride", min(stride), 1), ("sparsity", sparsity or 1, 1), ("slack", slack, 0)):
            if not value >= least:
                raise SettingError(name, f"{value}", f"at least {least}")
        model = BlockModel.of(taps, dictionary.block)
        if model.span:
            raise SettingError("camera", f"a dispersion of {model.span} pixels", "none, for a dictionary", "use lmmse")
        self.taps, self.method, self.merge, self.dtype = taps, method, merge, dtype
        self.sparsity, self.slack, self.weight = sparsity, slack, weight
        self.tolerance, self.max_iterations = tolerance, max_iterations
        step = (min(stride[0], model.block[1]), min(stride[1], model.block[2]))
        self.grid = BlockGrid.cover(model, (taps.code.shape[1], taps.code.shape[2]), step)
        self.code = self.grid.pad_code(taps.code.to(dtype))
        self.sight = _Sight(dictionary.to(taps.code.device), model, noise, dtype)

    @torch.no_grad()
    def __call__(self, snapshot: Tensor, progress: Progress | None = None) -> Tensor:
        """The scenes (B, L, H, W) behind snapshots (B, 1, H, W).

        Raises:
            ShapeError: a snapshot that does not fit the taps.
        """
        check_snapshot(snapshot, self.taps)
        values = self.grid.pad_snapshot(snapshot[:, 0].to(self.dtype))
        patches, image = MergedPatches(self.grid, len(snapshot), self.merge, values), []
        for row, top in enumerate(self.grid.tops):
            image.append(patches.add(self._row(values, [(top, left) for left in self.grid.lefts])))
            if progress:
                progress((row + 1) / len(self.grid.tops))
        return torch.cat(image, -2).to(snapshot.dtype)

    def _row(self, snapshot: Tensor, places: list[tuple[int, int]]) -> Tensor:
        """(P, B, L, h, w) patches at places in one row."""
        row = snapshot.new_empty(len(places), len(snapshot), *self.sight.model.block)
        index = {place: i for i, place in enumerate(places)}
        for groups in _batches(equal_windows(self.grid, self.code, places), self.sight.batch):
            windows = self.grid.code_windows(self.code, [group[0] for group in groups])
            measured = torch.stack([self.grid.snapshot_windows(snapshot, group) for group in groups])
            atoms, weighed = self.sight.weigh(windows, measured.flatten(1, 2))
            patches = self.sight.compose(self._codes(atoms, weighed))
            where = torch.tensor([index[place] for group in groups for place in group], device=row.device)
            row[where] = patches.reshape(len(where), len(snapshot), *self.sight.model.block)
        return row

    def _codes(self, atoms: Tensor, measured: Tensor) -> Tensor:
        """(G, P, 1 + K) codes of measurements (G, P, m) in units of their deviation."""
        m = measured.shape[-1]
        if self.method == "omp":
            return batch_omp(atoms, measured, min(self.sparsity or m // 4, m), self.slack * m, forced=1)
        most, tolerance = self.max_iterations, self.tolerance
        return lasso_admm(atoms, measured, self.weight, 1, max_iterations=most, tolerance=tolerance).codes


class _Sight:
    """The dictionary as patches see it behind their codes, in units of typical coefficients and of the noise."""

    def __init__(self, dictionary: PatchDictionary, model: BlockModel, noise: Noise, dtype: torch.dtype) -> None:
        self.model, self.noise, self.left = model, noise, dictionary.residual
        scales = dictionary.scales.clamp_min(1e-3 * dictionary.scales.mean())
        constant = torch.ones_like(dictionary.atoms[:1])
        self.atoms = torch.cat([constant, dictionary.atoms * scales[:, None, None, None]]).flatten(1).to(dtype)
        self.rows = self.atoms.mT[model.pixels()]
        self.batch = max(1, _MEMORY // (model.measurements * len(self.atoms) * dtype.itemsize))

    def weigh(self, windows: Tensor, measured: Tensor) -> tuple[Tensor, Tensor]:
        """(G, m, 1 + K) atoms behind code windows (G, L, h, w) and measurements (G, P, m), by their deviation."""
        seen = self.model.cross_covariance(windows, self.rows).transpose(0, 1)
        energy = windows.square().sum(1).flatten(1)
        signal = measured.clamp_min(0).mean(1)
        variance = self.noise.variance(signal) + self.left * energy + _FLOOR**2
        weights = variance.rsqrt()
        return seen * weights[..., None], measured * weights[:, None]

    def compose(self, codes: Tensor) -> Tensor:
        """(..., L·h·w) patches of codes (..., 1 + K)."""
        return codes @ self.atoms


def _batches(groups: list[list[tuple[int, int]]], most: int) -> Iterator[list[list[tuple[int, int]]]]:
    """Groups of equal size together, at most so many at once."""
    sizes: dict[int, list[list[tuple[int, int]]]] = {}
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
    method: ClassVar[str] = "lasso"

    def setup(self, camera: Any, prior: Any) -> DictionaryEstimator:
        return DictionaryEstimator(prior, camera.taps(), camera.noise, self.method)

    def reconstruct(self, prepared: DictionaryEstimator, values: Tensor, progress: Progress | None) -> Tensor:
        return prepared(values, progress)


@dataclass
class PursuitDecoder(DictionaryDecoder):
    """Sparse patches in a learned dictionary, by orthogonal matching pursuit."""

    name, label, method = "dictionary-omp", "dictionary (OMP)", "omp"
