"""Patch LMMSE and its mixture: the best estimates of overlapping blocks under a prior of them, blended."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor

from tmca.data.atomic import check_target
from tmca.decoders.bank import MOST_BYTES, Bank
from tmca.decoders.bank_file import bank_key, stored_bank, write_bank
from tmca.decoders.decoder import Decoder, Progress, Raw
from tmca.decoders.fast_bank import computable, faster
from tmca.errors import SettingError, check_shape
from tmca.operators.block_layout import BlockLayout, Canvas, Places, evenly_chosen, usual_stride
from tmca.operators.blocks import BlockModel
from tmca.operators.taps import TapOperator, Taps
from tmca.priors import GaussianMixturePrior, GaussianPrior
from tmca.priors.gaussian_posterior import BlockPosterior, FoldedPosterior, GaussianSolver
from tmca.priors.mixture_posterior import MixturePosterior, MixtureSolver
from tmca.sensor import Noise

MEMORY, MOST_FACTOR_BYTES = 2**27, 5 * 2**29
"""Bytes of the covariances of measurements with pixels that are held at once, and of what is stored of all blocks of a
frame: that of 660×660 pixels in 28 bands fits."""
_AT_ONCE = 32
_NO_BANK = "leave the file out: what can be computed once is then stored in memory"
Solver = GaussianSolver | MixtureSolver
"""The posteriors of blocks under a prior, a camera and its noise."""
Solved = tuple[list[Places], BlockPosterior | MixturePosterior]
"""Groups of blocks, and what is known of each."""


class Blended(NamedTuple):
    """Scenes (B, L, H, W) and, where asked for, more of the same shape.

    ``scatter`` is the variance of what the blocks over a pixel say: the mean square error of single blocks less that of
    their blend, whatever the errors are.
    """

    estimate: Tensor
    deviation: Tensor | None = None
    scatter: Tensor | None = None

    @classmethod
    def joined(cls, parts: Sequence[Blended]) -> Blended:
        """Those of a batch, from its parts."""
        deviations = [part.deviation for part in parts if part.deviation is not None]
        return cls(torch.cat([part.estimate for part in parts]), torch.cat(deviations) if deviations else None)


class PatchEstimator:
    """Scenes of a collapsed camera under a prior of blocks: ``estimator(snapshot) -> Blended``.

    Blocks under equal code windows share their matrices. Estimates are weighted by the inverse square of the variance
    that is typical of their place in the block. The variance reported is the same mean of the variances in the blocks'
    valid columns, which the error of the blended estimate hardly exceeds.

    Args:
        prior: of blocks (L, h, w).
        taps, noise: of the camera and its sensor.
        stride: rows and columns from block to block; None takes two thirds of its rows, and its valid columns but no
            more than two thirds of all, so that blocks overlap; for tiled codes the next smaller divisors of the
            period, so that blocks under the same part of the tile share their matrices.
        dtype: of the heavy products; None takes float32 where the noise allows it, float64 where it is next to none.
        differentiable: let gradients reach code and snapshot, the weights of the blend apart.
        fast: of what `precompute` computes, leave out what carries next to nothing, see `tmca.decoders.fast_bank`.

    Raises:
        ShapeError: a prior of other bands than the taps', or too large a block.
        SettingError: negative noise, or a stride below 1.
    """

    def __init__(
        self,
        prior: GaussianPrior | GaussianMixturePrior,
        taps: Taps,
        noise: Noise = Noise(),  # noqa: B008
        *,
        stride: tuple[int, int] | None = None,
        dtype: torch.dtype | None = None,
        differentiable: bool = False,
        fast: bool = False,
    ) -> None:
        prior, model = prior.to(taps.code.device), BlockModel.of(taps, prior.block)
        self.taps, self.differentiable, self.fast = taps, differentiable, fast
        self.solver: Solver = (
            MixtureSolver(prior, model, noise, dtype)
            if isinstance(prior, GaussianMixturePrior)
            else GaussianSolver(prior, model, noise, dtype)
        )
        self.layout = BlockLayout.of(model, taps, stride or usual_stride(model, taps.code), differentiable)
        self.noise = noise
        self.bank: Bank | None = None
        self.factors: Factors | None = None
        self.kept: list[Solved] = []

    @cached_property
    def window(self) -> Tensor:
        """(L, h, w) weights of the places in a block."""
        return blend_window(self.layout, self.solver)

    @torch.no_grad()
    def precompute(self, file: Path | None = None, *, deviation: bool = True) -> PatchEstimator:
        """Compute what all snapshots have in common: the next ones take a tenth of the time, and are the same to
        rounding.

        That is a bank, where blocks see few different windows of the code, as those of tiles; else, under a stationary
        prior, the factors of all blocks. Under a mixture it is what is known of all components behind these windows.
        Nothing is done where gradients are asked for, where a large mask's factors take more memory than
        ``MOST_FACTOR_BYTES`` or components more than ``tmca.decoders.bank.MOST_BYTES``, and without a bank or a mixture
        on other devices than the processor.

        Args:
            file: that holds the bank: read where it is there, written where it is not.
            deviation: compute that of factors and components now, not when a frame wants it.

        Raises:
            SettingError: a file, but nothing that could be in it.
            DataError, OutputError: see `stored_bank` and `write_bank`.
        """
        solver = self.solver if isinstance(self.solver, GaussianSolver) and not self.differentiable else None
        if file is not None:
            check_target(file, overwrite=True)
            self.bank = self._bank_in(file, solver)
        elif solver is not None:
            self.bank = self._computed_bank(solver)
            self.factors = Factors.of(self.layout, self.window, solver) if self.bank is None else None
            if self.factors and deviation:
                _ = self.factors.deviation
        if solver is not None and (self.bank or self.factors):
            solver.drop_rows()
        if isinstance(self.solver, MixtureSolver) and not self.differentiable:
            self.kept = kept_parts(self.layout, self.solver, deviation)
            _ = self.window
        return self

    def _computed_bank(self, solver: GaussianSolver) -> Bank | None:
        layout = self.layout
        bank = Bank.of(layout.grid, layout.code, layout.groups, self.window, solver)
        if bank is None or not self.fast:
            return bank
        return faster(bank, self._expected(solver))

    def _expected(self, solver: GaussianSolver) -> Tensor:
        """(1, R, H, W') snapshot that the prior expects."""
        mean = solver.prior.mean.mean((1, 2)).to(self.taps.code)[None, :, None, None]
        return TapOperator(self.taps).A(mean.expand(1, *self.taps.scene_shape))

    def _bank_in(self, file: Path, solver: GaussianSolver | None) -> Bank:
        """The bank of a file; computed and written where there is none."""
        if solver is not None:
            grid, dtype = self.layout.grid, solver.dtype
            key = bank_key(solver.prior, self.taps, self.noise, grid, dtype, self.fast)
            bank = stored_bank(file, key, grid, self.taps, dtype)
            if bank is not None:
                return computable(bank, self._expected(solver)) if self.fast else bank
            bank = self._computed_bank(solver)
            if bank is not None:
                write_bank(bank, self.taps.code.float(), key, file)
                return bank
        raise SettingError("bank", str(file), "codes that repeat themselves, under a Gaussian prior", _NO_BANK)

    def __call__(self, snapshot: Tensor, *, uncertainty: bool = False, progress: Progress | None = None) -> Blended:
        """The scenes (B, L, H, W) behind snapshots (B, 1, H, W'), with their standard deviation if asked for."""
        check_shape("snapshot", snapshot, ("B", *self.taps.snapshot_shape))
        computed = self.bank or self.factors
        if computed is not None:
            with torch.no_grad():
                estimate = computed.estimate(snapshot, progress)
                return Blended(estimate, computed.deviation.expand_as(estimate).clone() if uncertainty else None)
        blend = Blend(self.layout, self.window, snapshot, uncertainty=uncertainty)
        with torch.set_grad_enabled(self.differentiable and torch.is_grad_enabled()):
            if self.kept:
                blend.lay_parts(self.kept, progress=progress)
            else:
                blend.lay(self.solver, progress=progress)
        return blend.result()


def blend_window(layout: BlockLayout, solver: Solver) -> Tensor:
    """(L, h, w) weights of the places in a block."""
    windows = layout.grid.code_windows(layout.code.detach(), evenly_chosen(layout.grid.positions))
    return blend_weights(solver.typical_variance(windows)).unflatten(0, layout.grid.model.block)


def solved_parts(
    layout: BlockLayout, solver: Solver, groups: list[Places], batch: int, variance: bool
) -> Iterator[Solved]:
    """The groups with what is known of their blocks, as many at once as ``MEMORY`` allows, for so many snapshots."""
    each = _estimates(groups, batch)
    most = solver.at_once(layout.code, MEMORY, each, variance)
    for start in range(0, len(groups), most):
        part = groups[start : start + most]
        windows = layout.grid.code_windows(layout.code, [places[0] for places in part])
        yield part, solver.posterior(windows, each, variance)


def _estimates(groups: list[Places], batch: int) -> float:
    """Of a block, on average, for so many snapshots."""
    return batch * sum(map(len, groups)) / max(1, len(groups))


def kept_parts(layout: BlockLayout, solver: MixtureSolver, deviation: bool) -> list[Solved]:
    """All groups, with what is known of their components before a snapshot; nothing where it takes more than
    ``MOST_BYTES``."""
    groups = layout.groups
    if solver.kept_bytes(len(groups)) > MOST_BYTES:
        return []
    windows = layout.grid.code_windows(layout.code, [places[0] for places in groups])
    return [(groups, solver.posterior(windows).keeping(deviation))]


def few(groups: list[Places], most: int = _AT_ONCE) -> Iterator[list[int]]:
    """Indices of groups, as many at once as have ``most`` blocks or are one."""
    some: list[int] = []
    for index, places in enumerate(groups):
        if some and sum(len(groups[i]) for i in some) + len(places) > most:
            yield some
            some = []
        some.append(index)
    yield some


class Blend:
    """Snapshots, and the canvases of their estimate, its variance and its square on which blocks are laid."""

    def __init__(
        self, layout: BlockLayout, window: Tensor, snapshot: Tensor, *, uncertainty: bool = False, scatter: bool = False
    ) -> None:
        self.layout, grid = layout, layout.grid
        first, last = grid.model.valid
        parts = (window, window[..., first:last].contiguous() if uncertainty else None, window if scatter else None)
        self.canvases = [None if part is None else Canvas(grid, len(snapshot), part) for part in parts]
        self.snapshot = grid.pad_snapshot(snapshot.to(window.dtype))

    def lay(
        self, solver: Solver, groups: list[Places] | None = None, progress: Callable[[float], None] | None = None
    ) -> None:
        """Solve the blocks of some groups, all of them by default, and lay them on the canvases."""
        groups = self.layout.groups if groups is None else groups
        parts = solved_parts(self.layout, solver, groups, len(self.snapshot), self.canvases[1] is not None)
        self.lay_parts(parts, len(groups), progress)

    def lay_parts(
        self, parts: Iterable[Solved], count: int | None = None, progress: Callable[[float], None] | None = None
    ) -> None:
        """Lay groups whose blocks are solved, ``count`` in all, on the canvases."""
        grid, done = self.layout.grid, 0
        for part, posterior in parts:
            # gradients are stored of all blocks in any case, and fewer products are recorded of all at once
            for blocks in [[*range(len(part))]] if torch.is_grad_enabled() else few(part):
                measured = [grid.snapshot_windows(self.snapshot, part[block]) for block in blocks]
                flat = [one.flatten(0, 1) for one in measured]
                every = posterior.moments(blocks, flat, self.canvases[1] is not None)
                for block, moments, seen in zip(blocks, every, measured, strict=True):
                    self._add(part[block], *(m if m is None else m.unflatten(0, seen.shape[:2]) for m in moments))
            done += len(part)
            if progress:
                progress(done / (count or len(self.layout.groups)))

    def _add(self, places: Places, estimate: Tensor | None, variance: Tensor | None) -> None:
        """What is known of equal blocks at some places, (P, B, L·h·w), and of their valid columns."""
        assert estimate is not None
        grid, square = self.layout.grid, estimate.square() if self.canvases[2] is not None else None
        parts = (estimate, variance, square)
        for canvas, values, shift in zip(self.canvases, parts, (0, grid.model.valid[0], 0), strict=True):
            if canvas is not None and values is not None:
                for (y, x), one in zip(places, values, strict=True):
                    canvas.add(y, x + grid.padding[0] + shift, one)

    def result(self) -> Blended:
        """What the canvases say."""
        mean, variance, square = (None if canvas is None else canvas.mean() for canvas in self.canvases)
        assert mean is not None
        between = None if square is None else (square - mean.square()).clamp_min(0)
        return Blended(mean, None if variance is None else variance.sqrt(), between)


def blend_weights(variance: Tensor) -> Tensor:
    """Weights, one on average, of the places in a block whose typical variances are given."""
    weights = (variance + 1e-3 * variance.mean()).pow(-2)
    return weights / weights.mean()


@dataclass(frozen=True)
class Factors:
    """What is known of all blocks of a frame, without covariances with pixels.

    Args:
        layout: of the blocks.
        window: (L, h, w) weights of the places in a block.
        parts: the groups of blocks, solved.
    """

    layout: BlockLayout
    window: Tensor
    parts: list[tuple[list[Places], FoldedPosterior]]

    @classmethod
    def of(cls, layout: BlockLayout, window: Tensor, solver: GaussianSolver) -> Factors | None:
        """None where they take more than ``MOST_FACTOR_BYTES``, or covariances with pixels would have to be stored
        too."""
        groups = layout.groups
        fits = FoldedPosterior.bytes_of(solver, len(groups)) <= MOST_FACTOR_BYTES
        if not fits or not solver.displaceable(layout.code):
            return None
        solver.drop_rows()
        room, start = FoldedPosterior.room(solver, len(groups)), 0
        parts: list[tuple[list[Places], FoldedPosterior]] = []
        for part, posterior in solved_parts(layout, solver, groups, 1, False):
            assert isinstance(posterior, BlockPosterior)
            parts.append((part, room.part(slice(start, start + len(part))).fill(posterior)))
            start += len(part)
        return cls(layout, window, parts)

    def estimate(self, snapshot: Tensor, progress: Callable[[float], None] | None = None) -> Tensor:
        """(B, L, H, W) scenes behind snapshots (B, R, H, W')."""
        blend = Blend(self.layout, self.window, snapshot)
        blend.lay_parts(self.parts, progress=progress)
        return blend.result().estimate

    @cached_property
    def deviation(self) -> Tensor:
        """(1, L, H, W) of the blend, the same for all frames."""
        grid, solver = self.layout.grid, self.parts[0][1].solver
        dark = self.layout.code.new_zeros(1, grid.model.buckets, *grid.frame)  # padded as it is, with no light
        blend = Blend(self.layout, self.window, dark, uncertainty=True)
        most = solver.at_once(self.layout.code, MEMORY, 1, True)
        blend.lay_parts(
            (groups[start : start + most], posterior.part(slice(start, start + most)))
            for groups, posterior in self.parts
            for start in range(0, len(groups), most)
        )
        solver.drop_rows()
        deviation = blend.result().deviation
        assert deviation is not None
        return deviation


@dataclass
class PatchDecoder(Decoder):
    """What decoders have in common that blend estimates of blocks."""

    cameras, prior_kind, deviation = frozenset({"spectral", "light-field"}), "gaussian", True
    needs_taps = True
    uncertainty: bool = False

    def setup(self, camera: Any, prior: Any) -> Any:
        return PatchEstimator(prior, camera.taps(), camera.noise)

    def precompute(self, prepared: Any, bank: Path | None = None) -> Any:
        if isinstance(prepared, PatchEstimator):
            return prepared.precompute(bank, deviation=self.uncertainty)
        return super().precompute(prepared, bank)

    def reconstruct(self, prepared: Any, values: Tensor, progress: Progress | None) -> Raw:
        blended = prepared(values, uncertainty=self.uncertainty, progress=progress)
        return Raw(blended.estimate, blended.deviation)


@dataclass
class LMMSE(PatchDecoder):
    """The best linear estimate under a Gaussian prior of blocks, ``x̂ = μ + S Aᵀ (A S Aᵀ + R)⁻¹ (y - A μ)``, blended.

    Args:
        uncertainty: also predict the standard deviation of every entry; takes some times longer where codes do not
            repeat.
        fast: where it is prepared for many frames behind tiled codes, decode each in half the time where the
            processor computes with bfloat16, else in two thirds, some hundredths of a dB below.
        calibrated: with the standard deviation, bring it to the errors of known scenes; False leaves it as predicted.
    """

    name, label = "lmmse", "LMMSE"
    fast: bool = False
    calibrated: bool = True

    def setup(self, camera: Any, prior: Any) -> Any:
        return PatchEstimator(prior, camera.taps(), camera.noise, fast=self.fast)


@dataclass
class MixtureLMMSE(PatchDecoder):
    """The minimum-mean-square-error estimate under a mixture of Gaussian priors of blocks, blended.

    Args:
        uncertainty: also predict the standard deviation of every entry.
        calibrated: with the standard deviation, bring it to the errors of known scenes; False leaves it as predicted.
    """

    name, label, prior_kind = "mixture", "mixture", "mixture"
    calibrated: bool = True
