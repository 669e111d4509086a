"""Samples that are scattered in space and time, interpolated by the best linear estimate under a stationary prior.

Ordinary kriging, or Gaussian-process regression with an unknown level (Rasmussen and Williams, Gaussian Processes for
Machine Learning, 2006, equations 2.25, 2.26, 2.42 and 5.12), from the samples nearest to every place. A share of the
scene's variance changes, the rest stays: with the Matérn function M(d) = (1 + √3 d) exp(-√3 d),

    k = (1 - changing) · M(|Δplace|/length) + changing · M(√(|Δplace|²/length² + Δtime²/lifetime²)).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.decoders.decoder import Progress, Raw
from tmca.decoders.space_time import FrameDecoder, FrameOperator
from tmca.errors import SettingError, check_range

_CHUNK = 4096
_POOLED = 5.0  # pixels, standard deviation of the Gaussian over which errors are pooled
_STILL = 1e-12  # variance of samples that are all alike
_EVERYWHERE = 1e-6  # weight of the mean error, which counts where no sample is near
_GRID = {
    "length": (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0),
    "lifetime": (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0),
    "changing": (1e-3, 0.01, 0.03, 0.1, 0.3, 0.6, 0.9),
    "noise": (1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0),
}


@dataclass(frozen=True)
class Covariance:
    """Of a scene that varies in space and time, in units of its variance.

    Args:
        length: over which it changes in space, pixels.
        lifetime: over which a part of it changes in time, in the unit of the samples' times.
        changing: share of the variance that changes in time, 0 to 1.
        noise: variance of a sample's noise.
    """

    length: float
    lifetime: float
    changing: float
    noise: float

    def __post_init__(self) -> None:
        for name in ("length", "lifetime", "noise"):
            check_range(name, getattr(self, name), above=0)
        check_range("changing", self.changing, 0, 1)

    def between(self, one: Tensor, other: Tensor) -> Tensor:
        """(…, N, M) of points (…, N, 3) and (…, M, 3): row, column, time."""
        away = torch.cdist(one[..., :2], other[..., :2], compute_mode="donot_use_mm_for_euclid_dist") / self.length
        later = (one[..., None, 2] - other[..., None, :, 2]) / self.lifetime
        return (1 - self.changing) * _matern(away) + self.changing * _matern(torch.hypot(away, later))


def _matern(distance: Tensor) -> Tensor:
    far = math.sqrt(3) * distance
    return (1 + far) * torch.exp(-far)


@dataclass(frozen=True)
class Samples:
    """Values that were measured at single places and times.

    ``points`` (N, 3) are row, column and time, float64, one sample at most at a place; ``values`` (N,) float64. There
    are three at least.
    """

    points: Tensor
    values: Tensor

    def __post_init__(self) -> None:
        if self.points.shape != (len(self.values), 3) or len(self.values) < 3:
            found = f"points {tuple(self.points.shape)}, values {tuple(self.values.shape)}"
            raise SettingError("samples", found, "points (N, 3) and values (N,), three or more")

    def nearest(self, places: Tensor, count: int) -> Tensor:
        """(P, count) which samples are nearest in space to places (P, 2), the nearest first."""
        from scipy.spatial import cKDTree

        count = min(count, len(self.values))
        nearest = cKDTree(self.points[:, :2].numpy()).query(places.numpy(), k=count)[1]
        return torch.from_numpy(nearest).reshape(len(places), count)


@dataclass(frozen=True)
class Kriged:
    """The scene at all times of some places, variances in units of the scene's own.

    Args:
        mean: (T, P).
        variance: (T, P) of the error.
        noise_gain: (T, P) share of the variance of a sample's noise that is in the estimate: squared weights, summed.
        residual: (P,) sample of the place less what its neighbours say of it; NaN where nothing was measured.
        predicted: (P,) variance of the residual.
    """

    mean: Tensor
    variance: Tensor
    noise_gain: Tensor
    residual: Tensor
    predicted: Tensor


@torch.no_grad()
def krige(samples: Samples, places: Tensor, times: Tensor, covariance: Covariance, neighbours: int = 36) -> Kriged:
    """The scene at places (P, 2), row and column, and times (T,), each place from its nearest samples in space."""
    nearest, parts = samples.nearest(places, neighbours), []
    for where, near in zip(places.split(_CHUNK), nearest.split(_CHUNK), strict=True):
        points = samples.points[near]
        wanted = torch.cat([where[:, None].expand(-1, len(times), -1), times.expand(len(where), -1)[..., None]], -1)
        *estimates, residual, predicted = _conditional(points, samples.values[near], wanted, covariance)
        measured = (points[:, 0, :2] == where).all(-1)
        left_out = (one.where(measured, torch.nan) for one in (residual, predicted))
        parts.append((*(one.T for one in estimates), *left_out))
    return Kriged(*(torch.cat(part, -1) for part in zip(*parts, strict=True)))


def _conditional(points: Tensor, values: Tensor, wanted: Tensor, covariance: Covariance) -> tuple[Tensor, ...]:
    """Mean, variance and squared weights (B, T) at points (B, T, 3), given values (B, n) at points (B, n, 3); and the
    residual (B,) of the first value, left out, with its variance."""
    gram = covariance.between(points, points)
    gram.diagonal(dim1=-2, dim2=-1).add_(covariance.noise)
    cross = covariance.between(points, wanted)
    first = torch.zeros_like(values)
    first[:, 0] = 1
    right = torch.cat([torch.stack([torch.ones_like(values), values, first], -1), cross], -1)
    solved = torch.cholesky_solve(right, torch.linalg.cholesky(gram))
    ones, data, left_out, weights = solved.split([1, 1, 1, wanted.shape[-2]], -1)
    mass = ones.sum(-2)
    level = data.sum(-2) / mass
    rest = data - level[..., None] * ones
    mean = level + (cross * rest).sum(-2)
    short = 1 - weights.sum(-2)
    variance = 1 - (cross * weights).sum(-2) + short**2 / mass
    squared = (weights + ones * (short / mass)[..., None, :]).square().sum(-2)
    precision = left_out[:, 0, 0] - ones[:, 0, 0] ** 2 / mass[:, 0]
    return mean, variance, squared, rest[:, 0, 0] / precision, 1 / precision


@torch.no_grad()
def fitted_covariance(
    samples: Samples,
    span: float,
    *,
    lifetime: float | None = None,
    changing: float | None = None,
    least_noise: float = 0.0,
    neighbours: int = 36,
    shown: int = 500,
) -> Covariance:
    """The covariance under which single samples are predicted best by their neighbours: least squares, one left out.

    It is the best of a grid, number by number from its middle until none changes.

    Args:
        samples: that were measured.
        span: of the times, in their unit; lifetimes that are tried are shares of it.
        lifetime, changing: of the `Covariance`, where they are given.
        least_noise: least variance of a sample's noise, in units of the scene's variance.
        neighbours: as in `krige`.
        shown: samples that are left out in turn, drawn with a fixed seed.
    """
    drawn = torch.randperm(len(samples.values), generator=torch.Generator().manual_seed(0))[:shown]
    near = samples.nearest(samples.points[drawn, :2], neighbours)
    points, values = samples.points[near], samples.values[near]

    @cache  # from round to round most of what is tried is the same
    def error(covariance: Covariance) -> float:
        return float(_conditional(points, values, points[:, :1], covariance)[3].square().mean())

    grid = _GRID | {"lifetime": tuple(share * span for share in _GRID["lifetime"])}
    grid["noise"] = tuple(sorted({max(least_noise, choice) for choice in _GRID["noise"]}))
    grid |= {name: (given,) for name, given in (("lifetime", lifetime), ("changing", changing)) if given is not None}
    best = Covariance(**{name: choices[len(choices) // 2] for name, choices in grid.items()})
    least, before = error(best), None
    while before != best:
        before = best
        for name, choices in grid.items():
            for choice in choices:
                tried = replace(best, **{name: choice})
                if (squared := error(tried)) < least:
                    least, best = squared, tried
    return best


def shutter_samples(camera: Any, operator: FrameOperator, values: Tensor) -> Samples:
    """A sample per pixel of a snapshot (H, W) that is open: its place, the mean of its slots, its value over the light
    that it gets."""
    shutter, gain = camera.codes()[1].double(), _gain(operator)
    seen = gain > 0
    slots = torch.arange(len(shutter), dtype=torch.float64)[:, None, None]
    times = (shutter * slots).sum(0)[seen] / shutter.sum(0)[seen]
    points = torch.cat([seen.nonzero().double(), times[:, None]], 1)
    return Samples(points, values.double()[seen] / gain[seen])


def _gain(operator: FrameOperator) -> Tensor:
    """(H, W) what every sensor pixel gets of a scene of 1."""
    return operator.collapsed.code.double().sum(0)


def _scale(kriged: Kriged, size: Sequence[int]) -> Tensor:
    """(H, W) variance of the scene: squared residuals over what was predicted, pooled around every place."""
    from scipy.ndimage import gaussian_filter

    there = kriged.residual.isfinite()

    def pooled(values: Tensor) -> NDArray[np.float64]:
        filled = values.where(there, 0).reshape(size).numpy()
        return gaussian_filter(filled, _POOLED) + _EVERYWHERE * filled.mean()

    return torch.from_numpy(pooled(kriged.residual**2) / pooled(kriged.predicted))


@dataclass
class KrigingDecoder(FrameDecoder):
    """Frames of a scene that changes during the exposure, by the best linear estimate from the samples around a place.

    For shutters that open every pixel within one frame, one band, nothing displaced. The standard deviation's part of
    the scene is scaled to how well samples around a place are predicted; its part of noise is the sensor's.

    Args:
        frames: how many, of equal length, a divisor of the slots; all slots if None.
        lifetime: slots over which the scene changes; those that predict the samples best if None.
        changing: share of the scene's variance that changes during the exposure; likewise.
    """

    name, label = "kriging", "kriging"
    lifetime: float | None = None
    changing: float | None = None

    def setup(self, camera: Any, prior: None) -> tuple[FrameOperator, Any]:
        operator, camera = super().setup(deepcopy(camera).cpu(), prior)  # SciPy's trees know processors alone
        seen = (operator.collapsed.code > 0).sum(0)
        if camera.bands > 1 or camera.buckets > 1 or camera.dispersion.extent or bool((seen > 1).any()):
            expected = "a shutter that opens every pixel within one frame, one band, one bucket"
            raise SettingError("decoder", "'kriging'", expected, "take space-time-mixture or space-time-lmmse")
        return operator, camera

    def reconstruct(self, prepared: tuple[FrameOperator, Any], values: Tensor, progress: Progress | None) -> Raw:
        parts = [self._frames(*prepared, one[0]) for one in values.cpu()]
        notes = {f"scene_{name}": number for name, number in asdict(parts[-1][2]).items()}
        frames, deviations = (torch.stack(part).to(values.device) for part in list(zip(*parts, strict=True))[:2])
        return Raw(frames, deviations, notes=notes)

    def _frames(self, operator: FrameOperator, camera: Any, values: Tensor) -> tuple[Tensor, Tensor, Covariance]:
        """Frames (F, H, W), their standard deviation, and the covariance, lengths in pixels and slots."""
        samples, frames, size = shutter_samples(camera, operator, values), operator.scene_shape[0], camera.size
        light, power = _gain(operator), samples.values.var().clamp_min(_STILL)
        noise = camera.noise.variance(values).double() / light.square()  # in the scene's units, (H, W)
        noise = noise.where(light > 0, noise[light > 0].mean())
        least = float(noise.mean() / power)
        covariance = fitted_covariance(
            samples, camera.slots, lifetime=self.lifetime, changing=self.changing, least_noise=least
        )
        places = torch.cartesian_prod(*(torch.arange(n, dtype=torch.float64) for n in size))
        middles = (torch.arange(frames, dtype=torch.float64) + 0.5) * camera.slots / frames - 0.5
        kriged = krige(samples, places, middles, covariance)
        gain = kriged.noise_gain.reshape(frames, *size)
        scene = kriged.variance.reshape(frames, *size) - covariance.noise * gain
        variance = scene * _scale(kriged, size) + noise * gain
        return kriged.mean.reshape(frames, *size), variance.clamp_min(0).sqrt(), covariance
