"""Scenes that change from slot to slot, sparse in the cosine transform of blocks of space and time.

Iterated denoising (Guleryuz, IEEE Transactions on Image Processing 15, 2006): coefficients of overlapping blocks below
a threshold are set to zero, blocks averaged, the snapshot put back by the data step of `tmca.decoders.pnp_admm`, while
the threshold falls. What was never measured is filled by what keeps few coefficients; large structures settle first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import fold, pad, unfold

from tmca.cameras import CodedCamera
from tmca.cameras.frames import frame_taps
from tmca.decoders.batches import one_by_one
from tmca.decoders.decoder import Decoder, Progress
from tmca.decoders.least_squares import DataStep, energy, noise_level
from tmca.errors import SettingError, check_range
from tmca.operators import LinearOperator, TapOperator, Taps

_BLOCK, _STRIDE = (16, 16, 16), 4
_TOGETHER = 64  # blocks that the processor's cache holds
_NEAR = (1.0, 1.5, 1.5)  # standard deviations of the first estimate's kernel: frames, rows, columns
_FAINT = 1e-6  # share of the most light below which nothing is said of a place
_SENSOR = (1, 2, 3)
_PENALTY = 1e-3  # of the data step, in units of the operator's energy: the snapshot is kept nearly as it is


class BlockThreshold:
    """Hard thresholding of a movie's blocks in their cosine transform, overlapping blocks averaged.

    Every block counts by the inverse number of coefficients that it keeps; its mean is always kept.

    Args:
        frames, size: K and (H, W) of the movie.
        block: frames, rows and columns of a block at most.
        stride: rows and columns from one block to the next; blocks of frames overlap by half.
    """

    def __init__(
        self, frames: int, size: tuple[int, int], block: tuple[int, int, int] = _BLOCK, stride: int = _STRIDE
    ) -> None:
        self.size, self.stride = size, stride
        self.sides = (min(block[1], size[0]), min(block[2], size[1]))
        depth = min(block[0], frames)
        step = max(1, depth // 2)
        self.starts = sorted({*range(0, frames - depth, step), frames - depth})
        self.depth = depth
        self.padding = [(-(length - side)) % stride for length, side in zip(size, self.sides, strict=True)]

    def __call__(self, movie: Tensor, threshold: float) -> Tensor:
        """(N, K, H, W) movies → the same, thresholded, in the unit of the movie (the transform is orthonormal)."""
        total, weight = torch.zeros_like(movie), torch.zeros_like(movie)
        for number, start in ((n, s) for n in range(len(movie)) for s in self.starts):
            frames = slice(start, start + self.depth)
            part, counted = self._segment(movie[number, frames], threshold)
            total[number, frames] += part
            weight[number, frames] += counted
        return total / weight

    def _segment(self, part: Tensor, threshold: float) -> tuple[Tensor, Tensor]:
        """Sum of the weighted blocks (K, H, W) of as many frames as a block has, and of their weights (H, W)."""
        rows, columns = self.size
        down, right = self.padding
        laid = pad(part[None], (0, right, 0, down), mode="replicate")
        blocks = unfold(laid, self.sides, stride=self.stride)[0].T.reshape(-1, self.depth, *self.sides)
        parts = [self._thresholded(few, threshold) for few in blocks.split(_TOGETHER)]
        blocks, weights = (torch.cat(both) for both in zip(*parts, strict=True))
        area = weights.expand(-1, math.prod(self.sides))
        total, weight = (
            fold(one.T[None], laid.shape[-2:], self.sides, stride=self.stride)[0, :, :rows, :columns]
            for one in (blocks.flatten(1), area)
        )
        return total, weight

    def _thresholded(self, blocks: Tensor, threshold: float) -> tuple[Tensor, Tensor]:
        """Blocks (n, K, h, w) times their weights, and the weights (n, 1)."""
        time, down, right = (_cosines(length, blocks) for length in (self.depth, *self.sides))
        spectrum = torch.einsum("at,nthw->nahw", time, down @ blocks @ right.mT)
        keep = spectrum.abs() >= threshold
        keep[:, 0, 0, 0] = True
        weights = 1 / keep.sum((1, 2, 3))[:, None].to(blocks)
        spectrum = spectrum * keep * weights[..., None, None]
        return down.mT @ torch.einsum("at,nahw->nthw", time, spectrum) @ right, weights


def _cosines(size: int, like: Tensor) -> Tensor:
    """Orthonormal DCT-II matrix (size, size), one frequency per row."""
    index = torch.arange(size, dtype=torch.float64)
    matrix = torch.cos(math.pi / size * torch.outer(index, index + 0.5)) * math.sqrt(2 / size)
    matrix[0] /= math.sqrt(2)
    return matrix.to(like)


@torch.no_grad()
def space_time_dct(
    operator: LinearOperator,
    snapshot: Tensor,
    *,
    last: float,
    first: float | None = None,
    iterations: int = 40,
    progress: Progress | None = None,
) -> Tensor:
    """A scene per frame, (B, K, L, H, W), from snapshots (B, 1, H, W').

    Args:
        operator: of such scenes, as `tmca.operators.SlotwiseDisperser` with ``moving=True``.
        snapshot: that it took.
        last: threshold at the end, > 0, scene units: about the noise of a sample.
        first: threshold at the beginning, above the last; without it half the largest value of the first estimate.
        iterations: over which it falls geometrically, at least 2.
        progress: called with the share that is done.
    """
    data, movie = DataStep(operator, snapshot), local_means(operator, snapshot)
    first = max(0.5 * float(movie.max()), 2 * last) if first is None else first
    if not (0 < last < first and math.isfinite(first)):
        raise SettingError("threshold", f"from {first:g} to {last:g}", "falling, finite and above 0")
    penalty = _PENALTY * energy(operator, operator.A(torch.ones_like(movie[:1])))
    denoise = BlockThreshold(movie.shape[1], (movie.shape[3], movie.shape[4]))
    for iteration in range(iterations):
        threshold = first * (last / first) ** (iteration / (iterations - 1))
        movie = _by_band(denoise, data(movie, penalty), threshold)
        if progress is not None:
            progress((iteration + 1) / iterations)
    return movie


def local_means(operator: LinearOperator, snapshot: Tensor) -> Tensor:
    """(B, K, L, H, W): the light that came from around every place and frame, over that of an even scene.

    Both are backprojected and smoothed by a Gaussian; where no light came from, the mean of all is taken.
    """
    even = torch.ones(len(snapshot), *operator.scene_shape, dtype=snapshot.dtype, device=snapshot.device)
    seen, tiny = operator.A(even), torch.finfo(snapshot.dtype).tiny
    back, light = (_smoothed(operator.A_adjoint(one)) for one in (snapshot, seen))
    level = (snapshot * seen).sum(_SENSOR) / seen.square().sum(_SENSOR).clamp_min(tiny)
    dark = light <= _FAINT * light.max()
    return torch.where(dark, level.reshape(-1, 1, 1, 1, 1), back / light.clamp_min(tiny))


def _smoothed(movie: Tensor) -> Tensor:
    from scipy.ndimage import gaussian_filter

    sigma = (0.0, _NEAR[0], 0.0, *_NEAR[1:])
    return torch.from_numpy(gaussian_filter(movie.cpu().numpy(), sigma, mode="nearest")).to(movie)


def _by_band(denoise: BlockThreshold, movie: Tensor, threshold: float) -> Tensor:
    batch, frames, bands, *size = movie.shape
    flat = movie.transpose(1, 2).reshape(batch * bands, frames, *size)
    return denoise(flat, threshold).reshape(batch, bands, frames, *size).transpose(1, 2)


class FrameOperator(LinearOperator):
    """The operator of movies (B, G, L, H, W) of a camera whose taps are those of all their frames; of light fields, (B,
    G, V, U, H, W)."""

    def __init__(self, taps: Taps, frames: int, channels: Sequence[int]) -> None:
        super().__init__()
        self.collapsed, size = TapOperator(taps), taps.scene_shape[1:]
        self.scene_shape, self.snapshot_shape = (frames, *channels, *size), taps.snapshot_shape

    def A(self, scene: Tensor) -> Tensor:
        return self.collapsed.A(scene.flatten(1, -3))

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        return self.collapsed.A_adjoint(snapshot).unflatten(1, self.scene_shape[:-2])

    def gram_solve(self, snapshot: Tensor, shift: float | Tensor, **iteration: object) -> Tensor:
        """In closed form, see `TapOperator`."""
        return self.collapsed.gram_solve(snapshot, shift, **iteration)


def frame_operator(camera: CodedCamera, frames: int) -> FrameOperator:
    """The operator of a scene that changes ``frames`` times within the exposure, see `frame_taps`."""
    return FrameOperator(frame_taps(camera, frames), frames, camera.scene_shape[:-2])


@dataclass
class FrameDecoder(Decoder):
    """What decoders of scenes that change during the exposure share: frames, and the operator that images them."""

    cameras, moving = frozenset({"spectral"}), True
    needs_taps = True
    frames: int | None = None

    def scene_shape(self, camera: Any) -> tuple[int, ...]:
        return (self.frames or camera.slots, *camera.scene_shape)

    def setup(self, camera: Any, prior: None) -> tuple[FrameOperator, Any]:
        return frame_operator(camera, self.frames or camera.slots), camera


@dataclass
class SpaceTimeDecoder(FrameDecoder):
    """Frames of a scene that changes during the exposure, sparse in the cosine transform of blocks of space and time.

    Args:
        frames: how many, of equal length, a divisor or a multiple of the slots; all slots if None.
        threshold: of coefficients at the end, relative irradiance; half the noise of a sample if None, and 0.5 % of the
            brightest at least.
        iterations: over which the threshold falls to it.
    """

    name, label = "space-time-dct", "space-time DCT"
    threshold: float | None = None
    iterations: int = 40

    def __post_init__(self) -> None:
        if self.threshold is not None:
            check_range("threshold", self.threshold, above=0)
        check_range("iterations", self.iterations, 2, whole=True)

    def reconstruct(self, prepared: tuple[FrameOperator, Any], values: Tensor, progress: Progress | None) -> Tensor:
        return torch.cat([self._frames(*prepared, one, report) for one, report in one_by_one(values, progress)])

    def _frames(
        self, operator: FrameOperator, camera: CodedCamera, values: Tensor, progress: Progress | None
    ) -> Tensor:
        last = self.threshold
        if last is None:
            gain = float(operator.collapsed.taps.gram_diagonal().max().sqrt())
            last = max(0.5 * noise_level(camera, values), 0.005 * float(values.max()), 1e-9) / max(gain, 1e-12)
        return space_time_dct(operator, values, last=last, iterations=self.iterations, progress=progress)
