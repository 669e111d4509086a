"""A denoiser of cubes in the subspace of their own spectra, for plug-and-play reconstruction.

Spectra of a scene lie close to a subspace of few dimensions. The cube is projected onto the leading eigenvectors of
its own second moments, and every component picture is denoised by itself: the other dimensions are taken for noise.
Source: Zhuang and Bioucas-Dias, IEEE JSTARS 11, 730 (2018), FastHyDe.
"""

from __future__ import annotations

import torch
from torch import Tensor

from tmca.decoders.iterative.pnp import Denoiser
from tmca.errors import SettingError


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
