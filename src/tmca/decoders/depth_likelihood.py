"""Depth by maximum likelihood of patches, and the spectrum by linear MMSE at that depth: no training run.

Under a Gaussian prior of scenes a window of the snapshot is Gaussian at every depth. The plane whose Gaussian explains
the window best is its depth; how bright and how rich in contrast the scene is there tells nothing about depth and is
fitted window by window.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import log

import torch
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.decoders.decoding import Decoded, Progress, check_bands
from tmca.decoders.window_rows import RowBlend, WindowRows
from tmca.errors import SettingError, ShapeError
from tmca.priors import GaussianPrior
from tmca.priors.posterior import NOISE_FLOOR
from tmca.priors.spectral_depth import snapshot_moments

WINDOW = 12
GAINS = tuple(4.0**power for power in range(-4, 4))
"""Variances of a window over the prior's that are tried."""
_NOISE_STEP = 2**0.25
"""Ratio of neighbouring levels of the noise's variance: the same for every snapshot and every part of one."""


@dataclass
class DepthDecoded(Decoded):
    """What a decoder of spectrum and depth returns; ``estimate`` is (B, L, H, W).

    Args:
        depth: (B, 1, H, W) metres.
        confidence: (B, 1, H, W) probability that the depth is right within one bin.
        planes: (B, D, H, W) log-likelihood of every plane, from far to near, up to a constant; empty if not asked for.
    """

    depth: Tensor = field(default_factory=lambda: torch.empty(0))
    confidence: Tensor = field(default_factory=lambda: torch.empty(0))
    planes: Tensor = field(default_factory=lambda: torch.empty(0))


@dataclass(frozen=True)
class _Basis:
    """Windows of one phase of the tile, at every plane: eigenvectors, eigenvalues, and the scene's share in them."""

    vectors: Tensor
    values: Tensor
    scene: Tensor


@dataclass(frozen=True)
class _Found:
    """What is filled in row by row; ``best`` (B, H, W) is the most likely plane."""

    estimate: Tensor
    depth: Tensor
    confidence: Tensor
    planes: Tensor
    best: Tensor

    @classmethod
    def empty(cls, snapshot: Tensor, bands: int, planes: int) -> _Found:
        batch, _, height, width = snapshot.shape
        estimate, depth, confidence, kept = (
            snapshot.new_empty(batch, count, height, width) for count in (bands, 1, 1, planes)
        )
        best = torch.empty(batch, height, width, dtype=torch.int16, device=snapshot.device)
        return cls(estimate, depth, confidence, kept, best)


class PatchLikelihood:
    """Depth and spectrum from windows of a snapshot.

    Windows are worked on row by row, so that beside snapshot and results nothing of the size of the frame is held.

    Args:
        prior: stationary Gaussian prior of the camera's bands, its blocks at least ``needed_block``.
        camera: with periodic shutter and filters.
        window: m, pixels.
        gains: variances over the prior's that are tried for every window.

    Raises:
        SettingError: a camera without a period, a window larger than the sensor, or a prior of other bands.
        ShapeError: a prior that does not fit.
    """

    def __init__(
        self,
        prior: GaussianPrior,
        camera: SpectralDepthCamera,
        window: int = WINDOW,
        gains: Sequence[float] = GAINS,
    ) -> None:
        if window < camera.tile_size or window > min(camera.size):
            known = f"{camera.tile_size} (the tile) to {min(camera.size)} (the sensor) pixels"
            raise SettingError("window", f"{window} pixels", known)
        check_bands(prior, camera.wavelengths)
        self.device = camera.response.device
        self.prior, self.camera, self.window = prior.to(self.device), camera, window
        self.gains = torch.tensor(list(gains), dtype=torch.float64, device=self.device)
        self._psf, self._bases = camera.psf().detach().double(), dict[tuple[int, int], _Basis]()
        self._colour, self._shutter = (part.detach().double() for part in camera.tile())
        self._rows = WindowRows(camera.size, window, camera.tile_size)

    @torch.no_grad()
    def __call__(self, snapshot: Tensor, progress: Progress | None = None, *, planes: bool = True) -> DepthDecoded:
        """Decode snapshots (B, C, H, W).

        Args:
            snapshot: of the camera.
            progress: told the share that is done.
            planes: whether the likelihoods of all planes are returned.

        Raises:
            ShapeError: snapshots of another size or number of channels.
        """
        if tuple(snapshot.shape[1:]) != self.camera.snapshot_shape:
            wanted = f"(batch, {', '.join(map(str, self.camera.snapshot_shape))})"
            raise ShapeError("snapshot", str(tuple(snapshot.shape)), wanted)
        told, count = progress or (lambda share: None), self.camera.planes.count
        pixels, values = self._psf.shape[2] * self.window**2, len(self._colour) * self.window**2
        first = count * values / (count * values + values + pixels)  # of the work
        found = _Found.empty(snapshot, self.camera.bands, count if planes else 0)
        gains = list(self._search(snapshot, found, lambda share: told(first * share)))
        self._fill(snapshot, found, gains, lambda share: told(first + (1 - first) * share))
        return DepthDecoded(found.estimate, depth=found.depth, confidence=found.confidence, planes=found.planes)

    def _search(self, snapshot: Tensor, found: _Found, progress: Progress) -> Iterator[Tensor]:
        """Depth, confidence and planes of the frame; yields the gains, as indices (B, P, D), row by row."""
        likelihood = RowBlend(self._rows, snapshot[..., :1, :1].double(), self.camera.planes.count)
        for phases, tops in self._batches():
            parts = [self._log_likelihood(phase, self._cut(snapshot, tops, which)) for phase, which in phases]
            levels, gains = (torch.cat(part, 2) for part in zip(*parts, strict=True))
            for level in levels.unbind(1):
                rows, planes = likelihood.add(level[..., None, None])
                found.best[:, rows] = planes.argmax(1).to(found.best)
                found.depth[..., rows, :], found.confidence[..., rows, :] = self._depth(planes)
                if found.planes.numel():
                    found.planes[..., rows, :] = planes.to(found.planes)
            yield from gains.unbind(1)
            progress((tops[-1] + 1) / (self._rows.tops[-1] + 1))

    def _fill(self, snapshot: Tensor, found: _Found, gains: list[Tensor], progress: Progress) -> None:
        """The spectrum at the planes that were found."""
        scene, done = RowBlend(self._rows, snapshot[..., :1, :1], self.camera.bands), 0
        for phases, tops in self._batches():
            gain, planes = torch.stack(gains[done : done + len(tops)], 1), self._at_middle(found.best, tops)
            parts = [
                self._scene(phase, self._cut(snapshot, tops, which), planes[:, :, which], gain[:, :, which], snapshot)
                for phase, which in phases
            ]
            for values in torch.cat(parts, 2).unbind(1):
                rows, estimate = scene.add(values)
                found.estimate[..., rows, :] = estimate.clamp_min(0)
            done += len(tops)
            progress((tops[-1] + 1) / (self._rows.tops[-1] + 1))

    def _batches(self) -> Iterator[tuple[list[tuple[tuple[int, int], slice]], list[int]]]:
        """Rows of windows, with the phases of the tile at which they begin and which of their windows do."""
        for tops in self._rows.batches():
            row = tops[0] % self._rows.step
            yield [((row, phase), which) for phase, which in self._rows.columns()], tops

    def _cut(self, snapshot: Tensor, tops: list[int], which: slice) -> Tensor:
        """(B, R, P, n)."""
        return torch.stack([self._rows.cut(snapshot, top, which) for top in tops], 1)

    def _at_middle(self, best: Tensor, tops: list[int]) -> Tensor:
        """(B, R, P) most likely plane in the middle of windows."""
        rows, columns = (torch.tensor(axis, device=best.device) + self.window // 2 for axis in (tops, self._rows.lefts))
        return best[:, rows[:, None], columns].long()

    def _basis(self, phase: tuple[int, int]) -> _Basis:
        if phase not in self._bases:
            begun = [part.roll((-phase[0], -phase[1]), (-2, -1)) for part in (self._colour, self._shutter)]
            found = snapshot_moments(
                self.prior, self._psf, begun[0], begun[1], self.window, exposure=self.camera.exposure, cross=True
            )
            assert found.cross is not None
            values, vectors = torch.linalg.eigh(found.covariance)
            self._bases[phase] = _Basis(vectors, values.clamp_min(0), found.cross @ vectors)
        return self._bases[phase]

    def _log_likelihood(self, phase: tuple[int, int], windows: Tensor) -> tuple[Tensor, Tensor]:
        """(..., D) log-likelihood of windows (..., n) at every plane with the gain that fits best, and its index."""
        basis, (levels, level) = self._basis(phase), self._noise(windows)
        found, chosen = [], []
        for vectors, values in zip(basis.vectors, basis.values, strict=True):
            energy = (windows @ vectors).square()
            each = energy.new_empty(*energy.shape[:-1], len(self.gains))
            for index, variance in enumerate(self.gains[:, None] * values + levels[:, None, None]):
                here = level == index if len(levels) > 1 else slice(None)
                each[here] = -0.5 * (energy[here] @ variance.reciprocal().T + variance.log().sum(-1))
            best = each.max(-1)
            found.append(best.values)
            chosen.append(best.indices.to(torch.uint8))
        return torch.stack(found, -1), torch.stack(chosen, -1)

    def _noise(self, windows: Tensor) -> tuple[Tensor, Tensor]:
        """Levels of the noise's variance, and which one windows (..., n) have: shot noise by a window's mean."""
        noise = self.camera.noise
        least = noise.read**2 + NOISE_FLOOR
        if not noise.shot:
            return windows.new_tensor([least]), torch.zeros(windows.shape[:-1], dtype=torch.long, device=windows.device)
        own = 1 + noise.shot / least * windows.mean(-1).clamp_min(0)
        steps, level = (own.log() / log(_NOISE_STEP)).round().unique(return_inverse=True)
        return least * _NOISE_STEP**steps, level

    def _scene(self, phase: tuple[int, int], windows: Tensor, plane: Tensor, gains: Tensor, like: Tensor) -> Tensor:
        """(B, R, P, L, m, m) linear MMSE estimate of windows (B, R, P, n) at these planes (B, R, P)."""
        basis, (levels, level) = self._basis(phase), self._noise(windows)
        gain = self.gains[gains.gather(-1, plane[..., None]).long()]
        estimate = like.new_zeros(*windows.shape[:-1], basis.scene.shape[1])
        for index in plane.unique().tolist():
            here = plane == index
            own = gain[here] * (windows[here] @ basis.vectors[index])
            own = own / (gain[here] * basis.values[index] + levels[level[here], None])
            estimate[here] = own.to(like) @ basis.scene[index].T.to(like)
        return estimate.unflatten(-1, (self.camera.bands, self.window, self.window))

    def _depth(self, planes: Tensor) -> tuple[Tensor, Tensor]:
        """Metres between planes by a parabola through the best and its neighbours, and the probability of a bin."""
        best = planes.argmax(1, keepdim=True)
        inverse = self.camera.planes.inverse.to(planes)
        place = inverse[best]
        if len(inverse) > 2:
            inner = best.clamp(1, len(inverse) - 2)
            below, here, above = (planes.gather(1, inner + step) for step in (-1, 0, 1))
            bend = (2 * here - below - above).clamp_min(1e-12)
            moved = (0.5 * (above - below) / bend).clamp(-0.5, 0.5)
            place = torch.where(best == inner, place + moved * self.camera.planes.step, place)
        shares = planes.softmax(1)
        around = (torch.arange(len(inverse), device=best.device)[:, None, None] - best).abs() <= 1
        return 1 / place, (shares * around).sum(1, keepdim=True)
