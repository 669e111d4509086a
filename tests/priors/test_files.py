"""Priors of every kind come back from their files, those of version 0.1 too."""

from pathlib import Path

import numpy as np
import pytest
import torch
import xarray as xr

from tests.priors.test_conformance import check_it_comes_back
from tests.small_scenes import smooth_scene
from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders import decode
from tmca.errors import DataError, OutputError, SettingError
from tmca.priors import GaussianMixturePrior, GaussianPrior, PatchDictionary, load_prior
from tmca.sensor import Sensor

CUBES = [smooth_scene(24, 31, seed=1), smooth_scene(20, 26, seed=2)]
ABOUT = {"wavelengths": (450e-9, 550e-9, 650e-9), "sources": ("a", "b")}
NINE = [torch.rand(9, 12, 13, generator=torch.Generator().manual_seed(0))]
MADE = {
    "gaussian": lambda: GaussianPrior.learn(CUBES, (3, 7), **ABOUT),
    "not stationary": lambda: MADE["mixture"]().component(0),
    "views": lambda: GaussianPrior.learn(NINE, (3, 4), views=(3, 3), sources=["plane"]),
    "mixture": lambda: GaussianMixturePrior.learn(CUBES, (2, 6), kinds=3, rank=5, gains=2, samples=300, **ABOUT),
    "dictionary": lambda: PatchDictionary.learn(
        NINE, (3, 4), views=(3, 3), atoms=6, coreset=50, rank=8, batch=20, sources=["plane"]
    ),
}


@pytest.mark.parametrize("name", ["not stationary", "views"])
def test_a_gaussian_prior_of_another_form_comes_back_too(name, tmp_path):
    check_it_comes_back(MADE[name](), tmp_path / "prior.nc")


def test_files_of_version_0_1_open():
    folder = Path(__file__).parent / "files"
    gaussian, mixture, atoms = (load_prior(folder / f"{kind}-0.1.nc") for kind in ("gaussian", "mixture", "dictionary"))
    assert (gaussian.kind, mixture.kind, atoms.kind) == ("gaussian", "mixture", "dictionary")
    assert (gaussian.block, mixture.block, atoms.block) == ((2, 2, 4), (2, 2, 4), (9, 2, 3))
    assert gaussian.wavelengths == mixture.wavelengths == (4.5e-7, 6e-7)
    assert (gaussian.sources, mixture.sources, atoms.sources) == (("a", "b"), ("a",), ("plane",))
    assert float(gaussian.mean[0, 0, 0]) == pytest.approx(0.3036473590503495, abs=1e-15)
    assert float(gaussian.moments[0, 1, 1, 2]) == pytest.approx(0.02887766901282554, abs=1e-15)
    assert mixture.weights.flatten().tolist() == pytest.approx([0.0629, 0.3131, 0.2063, 0.4177], abs=1e-4)
    assert mixture.gains.tolist() == pytest.approx([0.6347, 0.3174], abs=1e-4)
    assert atoms.atoms[0, 0, 0].tolist() == pytest.approx([-0.1230, -0.0289, -0.0125], abs=1e-4)
    assert (atoms.views, atoms.residual) == ((3, 3), pytest.approx(0.06973078632936337))
    assert atoms.notes["entries"] == pytest.approx(3.720833333333333)


def test_a_file_opens_in_plain_xarray(tmp_path):
    MADE["gaussian"]().save(tmp_path / "prior.nc")
    with xr.open_dataset(tmp_path / "prior.nc", engine="h5netcdf") as data:
        np.testing.assert_allclose(data["wavelength"], [450e-9, 550e-9, 650e-9])
        assert data["wavelength"].attrs["units"] == "m"
        assert list(data.attrs["block"]) == [3, 3, 7]
        assert data.attrs["sources"].split("\n") == ["a", "b"]


def greater(name, place, value):
    """One number of a variable is another."""

    def change(data):
        values = data[name].values.copy()
        values[place] = value
        return data.assign({name: (data[name].dims, values)})

    return change


FIRST, BESIDE = (0, 0, 0), (0, 1, 0, 0)


@pytest.mark.parametrize(
    ("name", "damage", "words"),
    [
        ("gaussian", lambda data: data.drop_vars("autocovariance"), "damaged"),
        ("gaussian", lambda data: data.assign_attrs(format="another"), "no prior"),
        ("gaussian", lambda data: data.assign_attrs(kind="another"), "no prior"),
        ("gaussian", lambda data: data.isel(dy=slice(1, None)), "damaged"),
        ("mixture", lambda data: data.drop_vars("basis"), "damaged"),
        ("dictionary", lambda data: data.drop_vars("scale"), "damaged"),
        ("dictionary", lambda data: (data * np.nan).assign_attrs(data.attrs), "not finite"),
        ("dictionary", lambda data: data.assign_attrs(notes="{"), "JSON"),
        ("dictionary", lambda data: data.assign_attrs(views=[2, 2]), "damaged"),
        ("gaussian", greater("mean", FIRST, np.nan), "not finite"),
        *((name, greater("mean", FIRST, 1e308), "not finite") for name in MADE if name != "dictionary"),
        ("gaussian", greater("autocovariance", BESIDE, 1e308), "not finite"),
        ("not stationary", greater("covariance", (0, 1), 1e308), "not finite"),
        ("gaussian", greater("autocovariance", BESIDE, 10.0), "variances"),
        ("views", greater("autocovariance", BESIDE, 10.0), "variances"),
        ("not stationary", greater("covariance", (0, 1), 10.0), "variances"),
    ],
)
def test_damaged_files_are_refused(name, damage, words, tmp_path):
    damage(xr.load_dataset(MADE[name]().save(tmp_path / "prior.nc"))).to_netcdf(tmp_path / "damaged.nc")
    with pytest.raises(DataError, match=words) as caught:
        load_prior(tmp_path / "damaged.nc")
    assert caught.value.where == str(tmp_path / "damaged.nc")


def test_what_is_no_file_of_a_prior_is_refused(tmp_path):
    path = tmp_path / "prior.nc"
    with pytest.raises(DataError, match="no such file"):
        load_prior(path)
    MADE["gaussian"]().save(path)
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(DataError):
        load_prior(path)


def test_a_prior_that_cannot_be_written_leaves_nothing_behind(tmp_path):
    with pytest.raises(OutputError):
        MADE["gaussian"]().save(tmp_path / "missing" / "prior.nc")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["gaussian", "mixture"])
def test_a_covariance_that_is_not_positive_definite_is_told_by_who_solves(name):
    """Correlations of -0.9 between any two of three bands are below one, and no scene has them."""
    bands = 0.1 * (1.9 * torch.eye(3) - 0.9).double()
    prior = GaussianPrior(torch.full((3, 1, 4), 0.5).double(), torch.kron(bands, torch.eye(4).double()))
    prior._check_correlations()
    prior = prior if name == "gaussian" else GaussianMixturePrior.of(prior)
    with pytest.raises(SettingError, match="positive definite"):
        prior.sample(2, seed=0)
    how = {"aperture": "open", "shutter": "open", "dispersion": [0.0, 0.0, 0.0], "sensor": Sensor(read_noise=1e-6)}
    camera = SpectralCamera(3, (4, 5), 1, **how)
    taken = Snapshot(camera(torch.rand(1, 3, 4, 5)), camera)
    with pytest.raises(SettingError, match="positive definite"):
        decode(taken, "lmmse" if name == "gaussian" else "mixture", prior=prior)
