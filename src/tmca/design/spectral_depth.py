"""How well a snapshot tells depths apart, without any decoder: distances between depths, and masks that keep them.

Under the patch prior the snapshot of a window is Gaussian at every depth, with zero mean and the second moments of
``snapshot_moments`` (its brightness is part of them, so that brightness is no cue). All figures are differentiable in
the moments, and so in masks, shutter and filters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Any

import torch
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.design.search import Best
from tmca.errors import SettingError, check_range
from tmca.operators.window_moments import CONTAMINATION, SnapshotMoments, snapshot_moments
from tmca.optics import DepthPlanes, PointSpread
from tmca.priors import GaussianPrior
from tmca.priors.gaussian_posterior import NOISE_FLOOR

STEP = 0.01
"""Bins to either side over which moments are differenced; twice or half of it moves information by less than 0.1 %."""


@dataclass(frozen=True)
class WindowPrediction:
    """What the patch prior says of windows at every plane.

    Args:
        covariance: (D, n, n) second moments of recorded windows, scene and noise.
        spectral_error: (D,) mean squared error of the linear MMSE cube of a window whose plane is known.
    """

    covariance: Tensor
    spectral_error: Tensor


def window_covariance(
    camera: SpectralDepthCamera, prior: GaussianPrior, window: int, contamination: float = CONTAMINATION
) -> Tensor:
    """(D, n, n) second moments of recorded windows at every plane: scene and noise of the camera's sensor.

    Shot noise is that of the prior's mean brightness.

    Args:
        camera: with periodic shutter and filters.
        prior: of scenes, its blocks at least ``needed_block``.
        window: m, pixels.
        contamination: see ``snapshot_moments``.

    Raises:
        ShapeError, SettingError: see ``snapshot_moments``.
    """
    return _recorded(camera, prior, window, contamination)[0]


def predict_windows(
    camera: SpectralDepthCamera, prior: GaussianPrior, window: int, contamination: float = CONTAMINATION
) -> WindowPrediction:
    """How windows of a camera look at every plane, and how well their spectrum can be told.

    Arguments and errors as of ``window_covariance``.
    """
    covariance, cross = _recorded(camera, prior, window, contamination, cross=True)
    assert cross is not None
    white = torch.linalg.solve_triangular(torch.linalg.cholesky(covariance), cross.mT, upper=False)
    rows, columns = (side - 1 for side in prior.block[1:])
    mean = prior.mean[:, 0, 0].to(covariance)
    power = prior.displaced[..., rows, columns].diagonal().to(mean) + mean.square()  # brightness as in the moments
    explained = white.square().sum((-2, -1)) / cross.shape[1]
    return WindowPrediction(covariance, power.mean() - explained)


def _moments(
    camera: SpectralDepthCamera, prior: GaussianPrior, window: int, psf: Tensor, **how: Any
) -> SnapshotMoments:
    colour, shutter = (part.double() for part in camera.tile())
    return snapshot_moments(prior, psf.double(), colour, shutter, window, exposure=camera.exposure, **how)


def _recorded(
    camera: SpectralDepthCamera, prior: GaussianPrior, window: int, contamination: float, **how: Any
) -> tuple[Tensor, Tensor | None]:
    """(D, n, n) moments of scene and noise, and the scene's moments with the snapshot if asked for."""
    moments = _moments(camera, prior, window, camera.psf(), contamination=contamination, **how)
    colour, shutters = (part.double() for part in camera.tile())
    noise, mean = camera.noise, prior.mean[:, 0, 0].to(colour)
    passed = shutters.sum(1) / (camera.slots if camera.exposure == "equal" else 1)
    level = torch.einsum("clij,l,rij->rcij", colour, mean, passed).mean((2, 3)).flatten()
    variance = noise.read**2 + NOISE_FLOOR + noise.shot * level.repeat_interleave(window**2)
    return moments.covariance + torch.diag(variance), moments.cross


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
    farther, nearer = (_moments(camera, prior, window, _moved_psf(camera, shift)).covariance for shift in shifts)
    slope = (1 - contamination) * (nearer - farther) / (shifts[1] - shifts[0])
    return fisher_information(covariance, slope)


def _moved_psf(camera: SpectralDepthCamera, shift: float) -> Tensor:
    """(K, D, L, h, w) of every plane moved by inverse metres."""
    planes, psf = camera.planes, camera.point_spread
    near, far = 1 / planes.near + shift, 1 / planes.far + shift
    moved = DepthPlanes(1 / near, 1 / far if far > 0 else inf, planes.count)
    waves = camera.bench.waves(camera.wavelengths, moved).to(psf.waves.device)
    return PointSpread(psf.heights, waves, psf.per_metre, psf.propagator, psf.energy, psf.oversampling)()


def fisher_information(covariance: Tensor, slope: Tensor) -> Tensor:
    """(…,) information of Gaussians without a mean about what they move with: ``½ tr(C⁻¹ C′ C⁻¹ C′)``.

    Args:
        covariance: (…, n, n) C.
        slope: (…, n, n) C′, its derivative.
    """
    relative = torch.linalg.solve(covariance, slope)
    return 0.5 * (relative * relative.mT).sum((-2, -1))


def kullback_leibler(covariance: Tensor) -> Tensor:
    """(D, D) distance of plane d from plane e in nats: ``½ (tr(C_e⁻¹ C_d) - n + log det C_e - log det C_d)``.

    Args:
        covariance: (D, n, n).
    """
    factors = torch.linalg.cholesky(covariance)
    levels = _log_det(factors)
    traces = torch.stack([torch.cholesky_solve(covariance, f).diagonal(dim1=-2, dim2=-1).sum(-1) for f in factors], 1)
    return 0.5 * (traces - covariance.shape[-1] + levels[None] - levels[:, None])


def bhattacharyya(covariance: Tensor) -> Tensor:
    """(D, D) Bhattacharyya distances: ``½ log det ½(C_d + C_e) - ¼ log det C_d - ¼ log det C_e``.

    The chance to confuse two planes is at most ``½ exp(-distance)``.

    Args:
        covariance: (D, n, n).
    """
    levels = _log_det(torch.linalg.cholesky(covariance))
    rows, columns = torch.triu_indices(len(covariance), len(covariance), 1, device=covariance.device)
    between = _log_det(torch.linalg.cholesky((covariance[rows] + covariance[columns]) / 2))
    distances = 0.5 * between - 0.25 * (levels[rows] + levels[columns])
    square = covariance.new_zeros(len(covariance), len(covariance))
    return square.index_put((rows, columns), distances).index_put((columns, rows), distances)


def confusion(covariance: Tensor) -> Tensor:
    """Mean over planes of ``Σ_e ½ |d - e| exp(-distance)``: a bound on the mean error in bins of the most likely plane.

    Args:
        covariance: (D, n, n) of planes in order.
    """
    planes = torch.arange(len(covariance), device=covariance.device, dtype=covariance.dtype)
    bins = (planes[:, None] - planes).abs()
    return (0.5 * bins * torch.exp(-bhattacharyya(covariance))).sum(1).mean()


def drawn_error(covariance: Tensor, draws: int = 500, seed: int = 0) -> float:
    """Mean error in bins of the most likely plane of windows that are drawn from the prior, all planes as often.

    Args:
        covariance: (D, n, n) of planes in order.
        draws: windows at every plane.
        seed: of the windows.
    """
    source = torch.Generator(covariance.device).manual_seed(seed)
    white = torch.randn(covariance.shape[-1], draws, generator=source, dtype=covariance.dtype, device=covariance.device)
    factors, total = torch.linalg.cholesky(covariance.detach()), 0.0
    levels = _log_det(factors)
    for plane, factor in enumerate(factors):
        misfit = torch.linalg.solve_triangular(factors, factor @ white, upper=False).square().sum(-2)
        total += float(((misfit + levels[:, None]).argmin(0) - plane).abs().double().mean())
    return total / len(factors)


def _log_det(factors: Tensor) -> Tensor:
    """(…,) log determinant of matrices with Cholesky factors (…, n, n)."""
    return 2 * factors.diagonal(dim1=-2, dim2=-1).log().sum(-1)


@dataclass(frozen=True)
class MaskDesign:
    """Masks of least confusion, and the confusion after every step.

    Args:
        camera: that shows them.
        confusion: bins.
    """

    camera: SpectralDepthCamera
    confusion: tuple[float, ...]


def design_masks(
    camera: SpectralDepthCamera,
    prior: GaussianPrior,
    *,
    window: int = 8,
    steps: int = 60,
    rate: float = 0.005,
    code_rate: float = 0.05,
    progress: Callable[[float], None] | None = None,
) -> MaskDesign:
    """Move what is learnable of a camera until depths are least confused; it is left with the best of all steps.

    Args:
        camera: with a learnable mask, shutter or filters; changed in place.
        prior: of scenes, its blocks at least ``needed_block``.
        window: m, pixels.
        steps: of Adam.
        rate: of Adam for heights, in units of the larger of a micrometre and the highest.
        code_rate: of Adam for shutter and filters, whose latent values start half a unit from where they switch.
        progress: called with the share that is done.

    Raises:
        SettingError: a camera in which nothing is learnable, or no steps.
    """
    check_range("steps", steps, 1)
    rates = ((camera.point_spread, rate), (camera.shutter, code_rate), (camera.filters, code_rate))
    groups: list[dict[str, Any]] = [
        {"params": [p for p in part.parameters() if p.requires_grad], "lr": lr} for part, lr in rates
    ]
    best = Best([p for group in groups for p in group["params"]])
    if not best.parameters:
        raise SettingError("design", "no learnable parts", "something learnable", "give the camera learnable=")
    optimiser, history = torch.optim.Adam(groups), list[float]()
    for step in range(steps):
        value = confusion(window_covariance(camera, prior, window))
        history.append(float(value.detach()))
        best.meet(history[-1])
        optimiser.zero_grad()
        value.backward()
        optimiser.step()
        if progress is not None:
            progress((step + 1) / steps)
    best.restore()
    return MaskDesign(camera, tuple(history))
