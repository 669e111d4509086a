"""Every kind of prior: learned, sampled, drawn, saved, read back, and checked against a camera."""

from functools import cache

import numpy as np
import pytest
import torch
import xarray as xr
from matplotlib.figure import Figure

from tmca.cameras import LightFieldCamera, SpectralCamera
from tmca.errors import DataError, OutputError, SettingError, ShapeError
from tmca.priors import GaussianPrior, Prior, check_kind, find_prior, learn_prior, load_prior, prior_kinds

BANDS, VIEWS = 3, (3, 3)
WAVELENGTHS = (500e-9, 550e-9, 600e-9)
SMALL = {"gaussian": {}, "mixture": {"kinds": 2, "rank": 4, "gains": 2, "samples": 200, "seed": 1}}
SMALL["dictionary"] = {"atoms": 12, "seed": 1}
KINDS = sorted(prior_kinds())


def examples(channels):
    source = torch.Generator().manual_seed(0)
    return [torch.rand(channels, side, side + 3, generator=source) for side in (22, 25)]


def anew(kind):
    """A prior of cubes, or of views where it is of these alone."""
    if Prior.kinds[kind].of_views:
        return Prior.kinds[kind].learn(
            examples(9), (4, 4), views=VIEWS, sources=["one", "other"], **SMALL.get(kind, {})
        )
    about = {"wavelengths": WAVELENGTHS, "sources": ["one", "other"]}
    return Prior.kinds[kind].learn(examples(BANDS), (3, 5), **about, **SMALL.get(kind, {}))


learned = cache(anew)


def check_it_comes_back(prior, path):
    prior.save(path)
    for again in (load_prior(path), type(prior).load(path)):
        assert type(again) is type(prior)
        for part in ("block", "wavelengths", "sources"):
            assert getattr(again, part) == getattr(prior, part)
        assert again.attributes() == prior.attributes()
        for name, values in prior.arrays().items():
            torch.testing.assert_close(again.arrays()[name].double(), values.double())
    with pytest.raises(OutputError):
        prior.save(path)


@pytest.mark.parametrize("kind", KINDS)
def test_it_comes_back_from_its_file(kind, tmp_path):
    prior, path = learned(kind), tmp_path / "p.nc"
    check_it_comes_back(prior, path)
    for other in (name for name in Prior.kinds if not issubclass(Prior.kinds[kind], Prior.kinds[name])):
        with pytest.raises(DataError, match="expected"):
            Prior.kinds[other].load(path)
        with pytest.raises(SettingError, match="expected"):
            check_kind(prior, other)


@pytest.mark.parametrize("kind", KINDS)
def test_samples_are_blocks_and_the_seed_alone_decides_them(kind):
    prior = learned(kind)
    samples = prior.sample(3, seed=2)
    assert tuple(samples.shape) == (3, *prior.block)
    assert bool(samples.isfinite().all())
    torch.testing.assert_close(prior.sample(3, seed=2), samples)
    assert not torch.equal(prior.sample(3, seed=3), samples)


@pytest.mark.parametrize("kind", KINDS)
def test_it_is_drawn_and_says_what_it_is(kind):
    prior = learned(kind)
    assert isinstance(prior.figure(), Figure)
    assert prior.called.split()[0] in ("a", "an")
    assert set(prior.arrays()) <= set(prior.dimensions)
    assert prior.to("cpu") is prior
    assert prior != anew(kind)
    assert len(repr(prior)) < 300


@pytest.mark.parametrize("kind", KINDS)
def test_no_samples_are_refused(kind):
    for count in (-1, 0, "many"):
        with pytest.raises(SettingError) as error:
            learned(kind).sample(count, seed=0)
        assert error.value.where == "count"


def test_a_prior_that_is_another_with_a_kind_of_its_own_conforms_and_is_taken_for_it(tmp_path, monkeypatch):
    monkeypatch.setattr(Prior, "kinds", dict(Prior.kinds))

    class Warm(GaussianPrior):
        kind, called = "warm", "a warm prior"

    test_it_comes_back_from_its_file("warm", tmp_path)
    test_samples_are_blocks_and_the_seed_alone_decides_them("warm")
    test_it_is_drawn_and_says_what_it_is("warm")
    test_cameras_of_other_bands_or_views_are_refused("warm")
    cube = xr.DataArray(examples(3)[0].numpy(), dims=("wavelength", "y", "x"), coords={"wavelength": [*WAVELENGTHS]})
    prior = learn_prior([cube], kind="warm")
    assert type(prior) is Warm
    camera = SpectralCamera(WAVELENGTHS, (22, 24))
    assert find_prior(camera, prior, "gaussian") is prior
    with pytest.raises(DataError):
        Warm.load(learned("gaussian").save(tmp_path / "g.nc"))


@pytest.mark.parametrize("kind", KINDS)
def test_cameras_of_other_bands_or_views_are_refused(kind):
    prior = learned(kind)
    fits = LightFieldCamera(VIEWS, (8, 8)) if Prior.kinds[kind].of_views else SpectralCamera(WAVELENGTHS, (8, 8))
    prior.check(fits)
    for camera in (LightFieldCamera((5, 5), (8, 8)), SpectralCamera(5, (8, 8))):
        with pytest.raises(ShapeError, match="expected"):
            prior.check(camera)


def test_settings_and_scenes_that_do_not_fit_are_named():
    cube = xr.DataArray(np.ones((3, 20, 20)), dims=("wavelength", "y", "x"), coords={"wavelength": list(WAVELENGTHS)})
    for camera, settings, where in (
        (None, {"blok": 3}, "blok"),
        (None, {"block": 4}, "block"),
        (LightFieldCamera(VIEWS, (8, 8)), {}, "scenes"),
    ):
        with pytest.raises(SettingError) as error:
            learn_prior([cube], camera, **settings)
        assert error.value.where == where
