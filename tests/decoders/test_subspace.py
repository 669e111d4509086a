"""The denoiser in a cube's own spectral subspace."""

import pytest
import torch

from tmca.decoders.iterative.subspace import subspace, subspace_denoiser
from tmca.errors import SettingError


def low_rank(rank, bands=9, size=(14, 15), seed=0):
    generator = torch.Generator().manual_seed(seed)
    spectra = torch.rand(bands, rank, generator=generator)
    return torch.einsum("lr,rhw->lhw", spectra, torch.rand(rank, *size, generator=generator))


def test_the_basis_is_that_of_the_singular_vectors():
    cube = low_rank(3) + 0.01 * torch.rand(9, 14, 15)
    basis = subspace(cube, 3)
    torch.testing.assert_close(basis.T @ basis, torch.eye(3))
    singular = torch.linalg.svd(cube.flatten(1), full_matrices=False)[0][:, :3]
    torch.testing.assert_close(basis @ basis.T, singular @ singular.T, atol=1e-4, rtol=0)


@pytest.mark.parametrize("rank", [3, 5, 20])
def test_a_cube_of_few_spectra_passes_unchanged(rank):
    cubes = torch.stack([low_rank(3), low_rank(2, seed=1)])
    nothing = subspace_denoiser(lambda image, sigma: image, rank)
    torch.testing.assert_close(nothing(cubes, 0.1), cubes, atol=1e-4, rtol=0)


def test_noise_outside_the_subspace_is_gone():
    cube, bands, rank = low_rank(2, 20, (60, 61)), 20, 2
    noisy = cube + 0.05 * torch.randn(cube.shape, generator=torch.Generator().manual_seed(3))
    found = subspace_denoiser(lambda image, sigma: image, rank)(noisy[None], 0.05)[0]
    left = float((found - cube).square().mean() / (noisy - cube).square().mean())
    assert left == pytest.approx(rank / bands, rel=0.15)


def test_components_are_denoised_one_by_one_at_the_same_sigma():
    seen = []
    subspace_denoiser(lambda image, sigma: seen.append((image.shape, sigma)) or image, 4)(low_rank(4)[None], 0.2)
    assert seen == [((14, 15), 0.2)] * 4


def test_no_dimension_is_refused():
    with pytest.raises(SettingError, match="rank"):
        subspace_denoiser(lambda image, sigma: image, 0)
