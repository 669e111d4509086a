"""What a window of a snapshot tells about its depth, locally: Fisher information about inverse depth at every plane."""

from __future__ import annotations

import torch
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.design.spectral_depth import window_covariance
from tmca.optics import DepthPlanes, PointSpread
from tmca.priors import GaussianPrior
from tmca.priors.spectral_depth import CONTAMINATION, snapshot_moments

STEP = 0.01
"""Bins to either side over which moments are differenced; twice or half of it moves information by less than 0.1 %."""


def depth_information(
    camera: SpectralDepthCamera, prior: GaussianPrior, window: int, contamination: float = CONTAMINATION
) -> Tensor:
    """(D,) Fisher information of a window about inverse depth, squares of metres: ``½ tr(C⁻¹ C′ C⁻¹ C′)``.

    C are the second moments at a plane, C′ their slope there, from point spread functions a little beyond and before
    it. What a window expects of other planes does not move with its own. The information of a
    Gaussian's mean, ``μ′ᵀ C⁻¹ μ′`` (Kay 1993, eq. 3.31), is nil: the brightness of a window is not known, so that its
    mean is a part of C. Differentiable in masks, shutter and filters.

    Arguments and errors as of ``window_covariance``.
    """
    covariance = window_covariance(camera, prior, window, contamination)
    low = camera.planes.inverse[0].item()
    step = STEP * (camera.planes.step or low)
    shifts = (-min(step, low), step)
    farther, nearer = (_moments(camera, prior, window, shift) for shift in shifts)
    slope = (1 - contamination) * (nearer - farther) / (shifts[1] - shifts[0])
    return fisher_information(covariance, slope)


def fisher_information(covariance: Tensor, slope: Tensor) -> Tensor:
    """(…,) information of Gaussians without a mean about what they move with: ``½ tr(C⁻¹ C′ C⁻¹ C′)``.

    Args:
        covariance: (…, n, n) C.
        slope: (…, n, n) C′, its derivative.
    """
    relative = torch.linalg.solve(covariance, slope)
    return 0.5 * (relative * relative.mT).sum((-2, -1))


def _moments(camera: SpectralDepthCamera, prior: GaussianPrior, window: int, shift: float) -> Tensor:
    """(D, n, n) second moments of windows without noise, every plane moved by inverse metres."""
    colour, shutter = (part.double() for part in camera.tile())
    moved, spread = _moved(camera.planes, shift), camera.spread
    waves = camera.bench.waves(camera.wavelengths, moved).to(spread.waves.device)
    there = PointSpread(spread.heights, waves, spread.per_metre, spread.propagator, spread.energy, spread.oversampling)
    return snapshot_moments(prior, there().double(), colour, shutter, window, exposure=camera.exposure).covariance


def _moved(planes: DepthPlanes, shift: float) -> DepthPlanes:
    near, far = (1 / end + shift for end in (planes.near, planes.far))
    return DepthPlanes(1 / near, 1 / far if far > 0 else float("inf"), planes.count)
