"""How well a snapshot tells depths apart, without any decoder: distances between depths, and masks that keep them.

Under the patch prior the snapshot of a window is Gaussian at every depth, with zero mean and the second moments of
``snapshot_moments`` (its brightness is part of them, so that brightness is no cue). All figures are differentiable in
the moments, and so in masks, shutter and filters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.errors import SettingError
from tmca.priors import GaussianPrior
from tmca.priors.posterior import NOISE_FLOOR
from tmca.priors.spectral_depth import CONTAMINATION, SnapshotMoments, snapshot_moments

Progress = Callable[[int, int, float], None]
"""Called with (steps done, steps in all, confusion)."""


@dataclass(frozen=True)
class Foretold:
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
    return _moments(camera, prior, window, contamination).covariance + torch.diag(_noise(camera, prior, window))


def foretell(
    camera: SpectralDepthCamera, prior: GaussianPrior, window: int, contamination: float = CONTAMINATION
) -> Foretold:
    """How windows of a camera look at every plane, and how well their spectrum can be told.

    Arguments as of ``window_covariance``.

    Raises:
        ShapeError, SettingError: see ``snapshot_moments``.
    """
    found = _moments(camera, prior, window, contamination, cross=True)
    assert found.cross is not None
    covariance = found.covariance + torch.diag(_noise(camera, prior, window))
    told = torch.linalg.solve_triangular(torch.linalg.cholesky(covariance), found.cross.mT, upper=False)
    rows, columns = (side - 1 for side in prior.block[1:])
    mean = prior.mean[:, 0, 0].to(covariance)
    power = prior.displaced[..., rows, columns].diagonal().to(mean) + mean.square()  # brightness as in the moments
    return Foretold(covariance, power.mean() - told.square().sum((-2, -1)) / found.cross.shape[1])


def _moments(
    camera: SpectralDepthCamera, prior: GaussianPrior, window: int, contamination: float, cross: bool = False
) -> SnapshotMoments:
    colour, shutter = (part.double() for part in camera.tile())
    psf = camera.psf().double()
    return snapshot_moments(
        prior, psf, colour, shutter, window, exposure=camera.exposure, contamination=contamination, cross=cross
    )


def _noise(camera: SpectralDepthCamera, prior: GaussianPrior, window: int) -> Tensor:
    """(n,) variance of the noise of a window's samples."""
    colour, shutter = (part.double() for part in camera.tile())
    noise, mean = camera.noise, prior.mean[:, 0, 0].to(colour)
    passed = shutter.sum(0) / (camera.slots if camera.exposure == "equal" else 1)
    level = torch.einsum("clij,l,ij->cij", colour, mean, passed).mean((1, 2))
    return noise.read**2 + NOISE_FLOOR + noise.shot * level.repeat_interleave(window**2)


def kullback_leibler(covariance: Tensor) -> Tensor:
    """(D, D) distance of plane d from plane e in nats: ``½ (tr(C_e⁻¹ C_d) - n + log det C_e - log det C_d)``.

    Args:
        covariance: (D, n, n).
    """
    factors = torch.linalg.cholesky(covariance)
    levels = 2 * factors.diagonal(dim1=-2, dim2=-1).log().sum(-1)
    traces = torch.stack([torch.cholesky_solve(covariance, f).diagonal(dim1=-2, dim2=-1).sum(-1) for f in factors], 1)
    return 0.5 * (traces - covariance.shape[-1] + levels[None] - levels[:, None])


def bhattacharyya(covariance: Tensor) -> Tensor:
    """(D, D) Bhattacharyya distances: ``½ log det ½(C_d + C_e) - ¼ log det C_d - ¼ log det C_e``.

    The chance to confuse two planes is at most ``½ exp(-distance)``.

    Args:
        covariance: (D, n, n).
    """
    own = _log_det(covariance)
    rows, columns = torch.triu_indices(len(covariance), len(covariance), 1, device=covariance.device)
    between = _log_det((covariance[rows] + covariance[columns]) / 2)
    distances = 0.5 * between - 0.25 * (own[rows] + own[columns])
    found = covariance.new_zeros(len(covariance), len(covariance))
    return found.index_put((rows, columns), distances).index_put((columns, rows), distances)


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
    own = torch.randn(covariance.shape[-1], draws, generator=source, dtype=covariance.dtype, device=covariance.device)
    factors, total = torch.linalg.cholesky(covariance.detach()), 0.0
    level = factors.diagonal(dim1=-2, dim2=-1).log().sum(-1)
    for plane, factor in enumerate(factors):
        misfit = torch.linalg.solve_triangular(factors, factor @ own, upper=False).square().sum(-2) / 2
        total += float(((misfit + level[:, None]).argmin(0) - plane).abs().double().mean())
    return total / len(factors)


@dataclass(frozen=True)
class MaskDesign:
    """Masks that were searched.

    Args:
        camera: that shows them.
        confusion: after every step.
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
    progress: Progress | None = None,
) -> MaskDesign:
    """Move what is learnable of a camera until depths are least confused; the best of all steps is kept.

    Args:
        camera: with a learnable mask, shutter or filters; changed in place.
        prior: of scenes, its blocks at least ``needed_block``.
        window: m, pixels.
        steps: of Adam.
        rate: of Adam for heights, in units of the larger of a micrometre and the highest.
        code_rate: of Adam for shutter and filters, whose latent values start half a unit from where they switch.
        progress: told after each step.

    Raises:
        SettingError: a camera in which nothing is learnable, or no steps.
    """
    groups = _rated(camera, rate, code_rate)
    parameters = [p for group in groups for p in group["params"]]
    if not parameters or steps < 1:
        found = f"{len(parameters)} learnable parts, {steps} steps"
        raise SettingError("design", found, "something learnable, and a step or more", "give the camera learnable=")
    optimiser, found_so_far = torch.optim.Adam(groups), list[float]()
    best = [p.detach().clone() for p in parameters]
    for step in range(steps):
        value = confusion(window_covariance(camera, prior, window))
        if not found_so_far or float(value.detach()) < min(found_so_far):
            best = [p.detach().clone() for p in parameters]
        found_so_far.append(float(value.detach()))
        optimiser.zero_grad()
        value.backward()
        optimiser.step()
        if progress is not None:
            progress(step + 1, steps, found_so_far[-1])
    with torch.no_grad():
        for parameter, kept in zip(parameters, best, strict=True):
            parameter.copy_(kept)
    return MaskDesign(camera, tuple(found_so_far))


def _rated(camera: SpectralDepthCamera, rate: float, code_rate: float) -> list[dict[str, Any]]:
    """What is learnable, with its rates."""
    parts = ((camera.spread, rate), (camera.shutter, code_rate), (camera.filters, code_rate))
    return [{"params": [p for p in part.parameters() if p.requires_grad], "lr": own} for part, own in parts]


def _log_det(matrices: Tensor) -> Tensor:
    return 2 * torch.linalg.cholesky(matrices).diagonal(dim1=-2, dim2=-1).log().sum(-1)
