"""The denoiser in a cube's own spectral subspace."""

import pytest
import torch

from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders import decode
from tmca.decoders.pnp import subspace, subspace_denoiser
from tmca.sensor import Sensor


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
    nothing = subspace_denoiser(lambda components, sigma: components, rank)
    torch.testing.assert_close(nothing(cubes, 0.1), cubes, atol=1e-4, rtol=0)


def test_noise_outside_the_subspace_is_gone():
    cube, bands, rank = low_rank(2, 20, (60, 61)), 20, 2
    noisy = cube + 0.05 * torch.randn(cube.shape, generator=torch.Generator().manual_seed(3))
    found = subspace_denoiser(lambda components, sigma: components, rank)(noisy[None], 0.05)[0]
    left = float((found - cube).square().mean() / (noisy - cube).square().mean())
    assert left == pytest.approx(rank / bands, rel=0.15)


@pytest.mark.parametrize("exposure", ["equal", "per-slot"])
def test_a_scene_of_few_spectra_is_recovered_better_than_by_total_variation(exposure):
    spectra, places = torch.rand(12, 2, generator=torch.Generator().manual_seed(1)), torch.zeros(2, 40, 41)
    places[0, 8:30, 5:25], places[1, 15:35, 18:38] = 0.6, 0.4
    scene = torch.einsum("lr,rhw->lhw", spectra, places)[None]
    camera = SpectralCamera(bands=12, size=(40, 41), slots=4, exposure=exposure, sensor=Sensor(read_noise=0.02), seed=2)
    torch.manual_seed(0)
    snapshot = Snapshot(camera(scene), camera)
    error = {
        name: float((decode(snapshot, name).estimate - scene).norm()) for name in ("pnp-subspace", "admm-tv-joint")
    }
    assert error["pnp-subspace"] < 0.8 * error["admm-tv-joint"]
    assert error["pnp-subspace"] < 0.2 * float(scene.norm())
