"""The Gaussian prior: its moments are those of the scenes, it survives the disk, and refuses what does not fit."""

import h5py
import numpy as np
import pytest
import torch
import xarray as xr

from tests.small_scenes import smooth_scene
from tmca.errors import DataError, OutputError, ShapeError, TmcaError
from tmca.priors import GaussianPrior, learn_prior, load_prior

CUBES = [smooth_scene(24, 31, seed=1), smooth_scene(20, 26, seed=2)]


@pytest.fixture(scope="module")
def prior():
    return GaussianPrior.learn(CUBES, (3, 7), wavelengths=(450e-9, 550e-9, 650e-9), sources=("a", "b"))


def test_autocovariance_is_the_mean_over_all_pairs_of_the_mirrored_torus():
    cube = smooth_scene(6, 5, seed=3)
    found = GaussianPrior.learn([cube], (3, 4), floor=0.0)
    torus = torch.cat([cube, cube.flip(-1)], -1)
    torus = torch.cat([torus, torus.flip(-2)], -2) - cube.mean((1, 2))[:, None, None]
    for dy, dx in ((0, 0), (2, 0), (0, 3), (2, 3)):
        moved = torus.roll((-dy, -dx), (1, 2))
        expected = torch.einsum("ayx,byx->ab", torus, moved) / torus[0].numel()
        torch.testing.assert_close(found.moments[:, :, dy, dx], (expected + expected.mT) / 2)


def test_covariance_depends_on_distance_and_is_positive(prior):
    full = prior.covariance.reshape(*prior.block, *prior.block)
    torch.testing.assert_close(full[0, 0, 1, 2, 2, 5], full[0, 2, 5, 2, 0, 1])
    torch.testing.assert_close(full[1, 2, 6, 0, 0, 0], prior.moments[1, 0, 2, 6])
    assert torch.linalg.eigvalsh(prior.covariance).min() > 0


def test_learning_from_samples_of_the_prior_finds_the_prior_again(prior):
    blocks = prior.sample(40000, seed=0)
    learned = GaussianPrior.learn(list(blocks), (3, 7), stationary=False, samples=40000, floor=0.0)
    scale = prior.covariance.diagonal().mean()
    assert (learned.covariance - prior.covariance).abs().max() < 0.05 * scale
    assert (learned.mean - prior.mean).abs().max() < 0.05 * scale.sqrt()


def test_sampled_and_stationary_moments_agree_on_a_large_scene():
    cube = smooth_scene(150, 160, seed=5)
    sampled = GaussianPrior.learn([cube], (2, 3), stationary=False, samples=20000)
    averaged = GaussianPrior.learn([cube], (2, 3))
    difference = (sampled.covariance - averaged.covariance).abs().max()
    assert difference < 0.1 * averaged.covariance.diagonal().mean()


@pytest.mark.parametrize("stationary", [True, False])
def test_prior_survives_the_disk(tmp_path, stationary):
    prior = GaussianPrior.learn(CUBES, (3, 7), stationary=stationary, samples=100, wavelengths=(4e-7, 5e-7, 6e-7))
    prior.save(tmp_path / "prior.nc")
    back = load_prior(tmp_path / "prior.nc")
    assert back.stationary is stationary
    assert back.wavelengths == prior.wavelengths
    assert torch.equal(back.covariance, prior.covariance)
    assert torch.equal(back.mean, prior.mean)


def test_prior_file_opens_in_plain_xarray(tmp_path, prior):
    prior.save(tmp_path / "prior.nc")
    with xr.open_dataset(tmp_path / "prior.nc", engine="h5netcdf") as data:
        np.testing.assert_allclose(data["wavelength"], [450e-9, 550e-9, 650e-9])
        assert data["wavelength"].attrs["units"] == "m"
        assert list(data.attrs["block"]) == [3, 3, 7]
        assert data.attrs["sources"].split("\n") == ["a", "b"]


def test_labelled_cubes_bring_their_wavelengths_and_checksums():
    lengths = [4.5e-7, 5.5e-7, 6.5e-7]
    cubes = [
        xr.DataArray(
            c.numpy(), dims=("wavelength", "y", "x"), coords={"wavelength": lengths}, attrs={"name": f"scene {i}"}
        )
        for i, c in enumerate(CUBES)
    ]
    prior = learn_prior(cubes, spread=2)
    assert prior.block == (3, 12, 24)
    assert prior.wavelengths == tuple(lengths)
    assert prior.sources[1].startswith("scene 1 sha256 ")
    with pytest.raises(DataError, match="other wavelengths"):
        learn_prior([cubes[0], cubes[1].assign_coords(wavelength=[4e-7, 5e-7, 6e-7])], spread=2)


def test_figure_shows_blocks_spectrum_and_eigenvalues(prior, tmp_path):
    figure = prior.figure()
    assert len(figure.axes) == 15
    figure.savefig(tmp_path / "prior.png")
    assert (tmp_path / "prior.png").stat().st_size > 1000


def test_a_block_larger_than_a_cube_is_refused():
    with pytest.raises(ShapeError, match=r"cube 1: found \(20, 26\) pixels, expected at least the block \(22, 7\)"):
        GaussianPrior.learn(CUBES, (22, 7))


@pytest.mark.parametrize(
    ("cubes", "message"),
    [
        ([], "none"),
        ([CUBES[0], CUBES[1][:2]], "cube 1"),
        ([torch.full((3, 9, 9), torch.nan)], "not finite"),
    ],
)
def test_impossible_cubes_are_refused(cubes, message):
    with pytest.raises(TmcaError, match=message):
        GaussianPrior.learn(cubes, (2, 2))


def test_files_that_are_no_prior_are_refused(tmp_path, prior):
    path = tmp_path / "prior.nc"
    with pytest.raises(DataError, match="no such file"):
        GaussianPrior.load(path)
    path.write_bytes(b"not a prior")
    with pytest.raises(DataError, match="unreadable or truncated"):
        GaussianPrior.load(path)
    path.unlink()
    xr.Dataset({"mean": ("x", [1.0])}).to_netcdf(path, engine="h5netcdf")
    with pytest.raises(DataError, match="no prior in it"):
        GaussianPrior.load(path)
    prior.save(path, overwrite=True)
    with h5py.File(path, "r+") as file:
        file["mean"][0, 0, 0] = np.nan
    with pytest.raises(DataError, match="not finite"):
        GaussianPrior.load(path)


def test_a_truncated_prior_file_is_refused(tmp_path, prior):
    path = tmp_path / "prior.nc"
    prior.save(path)
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(DataError):
        GaussianPrior.load(path)


def test_a_prior_that_cannot_be_written_leaves_nothing_behind(tmp_path, prior):
    with pytest.raises(OutputError, match="no such folder"):
        prior.save(tmp_path / "missing" / "prior.nc")
    assert list(tmp_path.iterdir()) == []
