"""A camera's prior: learned from scenes, given, read, or that of the rendered scenes, which is cached."""

import numpy as np
import pytest
import torch
import xarray as xr

from tests.operators.test_window_moments import BENCH, camera, prior_of
from tests.small_scenes import smooth_scene
from tmca.cameras import LightFieldCamera, SpectralCamera
from tmca.errors import DataError, SettingError, ShapeError
from tmca.priors import GaussianMixturePrior, GaussianPrior, block_of, find_prior, learn_prior

LENGTHS = [4.5e-7, 5.5e-7, 6.5e-7]
SPECTRAL = SpectralCamera(bands=LENGTHS, size=(8, 30))
VIEWS = LightFieldCamera(3, (12, 14))


def cube(seed=1, lengths=LENGTHS, size=(24, 31), name="a scene"):
    dims, values = ("wavelength", "y", "x"), smooth_scene(*size, seed=seed).numpy()
    return xr.DataArray(values, dims=dims, coords={"wavelength": lengths}, attrs={"name": name})


def light_field(views=(3, 3), size=(14, 16), colours=()):
    values = np.random.default_rng(0).random((*colours, *views, *size), dtype=np.float32)
    return xr.DataArray(values, dims=("colour", "view_v", "view_u", "y", "x")[1 - len(colours) :], attrs={"name": "b"})


def small_mixture(bands=2):
    examples = [torch.rand(bands, 20, 20, generator=torch.Generator().manual_seed(0))]
    return GaussianMixturePrior.learn(examples, (4, 4), kinds=2, rank=8, samples=200)


def test_cubes_bring_their_wavelengths_and_checksums():
    prior = learn_prior([cube(), cube(2, size=(20, 26), name="another")], extent=2)
    assert prior.block == (3, 12, 24)
    assert prior.wavelengths == tuple(LENGTHS)
    assert prior.sources[1].startswith("another sha256 ")


def test_one_scene_and_axes_in_any_order_are_taken():
    one = learn_prior(cube())
    assert torch.equal(one.moments, learn_prior([cube().transpose("y", "x", "wavelength")]).moments)


def test_the_camera_decides_the_block_and_small_scenes_shrink_it():
    wide = SpectralCamera(bands=12, size=(8, 30))
    assert (block_of(wide), block_of(wide, "mixture")) == ((12, 36), (8, 36))
    many = (SpectralCamera(bands=31, size=(8, 30)), SpectralCamera(bands=28, size=(8, 30), dispersion=2.0))
    assert [block_of(one) for one in many] == [(7, 82), (4, 148)]
    others = ({"buckets": 2, "shutter": "balanced"}, {"disperser": "dual"})
    assert [block_of(SpectralCamera(bands=31, size=(8, 30), **how)) for how in others] == [(2, 74), (2, 74)]
    assert (block_of(LightFieldCamera(5, (8, 8))), block_of(LightFieldCamera(9, (8, 8)))) == ((9, 9), (5, 5))
    assert learn_prior([cube(size=(10, 20))], SPECTRAL).block == (3, 10, 20)
    assert learn_prior([cube()], SPECTRAL, block=(4, 9)).block == (3, 4, 9)


def test_a_prior_of_light_fields_is_that_of_their_colours_with_views_that_turn():
    field = light_field(colours=(2,))
    found = learn_prior([field.to_dataset(name="light_field")], VIEWS, block=(3, 4))
    cubes = [torch.from_numpy(colour).flatten(0, 1) for colour in field.values]
    assert torch.equal(found.moments, GaussianPrior.learn(cubes, (3, 4), views=(3, 3)).moments)
    few = {"kinds": 2, "rank": 5, "samples": 100, "gains": 2}
    mixture = learn_prior([field], VIEWS, "mixture", block=(3, 4), seed=3, **few)
    again = GaussianMixturePrior.learn(cubes, (3, 4), views=(3, 3), seed=3, **few)
    assert torch.equal(mixture.covariances, again.covariances)
    atoms = learn_prior([field], VIEWS, "dictionary", block=(3, 4), atoms=5, coreset=40, rank=6)
    assert (atoms.block, atoms.views) == ((9, 3, 4), (3, 3))


@pytest.mark.parametrize(
    ("scenes", "how", "error", "where"),
    [
        ([], {}, SettingError, "scenes"),
        ("coffee", {}, SettingError, "scenes"),
        (["coffee"], {}, SettingError, "scenes"),
        (None, {}, SettingError, "scenes"),
        ([torch.zeros(3, 20, 30)], {}, SettingError, "scenes"),
        ([cube().to_dataset(name="cube")], {}, DataError, "scenes"),
        ([cube()[0]], {}, ShapeError, "a scene"),
        ([cube().astype(str)], {}, DataError, "a scene"),
        ([cube() * float("nan")], {}, DataError, "cube 0"),
        ([cube()], {"block": (0, 9)}, SettingError, "block"),
        ([cube()], {"extent": -1}, SettingError, "extent"),
        ([cube()], {"kind": "mixture", "kinds": "many"}, SettingError, "kinds"),
        ([cube(), cube(2, [4e-7, 5e-7, 6e-7], name="other")], {}, DataError, "other"),
        ([light_field(), light_field((5, 5))], {}, DataError, "b"),
        ([cube()], {"kind": "dictionary"}, SettingError, "kind"),
        ([cube()], {"kind": "neural"}, SettingError, "kind"),
        ([cube(), cube(2, size=(9, 40), name="low")], {"block": (10, 20)}, DataError, "low"),
        ([cube(size=(14, 40), name="low")], {"camera": camera(4, bands=LENGTHS)}, DataError, "low"),
    ],
)
def test_scenes_that_do_not_go_together_are_refused(scenes, how, error, where):
    with pytest.raises(error) as caught:
        learn_prior(scenes, **how)
    assert caught.value.where == where


def test_a_prior_is_taken_as_it_is_or_read(tmp_path):
    prior, made = prior_of((12, 12)), camera(4)
    assert find_prior(made, prior) is prior
    read = find_prior(made, prior.save(tmp_path / "prior.nc"))
    torch.testing.assert_close(read.covariance, prior.covariance)


@pytest.mark.parametrize(
    ("camera", "prior", "kind", "error"),
    [
        (camera(4), small_mixture(), "gaussian", SettingError),
        (SPECTRAL, learn_prior([cube()], SPECTRAL), "mixture", SettingError),
        (SPECTRAL, learn_prior([cube(lengths=[4.5e-7, 5.5e-7, 6.6e-7])], SPECTRAL), "gaussian", SettingError),
        (SPECTRAL, prior_of((6, 6)), "gaussian", ShapeError),
        (camera(4), prior_of((6, 6), bands=3), "gaussian", ShapeError),
        (VIEWS, learn_prior([light_field((3, 5))], extent=0), "gaussian", ShapeError),
    ],
)
def test_a_prior_of_another_kind_or_camera_is_refused(camera, prior, kind, error, tmp_path):
    for given in (prior, prior.save(tmp_path / "prior.nc")):
        with pytest.raises(error) as caught:
            find_prior(camera, given, kind)
        assert caught.value.where == "prior"


def test_the_rendered_scenes_prior_is_learned_once_for_a_learner_and_a_block(monkeypatch, tmp_path):
    rendered = []

    def render(name, wavelengths, size):
        rendered.append(name)
        return xr.Dataset({"radiance": cube(len(name), wavelengths)})

    monkeypatch.setenv("TMCA_CACHE", str(tmp_path))
    monkeypatch.setattr("tmca.data.rendered_scene", render)
    monkeypatch.setattr("tmca.data.split_rendered", lambda: {"train": ["rocket", "coffee"]})
    shares = []
    first = find_prior(SPECTRAL, progress=lambda share, what: shares.append(share))
    assert rendered == ["coffee", "rocket"]
    assert shares == sorted(shares)
    (file,) = tmp_path.iterdir()
    assert file.name.startswith("rendered-gaussian-")
    assert torch.equal(find_prior(SPECTRAL).moments, first.moments)
    assert len(rendered) == 2
    file.write_bytes(b"damaged")
    assert torch.equal(find_prior(SPECTRAL).moments, first.moments)
    monkeypatch.setattr(GaussianPrior, "version", 2)
    find_prior(SPECTRAL)
    find_prior(SpectralCamera(bands=LENGTHS, size=(8, 30), dispersion=3.0))
    assert len(rendered) == 8
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.parametrize(("period", "window", "side"), [(2, None, 12), (2, 4, 12), (2, 15, 15), (16, None, 16)])
def test_the_prior_of_depth_holds_windows_of_the_usual_size(period, window, side):
    made = camera(4, size=(40, 40), period=period)
    assert block_of(made, window=window) == (side + BENCH.window[0] - 1, side + BENCH.window[1] - 1)


INFRARED = SpectralCamera(bands=[5e-7, 8e-7], size=(8, 30))


@pytest.mark.parametrize(
    ("call", "where"),
    [
        (lambda: find_prior(INFRARED, None, "gaussian"), "prior"),
        (lambda: find_prior(LightFieldCamera((3, 5), (8, 8)), None, "gaussian"), "prior"),
        (lambda: find_prior(VIEWS, None, "dictionary"), "dictionary"),
        *((lambda one=one: find_prior(one), "camera") for one in (None, "x", SpectralCamera)),
        (lambda: learn_prior(cube(), camera="x"), "camera"),
    ],
)
def test_what_has_no_rendered_prior_and_what_is_no_camera_is_refused(call, where):
    with pytest.raises(SettingError) as caught:
        call()
    assert caught.value.where == where
