"""Plug-and-play ADMM: any denoiser as the prior of the scene (Venkatakrishnan, Bouman and Wohlberg 2013)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from tmca.decoders.data_step import (
    Checked,
    DataStep,
    Operator,
    Result,
    channel_operator,
    check_settings,
    exposure_gain,
    noise_level,
)
from tmca.decoders.decoder import Decoder, Progress, Raw
from tmca.decoders.denoisers import Denoiser, nl_means_denoiser, subspace_denoiser, tv_denoiser
from tmca.errors import SettingError, ShapeError


def sigma_schedule(sigma: float | tuple[float, float], iterations: int) -> list[float]:
    """The denoiser's sigma at every iteration.

    Args:
        sigma: constant, or (first, last): in equal ratios over the first half of the iterations, then held.
        iterations: length of the list.
    """
    first, last = (sigma, sigma) if isinstance(sigma, (int, float)) else sigma
    if not (0 < last <= first and math.isfinite(first)):
        raise SettingError("sigma", f"{sigma}", "a finite number > 0, or (first, last) with first ≥ last > 0")
    falling = max(iterations // 2, 1)
    return [first * (last / first) ** min(step / falling, 1.0) for step in range(iterations)]


@torch.no_grad()
def pnp_admm(
    operator: Operator,
    snapshot: Tensor,
    denoise: Denoiser,
    *,
    noise_sigma: float = 0.01,
    sigma: float | tuple[float, float] = (0.3, 0.05),
    max_iterations: int = 100,
    tolerance: float = 1e-3,
    progress: Checked | None = None,
    initial: Tensor | None = None,
) -> Result:
    """Reconstruction with a denoiser in the place of the prior's proximal operator.

    Alternates the data step with penalty ρ = (noise_sigma / sigma)² and ``denoise(·, sigma)``. Where the
    denoiser is the maximum a posteriori estimate under a log-concave prior, the fixed point is that estimate
    of the scene, whatever sigma is held last. Other denoisers carry no such promise; a falling sigma
    helps them (Chan, Wang and Elgendy 2017).

    Args:
        operator: the camera.
        snapshot: (B, 1, H, W').
        denoise: `Denoiser`.
        noise_sigma: standard deviation of the snapshot's noise, > 0.
        sigma: standard deviation that the denoiser is told, constant or (first, last), see `sigma_schedule`.
        max_iterations: most iterations done.
        tolerance: the iteration stops, once sigma is held, when the two copies of the scene differ by less
            than this share of its norm (primal) and the denoised one changed by less than this share of the
            multiplier's norm (dual).
        progress: called after every iteration, see `Checked`.
        initial: (B, L, H, W) to start from, by default the pseudo-inverse of the snapshot.

    Raises:
        ShapeError: a snapshot, initial estimate or denoised cube of the wrong shape.
        SettingError: an impossible noise level, schedule, tolerance or number of iterations.
    """
    check_settings(max_iterations, tolerance)
    _check_noise(noise_sigma)
    sigmas = sigma_schedule(sigma, max_iterations)
    data = DataStep(operator, snapshot)
    clean = data.start(initial)
    dual, previous = torch.zeros_like(clean), sigmas[0]
    primals: list[float] = []
    changes: list[float] = []
    converged = False
    for iteration, now in enumerate(sigmas, 1):
        dual *= (now / previous) ** 2  # the multiplier is ρ · dual, and ρ goes with 1/sigma²
        copy = data(clean - dual, (noise_sigma / now) ** 2)
        before, clean = clean, _denoised(denoise, copy + dual, now)
        dual, previous = dual + copy - clean, now
        size = _norm(clean)
        primals.append(_norm(copy - clean) / max(size, 1e-30))
        changes.append(_norm(clean - before) / max(_norm(dual), tolerance * size, 1e-30))
        if progress is not None:
            progress(iteration, primals[-1], changes[-1])
        converged = now == sigmas[-1] and max(primals[-1], changes[-1]) <= tolerance
        if converged:
            break
    return Result(clean, tuple(range(1, len(primals) + 1)), (), tuple(primals), tuple(changes), len(primals), converged)


def _check_noise(noise_sigma: float) -> None:
    if not (noise_sigma > 0 and math.isfinite(noise_sigma)):
        raise SettingError(
            "noise_sigma",
            f"{noise_sigma}",
            "a finite number > 0",
            "for a noise-free snapshot give a small one, 1e-3",
        )


def _denoised(denoise: Denoiser, cube: Tensor, sigma: float) -> Tensor:
    clean = denoise(cube, sigma)
    if clean.shape != cube.shape:
        raise ShapeError(
            "denoise", f"a cube of shape {tuple(clean.shape)}", f"{tuple(cube.shape)}, the shape it was given"
        )
    return clean


def _norm(cube: Tensor) -> float:
    return float(torch.linalg.vector_norm(cube))


@dataclass
class PlugAndPlay(Decoder):
    """Plug-and-play ADMM with total variation over all channels as its denoiser.

    Args:
        iterations: at most.
    """

    name, label, cameras = "pnp-tv", "PnP TV", frozenset({"spectral", "light-field"})
    least_noise: ClassVar[float] = 1e-3
    """That the data step assumes, where 1 is one channel of a white scene."""
    iterations: int = 100

    def denoiser(self) -> Denoiser:
        return tv_denoiser()

    def reconstruct(self, prepared: Any, values: Tensor, progress: Progress | None) -> Raw:
        result = pnp_admm(
            channel_operator(prepared), values, self.denoiser(),
            noise_sigma=max(noise_level(prepared, values), self.least_noise * exposure_gain(prepared)),
            max_iterations=self.iterations,
            progress=None if progress is None else lambda iteration, *_: progress(iteration / self.iterations),
        )  # fmt: skip
        return Raw(result.estimate, notes={"iterations": result.iterations, "converged": result.converged})


@dataclass
class NonLocalMeans(PlugAndPlay):
    """Plug-and-play ADMM with non-local means on every channel as its denoiser.

    Args:
        iterations: at most.
    """

    name, label = "pnp-nl-means", "PnP NL-means"

    def denoiser(self) -> Denoiser:
        return nl_means_denoiser()


@dataclass
class Subspace(PlugAndPlay):
    """Plug-and-play ADMM with total variation in the scene's own subspace of few dimensions as its denoiser.

    Args:
        iterations: at most.
        rank: dimensions of the subspace.
    """

    name, label, least_noise = "pnp-subspace", "PnP subspace", 1e-2
    rank: int = 6

    def denoiser(self) -> Denoiser:
        return subspace_denoiser(tv_denoiser(5.0, joint=False, max_iterations=20), self.rank)
