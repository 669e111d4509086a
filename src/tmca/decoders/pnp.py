"""Plug-and-play ADMM: any denoiser as the prior of the scene (Venkatakrishnan, Bouman and Wohlberg 2013).

Denoisers: total variation, scikit-image's non-local means, any function of a cube and a noise level (such as a torch
module called with both), in a spectral subspace. Spectra of a scene lie close to a
subspace of few dimensions: `subspace_denoiser` projects a cube onto the leading eigenvectors of its own second moments
and denoises every component picture by itself; the other dimensions are taken for noise (Zhuang and Bioucas-Dias, IEEE
JSTARS 11, 730 (2018), FastHyDe).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.decoders.decoder import Decoder, Progress, Raw
from tmca.decoders.least_squares import (
    Checked,
    DataStep,
    Result,
    channel_operator,
    check_iteration,
    exposure_gain,
    noise_level,
    of_iterations,
)
from tmca.decoders.tv import norm, tv_prox
from tmca.errors import SettingError, check_range, check_shape
from tmca.operators.linear import LinearOperator

Denoiser = Callable[[Tensor, float], Tensor]
"""``denoise(cube (B, L, H, W), sigma) -> cube``, for white noise of standard deviation sigma."""
ImageDenoiser = Callable[[NDArray[np.floating], float], NDArray[np.floating]]
"""``denoise(image (H, W), sigma) -> image``."""


_RANK = 6
"""Dimensions of the subspace in which most scenes lie."""


def tv_denoiser(strength: float = 20.0, *, joint: bool = True, max_iterations: int = 50) -> Denoiser:
    """Total variation: the maximum a posteriori estimate under the prior exp(−strength · TV).

    Plugged in, it leads to the solution of `tmca.decoders.admm_tv` with weight = strength · noise_sigma².
    """
    check_range("strength", strength, above=0)

    def denoise(cube: Tensor, sigma: float) -> Tensor:
        return tv_prox(cube, strength * sigma**2, joint, max_iterations=max_iterations)

    return denoise


def per_band(denoise_image: ImageDenoiser) -> Denoiser:
    """A denoiser of NumPy images (H, W) applied to every band of every cube."""

    def denoise(cube: Tensor, sigma: float) -> Tensor:
        bands = cube.detach().cpu().flatten(0, 1).numpy()
        clean = np.stack([denoise_image(band, sigma) for band in bands])
        return torch.from_numpy(clean).to(cube).view_as(cube)

    return denoise


def nl_means_denoiser(strength: float = 0.8, *, patch_size: int = 5, patch_distance: int = 6) -> Denoiser:
    """scikit-image's ``denoise_nl_means`` on every band, with the cut-off h = strength · sigma."""
    from skimage.restoration import denoise_nl_means

    check_range("strength", strength, above=0)

    def denoise_image(band: NDArray[np.floating], sigma: float) -> NDArray[np.floating]:
        return denoise_nl_means(band, patch_size, patch_distance, h=strength * sigma, sigma=sigma, fast_mode=True)

    return per_band(denoise_image)


def subspace(cube: Tensor, rank: int) -> Tensor:
    """(L, rank) orthonormal basis of the spectra of a cube (L, H, W) with most energy."""
    spectra = cube.flatten(1).double()
    values, vectors = torch.linalg.eigh(spectra @ spectra.T)
    return vectors[:, values.argsort(descending=True)[:rank]].to(cube)


def subspace_denoiser(denoise: Denoiser, rank: int = 6) -> Denoiser:
    """Denoise the components of a cube in its own spectral subspace.

    Args:
        denoise: takes components (B, rank, H, W) for bands; white noise keeps its sigma in every one, for the basis is
            orthonormal.
        rank: dimensions of the subspace; all bands where there are fewer.
    """
    check_range("rank", rank, 1)

    def denoised(cubes: Tensor, sigma: float) -> Tensor:
        bases = torch.stack([subspace(cube, min(rank, cube.shape[0])) for cube in cubes])
        components = torch.einsum("blr,blhw->brhw", bases, cubes)
        return torch.einsum("blr,brhw->blhw", bases, denoise(components, sigma))

    return denoised


def sigma_schedule(sigma: float | tuple[float, float], iterations: int) -> list[float]:
    """The denoiser's sigma at every iteration: constant, or from first to last in equal ratios over half of them."""
    first, last = (sigma, sigma) if isinstance(sigma, (int, float)) else sigma
    if not (0 < last <= first and math.isfinite(first)):
        raise SettingError("sigma", f"{sigma}", "a finite number > 0, or (first, last) with first ≥ last > 0")
    falling = max(iterations // 2, 1)
    return [first * (last / first) ** min(step / falling, 1.0) for step in range(iterations)]


@torch.no_grad()
def pnp_admm(
    operator: LinearOperator,
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
        sigma: standard deviation that the denoiser works with, constant or (first, last), see `sigma_schedule`.
        max_iterations: most iterations done.
        tolerance: the iteration stops, once sigma is held, when the two copies of the scene differ by less
            than this share of its norm (primal) and the denoised one changed by less than this share of the
            multiplier's norm (dual).
        progress: called after every iteration, see `Checked`.
        initial: (B, L, H, W) to start from, see `DataStep.start`.

    Raises:
        ShapeError, SettingError: a tensor of another shape, or a number out of range.
    """
    check_iteration(max_iterations, tolerance)
    check_range("noise_sigma", noise_sigma, above=0)
    sigmas = sigma_schedule(sigma, max_iterations)
    data = DataStep(operator, snapshot)
    clean = data.start(initial, (noise_sigma / sigmas[0]) ** 2)
    dual, previous = torch.zeros_like(clean), sigmas[0]
    primals, changes, converged = list[float](), list[float](), False
    for iteration, now in enumerate(sigmas, 1):
        dual *= (now / previous) ** 2  # the multiplier is ρ · dual, and ρ goes with 1/sigma²
        copy = data(clean - dual, (noise_sigma / now) ** 2)
        before, clean = clean, denoise(copy + dual, now)
        check_shape("denoise", clean, before.shape, "a denoiser returns the shape that it is given")
        dual, previous = dual + copy - clean, now
        size = norm([clean])
        primals.append(norm([copy - clean]) / max(size, 1e-30))
        changes.append(norm([clean - before]) / max(norm([dual]), tolerance * size, 1e-30))
        if progress is not None:
            progress(iteration, primals[-1], changes[-1])
        converged = now == sigmas[-1] and max(primals[-1], changes[-1]) <= tolerance
        if converged:
            break
    return Result(clean, tuple(range(1, iteration + 1)), (), tuple(primals), tuple(changes), iteration, converged)


@dataclass
class PlugAndPlay(Decoder):
    """Plug-and-play ADMM with total variation over all channels as its denoiser.

    Args:
        iterations: largest number of them.
    """

    name, label, cameras = "pnp-tv", "PnP TV", frozenset({"spectral", "light-field"})
    least_noise: ClassVar[float] = 1e-3
    """That the data step assumes, where 1 is one channel of a white scene."""
    iterations: int = 100

    def __post_init__(self) -> None:
        check_range("iterations", self.iterations, 1, whole=True)

    def denoiser(self, channels: int) -> Denoiser:
        """Of cubes (B, channels, H, W)."""
        return tv_denoiser()

    def reconstruct(self, prepared: Any, values: Tensor, progress: Progress | None) -> Raw:
        least, operator = self.least_noise * exposure_gain(prepared), channel_operator(prepared)
        denoise = self.denoiser(operator.scene_shape[0])
        result = pnp_admm(
            operator, values, denoise, noise_sigma=max(noise_level(prepared, values), least),
            max_iterations=self.iterations, progress=of_iterations(progress, self.iterations),
        )  # fmt: skip
        return result.raw()


@dataclass
class NonLocalMeans(PlugAndPlay):
    """Plug-and-play ADMM with non-local means on every channel as its denoiser.

    Args:
        iterations: largest number of them.
    """

    name, label = "pnp-nl-means", "PnP NL-means"

    def denoiser(self, channels: int) -> Denoiser:
        return nl_means_denoiser()


@dataclass
class Subspace(PlugAndPlay):
    """Plug-and-play ADMM with total variation in the scene's own subspace of few dimensions as its denoiser.

    Args:
        iterations: largest number of them.
        rank: dimensions of the subspace; 6 if None, or all channels where there are fewer.
    """

    name, label, least_noise = "pnp-subspace", "PnP subspace", 1e-2
    rank: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rank is not None:
            check_range("rank", self.rank, 1, whole=True)

    def denoiser(self, channels: int) -> Denoiser:
        if self.rank is not None:
            check_range("rank", self.rank, 1, channels, whole=True, remedy="the camera has no more channels")
        rank = min(_RANK, channels) if self.rank is None else self.rank
        return subspace_denoiser(tv_denoiser(5.0, joint=False, max_iterations=20), rank)
