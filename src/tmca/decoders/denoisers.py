"""Denoisers for plug-and-play: total variation, scikit-image's, any torch module, in a spectral subspace.

Spectra of a scene lie close to a subspace of few dimensions: `subspace_denoiser` projects a cube onto the leading
eigenvectors of its own second moments and denoises every component picture by itself; the other dimensions are taken
for noise (Zhuang and Bioucas-Dias, IEEE JSTARS 11, 730 (2018), FastHyDe).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from tmca.decoders.tv import tv_prox
from tmca.errors import SettingError

Denoiser = Callable[[Tensor, float], Tensor]
"""``denoise(cube (B, L, H, W), sigma) -> cube``, for white noise of standard deviation sigma."""
ImageDenoiser = Callable[[NDArray[np.floating], float], NDArray[np.floating]]
"""``denoise(image (H, W), sigma) -> image``."""


def tv_denoiser(strength: float = 20.0, *, joint: bool = True, max_iterations: int = 50) -> Denoiser:
    """Total variation: the maximum a posteriori estimate under the prior exp(−strength · TV).

    Plugged in, it leads to the solution of `tmca.decoders.admm_tv` with weight = strength · noise_sigma².
    """
    _check_positive("strength", strength)

    def denoise(cube: Tensor, sigma: float) -> Tensor:
        return tv_prox(cube, strength * sigma**2, joint, max_iterations=max_iterations)

    return denoise


def per_band(denoise_image: ImageDenoiser) -> Denoiser:
    """A denoiser of NumPy images applied to every band of every cube.

    Args:
        denoise_image: takes an (H, W) image and sigma, returns the image denoised.
    """

    def denoise(cube: Tensor, sigma: float) -> Tensor:
        bands = cube.detach().cpu().flatten(0, 1).numpy()
        clean = np.stack([denoise_image(band, sigma) for band in bands])
        return torch.from_numpy(clean).to(cube).view_as(cube)

    return denoise


def chambolle_denoiser(strength: float = 1.0, *, max_iterations: int = 100) -> Denoiser:
    """scikit-image's ``denoise_tv_chambolle`` on every band, with weight = strength · sigma."""
    from skimage.restoration import denoise_tv_chambolle

    _check_positive("strength", strength)
    return per_band(
        lambda band, sigma: denoise_tv_chambolle(band, weight=strength * sigma, max_num_iter=max_iterations)
    )


def nl_means_denoiser(strength: float = 0.8, *, patch_size: int = 5, patch_distance: int = 6) -> Denoiser:
    """scikit-image's ``denoise_nl_means`` on every band, with the cut-off h = strength · sigma."""
    from skimage.restoration import denoise_nl_means

    _check_positive("strength", strength)

    def denoise_image(band: NDArray[np.floating], sigma: float) -> NDArray[np.floating]:
        return denoise_nl_means(band, patch_size, patch_distance, h=strength * sigma, sigma=sigma, fast_mode=True)

    return per_band(denoise_image)


def module_denoiser(module: nn.Module, sigma_as: Literal["argument", "map", "none"] = "argument") -> Denoiser:
    """A torch module as a denoiser.

    Args:
        module: maps cubes to cubes; the caller puts it in evaluation mode and on the right device.
        sigma_as: "argument" calls ``module(cube, sigma)``; "map" appends a constant band of value sigma and
            calls ``module`` on (B, L + 1, H, W); "none" calls ``module(cube)``, for a network trained blind.
    """
    if sigma_as not in ("argument", "map", "none"):
        raise SettingError("sigma_as", f"{sigma_as!r}", "'argument', 'map' or 'none'")

    def denoise(cube: Tensor, sigma: float) -> Tensor:
        if sigma_as == "argument":
            return module(cube, sigma)
        if sigma_as == "map":
            return module(torch.cat((cube, torch.full_like(cube[:, :1], sigma)), 1))
        return module(cube)

    return denoise


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

    Raises:
        SettingError: a rank below 1.
    """
    if rank < 1:
        raise SettingError("rank", str(rank), "1 or more")

    def denoised(cubes: Tensor, sigma: float) -> Tensor:
        bases = torch.stack([subspace(cube, min(rank, cube.shape[0])) for cube in cubes])
        components = torch.einsum("blr,blhw->brhw", bases, cubes)
        return torch.einsum("blr,brhw->blhw", bases, denoise(components, sigma))

    return denoised


def _check_positive(where: str, value: float) -> None:
    if not (value > 0 and math.isfinite(value)):
        raise SettingError(where, f"{value}", "a finite number > 0")
