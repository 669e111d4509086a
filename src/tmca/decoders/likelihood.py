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
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.decoders.batches import part_of
from tmca.decoders.decoder import Decoder, Progress, Raw
from tmca.decoders.window_basis import WindowBasis, shortened
from tmca.errors import SettingError, check_range, check_shape
from tmca.operators.window_moments import CONTAMINATION, WINDOW, sensed_psf, snapshot_moments
from tmca.operators.windows import RowBlend, RowMean, WindowRows
from tmca.optics import DepthPlanes
from tmca.priors import GaussianPrior, block_of, find_prior
from tmca.priors.gaussian_posterior import NOISE_FLOOR, noise_variance

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


@dataclass(frozen=True)
class DepthPosterior:
    """What is likely of depth, pixel by pixel.

    Args:
        metres: (B, 1, H, W) median of depth, the estimate of least expected absolute error.
        deviation: (B, 1, H, W) metres, root mean square distance from it.
        plane: (B, 1, H, W) index of the plane that is in its bin.
        confidence: (B, 1, H, W) probability of that plane and its neighbours.
        shares: (B, D, H, W) probability of every plane.
    """

    metres: Tensor
    deviation: Tensor
    plane: Tensor
    confidence: Tensor
    shares: Tensor

    @classmethod
    def of(cls, log_probability: Tensor, planes: DepthPlanes) -> DepthPosterior:
        """From the log-probability (B, D, H, W) of every plane, up to a constant.

        Within the bin of a plane all inverse depths are taken as equally likely; nothing is nearer than the nearest
        plane or farther than the farthest.
        """
        inverse, shares = planes.inverse.to(log_probability), log_probability.softmax(1)
        total = shares.cumsum(1)
        plane = (total >= 0.5 * total[:, -1:]).to(torch.uint8).argmax(1, keepdim=True)
        here = shares.gather(1, plane)
        into = 1 - (total.gather(1, plane) - 0.5) / here  # share of the bin that is farther than the median
        place = (inverse[plane] + (into.clamp(0, 1) - 0.5) * planes.step).clamp(float(inverse[0]), float(inverse[-1]))
        # Of a plane at infinity the middle of its bin, in inverse depth.
        metres = 1 / inverse.clamp_min(planes.step / 4)[:, None, None]
        apart = (shares * ((metres - 1 / place).square() + (metres.square() * planes.step).square() / 12)).sum(1, True)
        around = (torch.arange(planes.count, device=plane.device)[:, None, None] - plane).abs() <= 1
        return cls(1 / place, apart.sqrt(), plane, (shares * around).sum(1, keepdim=True), shares)


@dataclass
class DepthRaw(Raw):
    """What a decoder of spectrum and depth returns: depth and how sure it is are always there."""

    depth: Tensor = field(default_factory=lambda: torch.empty(0))
    confidence: Tensor = field(default_factory=lambda: torch.empty(0))
    depth_deviation: Tensor = field(default_factory=lambda: torch.empty(0))


def usual_window(camera: SpectralDepthCamera) -> int:
    """Side of windows in pixels where none is given: ``WINDOW``, or the tile of the codes where that is larger."""
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
        wanted = f"{least} (the tile of the codes) to {most} (the sensor)"
        raise SettingError(where, f"{window} pixels", wanted, remedy)


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
        SettingError, ShapeError: a camera without a period, a number out of range, or a prior that does not fit.
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
        check_range("temperature", temperature, above=0)
        check_range("reach", reach, 0, unit="pixels")
        check_range("contamination", contamination, 0, 1)
        prior.check(camera)
        self.device = camera.response.device
        self.prior, self.camera, self.window = prior.to(self.device), camera, window
        self.temperature, self.reach, self.contamination = temperature, reach, contamination
        self.gains = torch.tensor(list(gains), dtype=torch.float64, device=self.device)
        self._psf, self._bases = camera.psf().detach().double(), dict[tuple[int, int], WindowBasis]()
        self._colour, self._shutter = (part.detach().double() for part in camera.tile())
        self._rows = WindowRows(camera.size, window, camera.tile_size)
        self._spectra: Tensor | None = None

    @torch.no_grad()
    def precompute(self) -> PatchLikelihood:
        """Compute what all snapshots have in common, and leave out of it what carries next to nothing, some thousandths
        of a dB: the next ones take a quarter of the time. All is kept where noise is next to none."""
        if self._spectra is not None:
            return self
        phases = sorted({phase for _, row in self._rows.batches() for phase, _ in row})
        bases = [self._basis(phase) for phase in phases]
        mean, variance = self.prior.mean[:, 0, 0], self.prior.variance[:: self.prior.mean[0].numel()]
        noise = noise_variance(self._usual(mean), self.camera.noise)
        short = shortened(bases, mean.square() + variance, float(self.gains.max()), float(noise))
        if short is not None:
            self._spectra, self._bases = short[0].float(), dict(zip(phases, short[1], strict=True))
        return self

    def _usual(self, spectrum: Tensor) -> Tensor:
        """Mean of a snapshot of a uniform scene (L,)."""
        whole = self._psf.sum((-2, -1), keepdim=True)
        seen = sensed_psf(whole, self._colour, self._shutter, self.camera.exposure)[..., 0, 0]
        return (seen @ spectrum).mean()

    @torch.no_grad()
    def __call__(
        self, snapshot: Tensor, progress: Progress | None = None, *, planes: bool = True, spectrum: bool = True
    ) -> DepthRaw:
        """Decode snapshots (B, C, H, W).

        Args:
            snapshot: of the camera.
            progress: called with the share that is done.
            planes: whether the log-probabilities of all planes are returned.
            spectrum: whether the cube is estimated, which is empty otherwise.
        """
        check_shape("snapshot", snapshot, ("B", *self.camera.snapshot_shape))
        count = self.camera.planes.count
        pixels, values = self._psf.shape[2] * self.window**2, len(self._colour) * self.window**2
        first = count * values / (count * values + _LIKELY * (values + pixels)) if spectrum else 1.0  # of the work
        channels = (self.camera.bands if spectrum else 0, 1, 1, 1, count if planes else 0)
        parts = (snapshot.new_empty(len(snapshot), some, *self.camera.size) for some in channels)
        cube, depth, sure, apart, logs = parts
        shares = snapshot.new_empty(len(snapshot), len(self._rows.tops), len(self._rows.lefts), count)
        frame = DepthRaw(cube, None, depth, sure, logs if planes else None, depth_deviation=apart)
        gains = list(self._search(snapshot, frame, shares, part_of(progress, 0, first)))
        if spectrum:
            self._fill(snapshot, frame.values, shares, gains, part_of(progress, first, 1))
        return frame

    def _search(self, snapshot: Tensor, frame: DepthRaw, shares: Tensor, progress: Progress) -> Iterator[Tensor]:
        """Depth, how sure it is, and planes of the frame, and the planes' shares (B, rows of windows, P, D) in the
        middles of windows; yields the gains, as indices (B, P, D), row by row."""
        mean = RowMean(self._rows, snapshot[..., :1, :1].double(), self.camera.planes.count, self.reach)
        for tops, phases in self._rows.batches():
            parts = [self._log_likelihood(phase, self._rows.cut(snapshot, tops, which)) for phase, which in phases]
            levels, gains = (torch.cat(part, 2) for part in zip(*parts, strict=True))
            for level in levels.unbind(1):
                self._store(frame, shares, *mean.add(level.double() / self.temperature))
            yield from gains.unbind(1)
            progress((tops[-1] + 1) / (self._rows.tops[-1] + 1))

    def _store(self, frame: DepthRaw, shares: Tensor, rows: slice, planes: Tensor) -> None:
        """What the log-probabilities of planes in some rows say."""
        here, half = DepthPosterior.of(planes, self.camera.planes), self.window // 2
        frame.depth[..., rows, :] = here.metres.to(frame.depth)
        frame.confidence[..., rows, :] = here.confidence.to(frame.confidence)
        frame.depth_deviation[..., rows, :] = here.deviation.to(frame.depth_deviation)
        if frame.planes is not None:
            frame.planes[..., rows, :] = planes.to(frame.planes)
        columns = torch.tensor(self._rows.lefts, device=planes.device) + half
        for index, top in enumerate(self._rows.tops):
            if rows.start <= top + half < rows.stop:
                middles = here.shares[:, :, top + half - rows.start, columns]
                shares[:, index] = middles.transpose(1, 2).to(shares)

    def _fill(self, snapshot: Tensor, cube: Tensor, shares: Tensor, gains: list[Tensor], progress: Progress) -> None:
        """The spectrum at the planes that are likely."""
        spectra = None if self._spectra is None else self._spectra.to(snapshot)
        scene, done = RowBlend(self._rows, snapshot[..., :1, :1], self._channels), 0
        for tops, phases in self._rows.batches():
            gain, here = torch.stack(gains[done : done + len(tops)], 1), shares[:, done : done + len(tops)]
            parts = [
                self._scene(phase, self._rows.cut(snapshot, tops, which), here[:, :, which], gain[:, :, which])
                for phase, which in phases
            ]
            for values in torch.cat(parts, 2).unbind(1):
                rows, estimate = scene.add(values)
                if spectra is not None:
                    estimate = torch.einsum("lk,bkhw->blhw", spectra, estimate)
                cube[..., rows, :] = estimate.clamp_min(0)
            done += len(tops)
            progress((tops[-1] + 1) / (self._rows.tops[-1] + 1))

    @property
    def _channels(self) -> int:
        """Of windows' estimates: bands, or spectra that these are sums of."""
        return self.camera.bands if self._spectra is None else self._spectra.shape[1]

    def _basis(self, phase: tuple[int, int]) -> WindowBasis:
        if phase not in self._bases:
            begun = [part.roll((-phase[0], -phase[1]), (-2, -1)) for part in (self._colour, self._shutter)]
            moments = snapshot_moments(
                self.prior, self._psf, begun[0], begun[1], self.window, exposure=self.camera.exposure,
                contamination=self.contamination, cross=True,
            )  # fmt: skip
            self._bases[phase] = WindowBasis.of(moments)
        return self._bases[phase]

    def _log_likelihood(self, phase: tuple[int, int], windows: Tensor) -> tuple[Tensor, Tensor]:
        """(..., D) log-likelihood of windows (..., n) at every plane with the gain that fits best, and its index."""
        basis, (levels, level) = self._basis(phase), self._noise(windows)
        seen, likelihoods, chosen = basis.seen(windows), [], []
        for vectors, values in zip(basis.vectors, basis.values, strict=True):
            energy = (seen @ vectors).square()
            each = energy.new_empty(*energy.shape[:-1], len(self.gains))
            for index, variance in enumerate(self.gains[:, None] * values + levels[:, None, None]):
                here = level == index if len(levels) > 1 else slice(None)
                weights, apart = variance.reciprocal().T.to(energy), variance.log().sum(-1).to(energy)
                each[here] = -0.5 * (energy[here] @ weights + apart)
            best = each.max(-1)
            likelihoods.append(best.values)
            chosen.append(best.indices.to(torch.uint8))
        return torch.stack(likelihoods, -1), torch.stack(chosen, -1)

    def _noise(self, windows: Tensor) -> tuple[Tensor, Tensor]:
        """Levels of the noise's variance, and which one windows (..., n) have: shot noise by a window's mean."""
        noise = self.camera.noise
        least = noise.read**2 + NOISE_FLOOR
        if not noise.shot:
            return windows.new_tensor([least]), torch.zeros(windows.shape[:-1], dtype=torch.long, device=windows.device)
        relative = 1 + noise.shot / least * windows.mean(-1).clamp_min(0)
        steps, level = (relative.log() / log(_NOISE_STEP)).round().unique(return_inverse=True)
        return least * _NOISE_STEP**steps, level

    def _scene(self, phase: tuple[int, int], windows: Tensor, shares: Tensor, gains: Tensor) -> Tensor:
        """(B, R, P, L, m, m) mean of the linear MMSE estimates of windows (B, R, P, n) at planes of these probabilities
        (B, R, P, D)."""
        basis, (levels, level) = self._basis(phase), self._noise(windows)
        shares = shares * (shares >= _LEAST_SHARE * shares.amax(-1, keepdim=True))
        shares = shares / shares.sum(-1, keepdim=True)
        like, windows = shares if basis.patterns is None else basis.patterns, basis.seen(windows)
        estimate = like.new_zeros(*windows.shape[:-1], basis.scene.shape[1])
        for index in shares.flatten(0, -2).any(0).nonzero().flatten().tolist():
            here = shares[..., index] > 0
            gain, share = self.gains[gains[..., index][here].long()][:, None], shares[..., index][here][:, None]
            filtered = gain / (gain * basis.values[index] + levels[level[here], None])
            seen = share * filtered * (windows[here] @ basis.vectors[index])
            estimate[here] += seen.to(like) @ basis.scene[index].T.to(like)
        return basis.laid(estimate).to(shares).unflatten(-1, (self._channels, self.window, self.window))


@dataclass
class LikelihoodDecoder(Decoder):
    """Depth by the likelihood of every plane under a patch prior, and the spectrum at the depths that are likely.

    Args:
        window: side of the windows, pixels; 12 if None, or the tile of the codes where that is larger.
        planes: also return the log-probability of every plane.
        calibrated: bring the depth's standard deviation to the errors of known scenes; False leaves that of the planes.
    """

    name, label, cameras = "likelihood", "patch likelihood", frozenset({"spectral-depth"})
    prior_kind = "gaussian"
    window: int | None = None
    planes: bool = False
    calibrated: bool = True

    def find_prior(self, camera: Any, given: Any, progress: Progress | None = None) -> Any:
        if self.window is not None:
            check_window(self.window, camera)
            if given is None:
                return find_prior(camera, progress=progress, block=block_of(camera, window=self.window))
        return find_prior(camera, given, "gaussian", progress)

    def setup(self, camera: Any, prior: Any) -> PatchLikelihood:
        return PatchLikelihood(prior, camera, self.window)

    def precompute(self, prepared: PatchLikelihood, bank: Path | None = None) -> PatchLikelihood:
        super().precompute(prepared, bank)
        return prepared.precompute()

    def reconstruct(self, prepared: PatchLikelihood, values: Tensor, progress: Progress | None) -> Raw:
        return prepared(values, progress, planes=self.planes)
