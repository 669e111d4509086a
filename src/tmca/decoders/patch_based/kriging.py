"""Samples that are scattered in space and time, interpolated by the best linear estimate under a stationary prior.

Ordinary kriging, or Gaussian-process regression with an unknown level (Rasmussen and Williams, Gaussian Processes for
Machine Learning, 2006, equations 2.25, 2.26, 2.42 and 5.12), from the samples nearest to every place. A share of the
scene's variance changes, the rest stays: with the Matérn function M(d) = (1 + √3 d) exp(-√3 d),

    k = (1 - changing) · M(|Δplace|/length) + changing · M(√(|Δplace|²/length² + Δtime²/lifetime²)).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from tmca.errors import SettingError

_CHUNK = 4096
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

    Raises:
        SettingError: an impossible number.
    """

    length: float
    lifetime: float
    changing: float
    noise: float

    def __post_init__(self) -> None:
        for name in ("length", "lifetime", "noise"):
            value = getattr(self, name)
            if not (value > 0 and math.isfinite(value)):
                raise SettingError(name, f"{value:g}", "a finite number above 0")
        if not 0 <= self.changing <= 1:
            raise SettingError("changing", f"{self.changing:g}", "a share from 0 to 1")

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

    Args:
        points: (N, 3) row, column, time, float64; one sample at most at a place.
        values: (N,) float64.

    Raises:
        SettingError: other shapes, or fewer than three samples.
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
        found = cKDTree(self.points[:, :2].numpy()).query(places.numpy(), k=count)[1]
        return torch.from_numpy(found).reshape(len(places), count)


@dataclass(frozen=True)
class Kriged:
    """The scene at all times of some places, variances in units of the scene's own.

    Args:
        mean: (T, P).
        variance: (T, P) of the error.
        noise_gain: (T, P) share of the variance of a sample's noise that is in the estimate: squared weights, summed.
        residual: (P,) sample of the place less what its neighbours say of it; NaN where nothing was measured.
        foretold: (P,) variance of the residual.
    """

    mean: Tensor
    variance: Tensor
    noise_gain: Tensor
    residual: Tensor
    foretold: Tensor


@torch.no_grad()
def krige(samples: Samples, places: Tensor, times: Tensor, covariance: Covariance, neighbours: int = 36) -> Kriged:
    """The scene at some places and times.

    Args:
        samples: that were measured.
        places: (P, 2) row, column, float64.
        times: (T,) float64.
        covariance: of the scene.
        neighbours: samples nearest in space, that a place is estimated from.
    """
    parts = []
    for where, near in zip(places.split(_CHUNK), samples.nearest(places, neighbours).split(_CHUNK), strict=True):
        points = samples.points[near]
        wanted = torch.cat([where[:, None].expand(-1, len(times), -1), times.expand(len(where), -1)[..., None]], -1)
        *estimates, residual, foretold = _conditional(points, samples.values[near], wanted, covariance)
        own = (points[:, 0, :2] == where).all(-1)
        parts.append((*(one.T for one in estimates), residual.where(own, torch.nan), foretold.where(own, torch.nan)))
    return Kriged(*(torch.cat(part, -1) for part in zip(*parts, strict=True)))


def _conditional(points: Tensor, values: Tensor, wanted: Tensor, covariance: Covariance) -> tuple[Tensor, ...]:
    """Estimates at points (B, T, 3) given values (B, n) at points (B, n, 3), and the first value left out.

    Returns:
        Mean, variance and squared weights, (B, T); residual and its variance, (B,).
    """
    gram = covariance.between(points, points)
    gram.diagonal(dim1=-2, dim2=-1).add_(covariance.noise)
    cross = covariance.between(points, wanted)
    first = torch.zeros_like(values)
    first[:, 0] = 1
    known = torch.cat([torch.stack([torch.ones_like(values), values, first], -1), cross], -1)
    solved = torch.cholesky_solve(known, torch.linalg.cholesky(gram))
    ones, data, own, weights = solved.split([1, 1, 1, wanted.shape[-2]], -1)
    mass = ones.sum(-2)
    level = data.sum(-2) / mass
    rest = data - level[..., None] * ones
    mean = level + (cross * rest).sum(-2)
    short = 1 - weights.sum(-2)
    variance = 1 - (cross * weights).sum(-2) + short**2 / mass
    squared = (weights + ones * (short / mass)[..., None, :]).square().sum(-2)
    precision = own[:, 0, 0] - ones[:, 0, 0] ** 2 / mass[:, 0]
    return mean, variance, squared, rest[:, 0, 0] / precision, 1 / precision


@torch.no_grad()
def foretelling_covariance(
    samples: Samples,
    span: float,
    *,
    lifetime: float | None = None,
    changing: float | None = None,
    least_noise: float = 0.0,
    neighbours: int = 36,
    shown: int = 500,
) -> Covariance:
    """The covariance under which single samples are foretold best by their neighbours: least squares, one left out.

    Args:
        samples: that were measured.
        span: of the times, in their unit; lifetimes that are tried are shares of it.
        lifetime, changing: of the `Covariance`, where they are given.
        least_noise: variance of a sample's noise that is known, in units of the scene's variance.
        neighbours: as in `krige`.
        shown: samples that are left out in turn, drawn with a fixed seed.

    Returns:
        The best of a grid, found number by number from its middle until none changes.
    """
    drawn = torch.randperm(len(samples.values), generator=torch.Generator().manual_seed(0))[:shown]
    near = samples.nearest(samples.points[drawn, :2], neighbours)
    points, values = samples.points[near], samples.values[near]

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
                if (found := error(tried)) < least:
                    least, best = found, tried
    return best
