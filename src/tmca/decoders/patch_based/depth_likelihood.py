"""Depth by the likelihood of patches, and the spectrum by linear MMSE at the depths that are likely: no training run.

Under a Gaussian prior of scenes a window of the snapshot is Gaussian at every depth. How well each plane explains the
windows around a pixel is how likely it is there; how bright and how rich in contrast the scene is tells nothing about
depth and is fitted window by window. A share of every window is expected to be of other depths, whichever: without it
masks that are sharp at their best plane fail at edges of depth.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import log

import torch
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.decoders.decoding import Decoded, Progress, check_bands
from tmca.decoders.patch_based.depth_posterior import DepthPosterior
from tmca.decoders.patch_based.window_rows import RowBlend, RowMean, WindowRows
from tmca.errors import SettingError, ShapeError
from tmca.priors import GaussianPrior
from tmca.priors.posterior import NOISE_FLOOR
from tmca.priors.spectral_depth import CONTAMINATION, WINDOW, snapshot_moments

GAINS = tuple(4.0**power for power in range(-4, 4))
"""Variances of a window over the prior's that are tried."""
TEMPERATURE = 12.0
"""What the likelihood of a window is divided by. Real windows are not Gaussian, have edges of depth, and overlap: taken
at its word the likelihood is far too sure."""
REACH = 24
"""Pixels beyond its rim at which a window still has a say in the depth.

This and the temperature have the least error of depth on training scenes (``benchmarks/depth_likelihood.py``)."""
_LEAST_SHARE = 0.05
"""Of the likeliest plane in the middle of a window: less likely ones are left out of its spectrum."""
_LIKELY = 2
"""Planes of a window, about, that are not left out."""
_NOISE_STEP = 2**0.25
"""Ratio of neighbouring levels of the noise's variance: the same for every snapshot and every part of one."""


@dataclass
class DepthDecoded(Decoded):
    """What a decoder of spectrum and depth returns; ``estimate`` is (B, L, H, W).

    Args:
        depth: (B, 1, H, W) metres.
        confidence: (B, 1, H, W) probability of the bin of the depth and its two neighbours.
        planes: (B, D, H, W) log-probability of every plane, from far to near, up to a constant; empty if not asked for.
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
    """What is filled in row by row; ``shares`` (B, rows of windows, P, D) are the planes' probabilities in their
    middles."""

    estimate: Tensor
    depth: Tensor
    confidence: Tensor
    planes: Tensor
    shares: Tensor

    @classmethod
    def empty(cls, snapshot: Tensor, bands: int, planes: int, kept: bool, windows: WindowRows) -> _Found:
        batch, _, height, width = snapshot.shape
        estimate, depth, confidence, every = (
            snapshot.new_empty(batch, count, height, width) for count in (bands, 1, 1, planes if kept else 0)
        )
        shares = snapshot.new_empty(batch, len(windows.tops), len(windows.lefts), planes)
        return cls(estimate, depth, confidence, every, shares)


def usual_window(camera: SpectralDepthCamera) -> int:
    """Side of windows in pixels where none is given: ``WINDOW``, or the tile of the codes where that is larger.

    Raises:
        SettingError: shutter patterns that do not repeat.
    """
    return max(WINDOW, camera.tile_size)


def check_window(
    window: int,
    camera: SpectralDepthCamera,
    where: str = "window",
    remedy: str = "leave it out, or give one in between",
) -> None:
    """Raises SettingError unless windows of this side hold a tile of the codes and lie on the sensor."""
    least, most = camera.tile_size, min(camera.size)
    if not isinstance(window, int) or not least <= window <= most:
        known = f"{least} (the tile of the codes) to {most} (the sensor)"
        raise SettingError(where, f"{window} pixels", known, remedy)


class PatchLikelihood:
    """Depth and spectrum from windows of a snapshot.

    Windows are worked on row by row, so that beside snapshot and results nothing of the size of the frame is held.

    Args:
        prior: stationary Gaussian prior of the camera's bands, its blocks at least ``needed_block``.
        camera: with periodic shutter and filters.
        window: m, pixels; `usual_window` if None.
        gains: variances over the prior's that are tried for every window.
        temperature: what a window's log-likelihood is divided by before it counts as a probability.
        reach: pixels beyond its rim at which a window still has a say in the depth.
        contamination: see ``snapshot_moments``.

    Raises:
        SettingError: a camera without a period, a window larger than the sensor, a prior of other bands, a temperature
            of 0 or less, a negative reach, or a contamination that is no share.
        ShapeError: a prior that does not fit.
    """

    def __init__(
        self,
        prior: GaussianPrior,
        camera: SpectralDepthCamera,
        window: int | None = None,
        gains: Sequence[float] = GAINS,
        *,
        temperature: float = TEMPERATURE,
        reach: int = REACH,
        contamination: float = CONTAMINATION,
    ) -> None:
        window = usual_window(camera) if window is None else window
        check_window(window, camera)
        if not temperature > 0 or reach < 0 or not 0 <= contamination <= 1:
            given = f"{temperature:g}, {reach} pixels, {contamination:g}"
            raise SettingError("temperature, reach, contamination", given, "above 0, 0 pixels or more, and 0 to 1")
        check_bands(prior, camera.wavelengths)
        self.device = camera.response.device
        self.prior, self.camera, self.window = prior.to(self.device), camera, window
        self.temperature, self.reach, self.contamination = temperature, reach, contamination
        self.gains = torch.tensor(list(gains), dtype=torch.float64, device=self.device)
        self._psf, self._bases = camera.psf().detach().double(), dict[tuple[int, int], _Basis]()
        self._colour, self._shutter = (part.detach().double() for part in camera.tile())
        self._rows = WindowRows(camera.size, window, camera.tile_size)

    @torch.no_grad()
    def __call__(
        self, snapshot: Tensor, progress: Progress | None = None, *, planes: bool = True, spectrum: bool = True
    ) -> DepthDecoded:
        """Decode snapshots (B, C, H, W).

        Args:
            snapshot: of the camera.
            progress: told the share that is done.
            planes: whether the log-probabilities of all planes are returned.
            spectrum: whether the cube is estimated, which is empty otherwise.

        Raises:
            ShapeError: snapshots of another size or number of channels.
        """
        if tuple(snapshot.shape[1:]) != self.camera.snapshot_shape:
            wanted = f"(batch, {', '.join(map(str, self.camera.snapshot_shape))})"
            raise ShapeError("snapshot", str(tuple(snapshot.shape)), wanted)
        told, count = progress or (lambda share: None), self.camera.planes.count
        pixels, values = self._psf.shape[2] * self.window**2, len(self._colour) * self.window**2
        first = count * values / (count * values + _LIKELY * (values + pixels)) if spectrum else 1.0  # of the work
        found = _Found.empty(snapshot, self.camera.bands if spectrum else 0, count, planes, self._rows)
        gains = list(self._search(snapshot, found, lambda share: told(first * share)))
        if spectrum:
            self._fill(snapshot, found, gains, lambda share: told(first + (1 - first) * share))
        return DepthDecoded(found.estimate, depth=found.depth, confidence=found.confidence, planes=found.planes)

    def _search(self, snapshot: Tensor, found: _Found, progress: Progress) -> Iterator[Tensor]:
        """Depth, confidence and planes of the frame; yields the gains, as indices (B, P, D), row by row."""
        mean = RowMean(self._rows, snapshot[..., :1, :1].double(), self.camera.planes.count, self.reach)
        for phases, tops in self._batches():
            parts = [self._log_likelihood(phase, self._cut(snapshot, tops, which)) for phase, which in phases]
            levels, gains = (torch.cat(part, 2) for part in zip(*parts, strict=True))
            for level in levels.unbind(1):
                self._keep(found, *mean.add(level / self.temperature))
            yield from gains.unbind(1)
            progress((tops[-1] + 1) / (self._rows.tops[-1] + 1))

    def _keep(self, found: _Found, rows: slice, planes: Tensor) -> None:
        """What the log-probabilities of planes in some rows say."""
        here, half = DepthPosterior.of(planes, self.camera.planes), self.window // 2
        found.depth[..., rows, :] = here.metres.to(found.depth)
        found.confidence[..., rows, :] = here.confidence.to(found.confidence)
        if found.planes.numel():
            found.planes[..., rows, :] = planes.to(found.planes)
        columns = torch.tensor(self._rows.lefts, device=planes.device) + half
        for index, top in enumerate(self._rows.tops):
            if rows.start <= top + half < rows.stop:
                own = here.shares[:, :, top + half - rows.start, columns]
                found.shares[:, index] = own.transpose(1, 2).to(found.shares)

    def _fill(self, snapshot: Tensor, found: _Found, gains: list[Tensor], progress: Progress) -> None:
        """The spectrum at the planes that are likely."""
        scene, done = RowBlend(self._rows, snapshot[..., :1, :1], self.camera.bands), 0
        for phases, tops in self._batches():
            gain, shares = torch.stack(gains[done : done + len(tops)], 1), found.shares[:, done : done + len(tops)]
            parts = [
                self._scene(phase, self._cut(snapshot, tops, which), shares[:, :, which], gain[:, :, which])
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

    def _basis(self, phase: tuple[int, int]) -> _Basis:
        if phase not in self._bases:
            begun = [part.roll((-phase[0], -phase[1]), (-2, -1)) for part in (self._colour, self._shutter)]
            found = snapshot_moments(
                self.prior, self._psf, begun[0], begun[1], self.window, exposure=self.camera.exposure,
                contamination=self.contamination, cross=True,
            )  # fmt: skip
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

    def _scene(self, phase: tuple[int, int], windows: Tensor, shares: Tensor, gains: Tensor) -> Tensor:
        """(B, R, P, L, m, m) mean of the linear MMSE estimates of windows (B, R, P, n) at planes of these probabilities
        (B, R, P, D)."""
        basis, (levels, level) = self._basis(phase), self._noise(windows)
        shares = shares * (shares >= _LEAST_SHARE * shares.amax(-1, keepdim=True))
        shares = shares / shares.sum(-1, keepdim=True)
        estimate = shares.new_zeros(*windows.shape[:-1], basis.scene.shape[1])
        for index in shares.flatten(0, -2).any(0).nonzero().flatten().tolist():
            here = shares[..., index] > 0
            gain = self.gains[gains[..., index][here].long()][:, None]
            own = (
                gain * (windows[here] @ basis.vectors[index]) / (gain * basis.values[index] + levels[level[here], None])
            )
            estimate[here] += (shares[..., index][here][:, None] * own).to(shares) @ basis.scene[index].T.to(shares)
        return estimate.unflatten(-1, (self.camera.bands, self.window, self.window))
