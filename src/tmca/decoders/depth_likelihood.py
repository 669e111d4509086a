"""Depth by maximum likelihood of patches, and the spectrum by linear MMSE at that depth: no training run.

Under a Gaussian prior of scenes a window of the snapshot is Gaussian at every depth. The plane whose Gaussian explains
the window best is its depth; how bright and how rich in contrast the scene is there tells nothing about depth and is
fitted window by window.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import pi

import torch
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.decoders.decoding import Decoded, Progress, check_bands
from tmca.errors import SettingError, ShapeError
from tmca.priors import GaussianPrior
from tmca.priors.posterior import NOISE_FLOOR
from tmca.priors.spectral_depth import snapshot_moments

WINDOW = 12
GAINS = tuple(4.0**power for power in range(-4, 4))
"""Variances of a window over the prior's that are tried."""
_BATCH = 2048
_SHARPNESS = 4
_NOISE_LEVELS = 12
_Place = tuple[tuple[int, int], list[tuple[int, int]]]
"""Phase of the tile, and corners of windows that begin at it."""


@dataclass
class DepthDecoded(Decoded):
    """What a decoder of spectrum and depth returns; ``estimate`` is (B, L, H, W).

    Args:
        depth: (B, 1, H, W) metres.
        confidence: (B, 1, H, W) probability that the depth is right within one bin.
        planes: (B, D, H, W) log-likelihood of every plane, from far to near, up to a constant.
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


class PatchLikelihood:
    """Depth and spectrum from windows of a snapshot.

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

    @torch.no_grad()
    def __call__(self, snapshot: Tensor, progress: Progress | None = None) -> DepthDecoded:
        """Decode snapshots (B, C, H, W).

        Raises:
            ShapeError: snapshots of another size or number of channels.
        """
        if tuple(snapshot.shape[1:]) != self.camera.snapshot_shape:
            wanted = f"(batch, {', '.join(map(str, self.camera.snapshot_shape))})"
            raise ShapeError("snapshot", str(tuple(snapshot.shape)), wanted)
        values, places = snapshot.double(), list(self._places())
        planes, gains = self._planes(values, places, progress)
        scene = _Blend((len(snapshot), *self.camera.scene_shape), self.window, values)
        for count, ((phase, where), gain) in enumerate(zip(places, gains, strict=True)):
            windows, plane = self._windows(values, where), self._at_middle(planes, where)
            scene.add(where, self._scene(phase, windows, plane, gain))
            if progress is not None:
                progress(0.5 + (count + 1) / len(places) / 2)
        depth, confidence = self._depth(planes)
        estimate = scene.result().clamp_min(0).to(snapshot)
        return DepthDecoded(
            estimate, depth=depth.to(snapshot), confidence=confidence.to(snapshot), planes=planes.to(snapshot)
        )

    def _planes(self, values: Tensor, places: list[_Place], progress: Progress | None) -> tuple[Tensor, list[Tensor]]:
        """(B, D, H, W) log-likelihoods, and the gains (B, P, D) of the windows of every batch of places."""
        shape = (len(values), self.camera.planes.count, *self.camera.size)
        likelihood, gains = _Blend(shape, self.window, values), list[Tensor]()
        for count, (phase, where) in enumerate(places):
            found, gain = self._log_likelihood(phase, self._windows(values, where))
            likelihood.add(where, found[..., None, None])
            gains.append(gain)
            if progress is not None:
                progress((count + 1) / len(places) / 2)
        return likelihood.result(), gains

    def _places(self) -> Iterator[_Place]:
        """Corners of windows, by phase of the tile and in batches; together they cover the snapshot."""
        tile, by_phase = self.camera.tile_size, dict[tuple[int, int], list[tuple[int, int]]]()
        tops, lefts = (sorted({*range(0, n - self.window + 1, tile), n - self.window}) for n in self.camera.size)
        for top in tops:
            for left in lefts:
                by_phase.setdefault((top % tile, left % tile), []).append((top, left))
        for phase, where in by_phase.items():
            yield from ((phase, where[i : i + _BATCH]) for i in range(0, len(where), _BATCH))

    def _windows(self, values: Tensor, where: list[tuple[int, int]]) -> Tensor:
        """(B, P, n)."""
        every = values.unfold(2, self.window, 1).unfold(3, self.window, 1)
        tops, lefts = (torch.tensor(axis) for axis in zip(*where, strict=True))
        return every[:, :, tops, lefts].movedim(1, 2).flatten(2)

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
        """(B, P, D) log-likelihood of every plane with the gain that fits best, and that gain."""
        basis, (levels, level) = self._basis(phase), self._noise(windows)
        found, chosen = [], []
        for vectors, values in zip(basis.vectors, basis.values, strict=True):
            energy = (windows @ vectors).square()
            variance = self.gains[:, None] * values + levels[:, None, None]
            each = energy.new_empty(*energy.shape[:2], len(self.gains))
            for index, own in enumerate(variance):
                here = level == index
                each[here] = -0.5 * (energy[here] @ own.reciprocal().T + own.log().sum(-1))
            best = each.max(-1)
            found.append(best.values)
            chosen.append(self.gains[best.indices])
        return torch.stack(found, -1), torch.stack(chosen, -1)

    def _noise(self, windows: Tensor) -> tuple[Tensor, Tensor]:
        """Levels of the noise's variance, and the index (B, P) of the nearest: shot noise by a window's mean."""
        noise = self.camera.noise
        least = noise.read**2 + NOISE_FLOOR
        if not noise.shot:
            return windows.new_tensor([least]), torch.zeros_like(windows[..., 0], dtype=torch.long)
        own = (least + noise.shot * windows.mean(-1).clamp_min(0)).log()
        levels = torch.linspace(float(own.min()), float(own.max()), _NOISE_LEVELS, dtype=own.dtype, device=own.device)
        return levels.exp(), (own[..., None] - levels).abs().argmin(-1)

    def _scene(self, phase: tuple[int, int], windows: Tensor, plane: Tensor, gains: Tensor) -> Tensor:
        """(B, P, L, m, m) linear MMSE estimate of windows at these planes (B, P)."""
        basis, (levels, level) = self._basis(phase), self._noise(windows)
        gain, noise = gains.gather(-1, plane[..., None]), levels[level][..., None]
        estimate = windows.new_zeros(*windows.shape[:2], basis.scene.shape[1])
        for index in range(len(basis.values)):
            here = plane == index
            own = windows[here] @ basis.vectors[index]
            own = gain[here] * own / (gain[here] * basis.values[index] + noise[here])
            estimate[here] = own @ basis.scene[index].T
        return estimate.unflatten(-1, (self.camera.bands, self.window, self.window))

    def _at_middle(self, planes: Tensor, where: list[tuple[int, int]]) -> Tensor:
        """(B, P) most likely plane in the middle of windows."""
        tops, lefts = (torch.tensor(axis) + self.window // 2 for axis in zip(*where, strict=True))
        return planes[:, :, tops, lefts].argmax(1)

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
        around = (torch.arange(len(inverse), device=planes.device)[:, None, None] - best).abs() <= 1
        return 1 / place, (shares * around).sum(1, keepdim=True)


class _Blend:
    """Overlapping windows laid over each other, with weights that fall to their rims."""

    def __init__(self, shape: tuple[int, ...], window: int, like: Tensor) -> None:
        self.sum, self.weight = like.new_zeros(shape), like.new_zeros(shape[2:])
        ramp = torch.sin(pi * (torch.arange(window, dtype=like.dtype, device=like.device) + 0.5) / window) ** _SHARPNESS
        self.share, self.window = torch.outer(ramp, ramp), window

    def add(self, where: list[tuple[int, int]], values: Tensor) -> None:
        """Lay windows (B, P, C, m, m), or constants (B, P, C, 1, 1), at their corners."""
        for index, (top, left) in enumerate(where):
            rows, columns = slice(top, top + self.window), slice(left, left + self.window)
            self.sum[..., rows, columns] += values[:, index] * self.share
            self.weight[rows, columns] += self.share

    def result(self) -> Tensor:
        """(B, C, H, W)."""
        return self.sum / self.weight
