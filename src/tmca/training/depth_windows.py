"""Depth by the patch likelihood as a loss: what masks, shutter and filters learn depth from."""

from __future__ import annotations

from collections.abc import Sequence
from math import lcm

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from tmca.cameras import SpectralDepthCamera
from tmca.decoders.likelihood import GAINS, REACH, TEMPERATURE
from tmca.decoders.nets.two_headed import DepthEstimate
from tmca.operators.window_moments import CONTAMINATION, WINDOW, snapshot_moments
from tmca.priors import GaussianPrior
from tmca.priors.gaussian_posterior import NOISE_FLOOR

SIDE = 8
"""Of the windows that codes learn from, pixels: smaller than the decoder's, which costs a third."""


class DepthWindows:
    """How likely the patch likelihood holds every plane, differentiable in masks, shutter and filters.

    The estimate that `PatchLikelihood` makes, of windows that stand side by side: under the patch prior the covariances
    of windows follow the codes, and so do the windows themselves. Without shot noise it is the same; with it all
    windows here have the noise of their mean brightness, where the decoder gives each its own. Of a 1 000 e⁻ full well
    half of the windows are likeliest at another plane for that, as often a better one as a worse.

    Args:
        prior: stationary Gaussian prior of the camera's bands, its blocks at least ``needed_block``.
        window: m, pixels; the tile of the codes where that is larger.
        gains: variances over the prior's that are tried for every window.
        temperature: what the log-likelihood of windows of ``WINDOW`` pixels is divided by; that of smaller ones says
            less, and is divided by less.
        reach: pixels beyond its rim at which a window still has a say in the depth.
    """

    def __init__(
        self,
        prior: GaussianPrior,
        window: int = SIDE,
        gains: Sequence[float] = GAINS,
        temperature: float = TEMPERATURE,
        reach: int = REACH,
    ) -> None:
        self.prior, self.window, self.gains = prior, window, tuple(gains)
        self.temperature, self.reach = temperature, reach

    def __call__(self, camera: SpectralDepthCamera, snapshot: Tensor, place: Tensor) -> tuple[DepthEstimate, Tensor]:
        """Planes of windows of snapshots (B, C, H, W) that begin at the first pixel of a tile.

        Args:
            camera: that took them, its sensor too.
            snapshot: in snapshot units.
            place: (B, 1, H, W) inverse depth as a share of the range, NaN where it is unknown.

        Returns:
            An estimate without cube, a pixel a window, and the place in the middle of every window.
        """
        side = max(self.window, camera.tile_size)
        stride = lcm(side, camera.tile_size)
        windows = snapshot.double().unfold(2, side, stride).unfold(3, side, stride).permute(0, 2, 3, 1, 4, 5).flatten(3)
        levels = self._log_likelihood(camera, windows, side) / (self.temperature * (side / WINDOW) ** 2)
        away = self.reach // stride
        mean = avg_pool2d(levels.permute(0, 3, 1, 2), 2 * away + 1, 1, away, count_include_pad=False)
        middle = place[..., side // 2 :: stride, side // 2 :: stride][..., : mean.shape[2], : mean.shape[3]]
        return DepthEstimate(snapshot.new_zeros(0), mean.to(snapshot.dtype)), middle

    def _log_likelihood(self, camera: SpectralDepthCamera, windows: Tensor, side: int) -> Tensor:
        """(..., D) of windows (..., n) with the gain that fits best."""
        colour, shutter = (part.double() for part in camera.tile())
        scene = snapshot_moments(
            self.prior, camera.psf().double(), colour, shutter, side, exposure=camera.exposure,
            contamination=CONTAMINATION,
        ).covariance  # fmt: skip
        noise = camera.noise.read**2 + NOISE_FLOOR + camera.noise.shot * float(windows.detach().mean())
        noise_covariance = torch.eye(scene.shape[-1], dtype=scene.dtype, device=scene.device) * noise
        levels = [_normal(windows.flatten(0, -2), gain * scene + noise_covariance) for gain in self.gains]
        return torch.stack(levels).amax(0).unflatten(0, windows.shape[:-1])


def _normal(windows: Tensor, covariance: Tensor) -> Tensor:
    """(N, D) log-likelihood of windows (N, n) without mean and covariance (D, n, n), up to a constant."""
    factors = torch.linalg.cholesky(covariance)
    misfit = torch.linalg.solve_triangular(factors, windows.T, upper=False).square().sum(1) / 2
    return -(misfit + factors.diagonal(dim1=1, dim2=2).log().sum(1)[:, None]).T
