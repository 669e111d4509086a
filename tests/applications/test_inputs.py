"""Scenes of every form go in everywhere: labelled, NumPy's and torch's say the same."""

import numpy as np
import pytest
import torch
import xarray as xr

import tmca
from tmca.data.in_memory import SceneWarning, even_bands
from tmca.data.unlabelled import of_array
from tmca.decoders.decoder import NoRenderedPrior
from tmca.errors import DataError, ShapeError
from tmca.metrics import rank_correlation
from tmca.viewer.opening import in_memory_items

BANDS = [450e-9, 550e-9, 650e-9]


def scenes(shape=(3, 12, 16)):
    """One scene in all forms."""
    values = np.random.default_rng(0).random(shape, dtype=np.float32)
    dims = ("wavelength", "y", "x") if len(shape) == 3 else ("view_v", "view_u", "y", "x")
    labelled = xr.DataArray(values, dims=dims, coords={"wavelength": BANDS} if len(shape) == 3 else None)
    return {
        "labelled": labelled,
        "other axes": labelled.transpose(*reversed(dims)),
        "NumPy": values,
        "NumPy, double": values.astype(np.float64),
        "torch": torch.from_numpy(values),
        "torch, batch": torch.from_numpy(values)[None],
    }


CAMERAS = {
    "spectral": (tmca.SpectralCamera, {"bands": BANDS, "size": (12, 16)}, (3, 12, 16)),
    "light-field": (tmca.LightFieldCamera, {"views": 3, "size": (12, 16)}, (3, 3, 12, 16)),
}
FORMS = ["other axes", "NumPy", "NumPy, double", "torch", "torch, batch"]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", CAMERAS)
def test_a_camera_images_a_scene_of_any_form_alike(kind, form):
    make, settings, shape = CAMERAS[kind]
    camera, given = make(**settings, slots=2), scenes(shape)
    expected = camera.A(given["torch, batch"])
    assert torch.equal(camera.A(given[form]), expected)
    assert torch.equal(camera(given[form]), expected)
    assert torch.equal(tmca.simulate(given[form], camera).values, expected)
    assert torch.equal(camera.A(given["labelled"]), expected)


def test_a_labelled_scene_is_brought_to_the_camera_as_for_a_snapshot():
    camera = tmca.SpectralCamera(bands=[551e-9, 649e-9], size=(8, 10), slots=2)
    scene = scenes()["labelled"]
    assert torch.equal(camera(scene), tmca.simulate(scene, camera).values)
    assert torch.equal(camera(scene), camera(scene.values[1:, 2:10, 3:13]))
    with pytest.raises(DataError):
        camera(scene.isel(wavelength=[0]))


def test_a_scene_with_depth_goes_in_with_its_depth():
    camera = tmca.SpectralDepthCamera.from_preset("quick", size=(32, 32), filters="clear")
    values = np.random.default_rng(0).random(camera.scene_shape, dtype=np.float32)
    depth = np.full((32, 32), np.mean([camera.planes.near, camera.planes.far]), np.float32)
    parts = {"radiance": (("wavelength", "y", "x"), values), "depth": (("y", "x"), depth)}
    scene = xr.Dataset(parts, {"wavelength": list(camera.wavelengths)})
    expected = camera.A(torch.from_numpy(values)[None], torch.from_numpy(depth)[None, None])
    assert torch.equal(camera.A(scene), expected)
    assert torch.equal(camera.A(values, depth), expected)
    nanometres = scene.assign_coords(wavelength=("wavelength", scene["wavelength"].values * 1e9, {"units": "nm"}))
    assert torch.equal(camera.A(nanometres), expected)


def test_arrays_become_of_the_cameras_type():
    camera = tmca.SpectralCamera(bands=BANDS, size=(12, 16), slots=2).double()
    assert camera.A(scenes()["NumPy"]).dtype == torch.float64
    with pytest.raises(ShapeError):
        camera.A(scenes()["NumPy"][:, :-1])
    with pytest.raises(DataError, match="numbers"):
        camera.A(np.array([["a"]]))


def test_a_snapshot_of_any_form_goes_back():
    camera = tmca.SpectralCamera(bands=BANDS, size=(12, 16), slots=2)
    snapshot = tmca.simulate(scenes()["labelled"], camera)
    expected = camera.A_adjoint(snapshot.values)
    for given in (snapshot, snapshot.values.numpy(), snapshot.to_xarray()["snapshot"]):
        assert torch.equal(camera.A_adjoint(given), expected)
    assert torch.equal(camera.A_dagger(snapshot), camera.A_dagger(snapshot.values))


def test_wavelengths_come_along_in_metres_and_in_nanometres():
    scene = scenes()["labelled"]
    nanometres = scene.assign_coords(wavelength=("wavelength", [450.0, 550.0, 650.0], {"units": "nm"}))
    for given in (scene, nanometres, nanometres.assign_coords(wavelength=[450.0, 550.0, 650.0])):
        snapshot = tmca.simulate(given, tmca.SpectralCamera(slots=2))
        assert snapshot.camera.wavelengths == pytest.approx(BANDS)
    with pytest.raises(DataError, match="metres or nanometres"):
        tmca.simulate(scene.assign_coords(wavelength=[0, 1, 2]), tmca.SpectralCamera(slots=2))


@pytest.mark.parametrize("form", ["NumPy", "torch", "no coordinate"])
def test_bands_without_wavelengths_are_assumed_and_that_is_said(form):
    given = scenes()["labelled"].drop_vars("wavelength") if form == "no coordinate" else scenes()[form]
    with pytest.warns(SceneWarning, match="evenly spaced from 400 to 700 nm"):
        snapshot = tmca.simulate(given, tmca.SpectralCamera(slots=2))
    assert snapshot.camera.wavelengths == pytest.approx([400e-9, 550e-9, 700e-9])


@pytest.mark.parametrize("kind", [np.asarray, torch.from_numpy])
def test_bands_that_are_last_in_an_array_are_recognised_as_in_files_where_the_camera_has_none(kind):
    values = np.random.default_rng(0).random((24, 24, 31)).astype(np.float32)
    with pytest.warns(SceneWarning, match=r"24×24×31, taken as \(rows, columns, bands\)"):
        taken = tmca.simulate(kind(values), tmca.SpectralCamera(slots=2))
    with pytest.warns(SceneWarning, match="without wavelengths") as warned:
        same = tmca.simulate(kind(np.moveaxis(values, -1, 0)), tmca.SpectralCamera(slots=2))
    assert not any("taken as (rows" in str(one.message) for one in warned)
    assert torch.equal(taken.values, same.values)
    with pytest.raises(ShapeError, match="24, 24, 31"):
        tmca.simulate(kind(values), tmca.SpectralCamera(bands=31, size=(24, 24), slots=2))


def test_of_a_single_band_the_wavelength_that_is_taken_is_said():
    with pytest.warns(SceneWarning, match="1 band without a wavelength, taken as 550 nm"):
        assert even_bands(1) == pytest.approx([550e-9])


@pytest.mark.parametrize("form", ["labelled", *FORMS[1:]])
def test_an_estimate_is_evaluated_and_drawn_beside_a_truth_of_any_form(form):
    given = scenes()
    camera = tmca.SpectralCamera(bands=BANDS, size=(12, 16), slots=2)
    estimate = tmca.reconstruct(tmca.simulate(given["labelled"], camera), "tikhonov")
    expected = tmca.evaluate(estimate, given["labelled"])
    assert tmca.evaluate(estimate, given[form]) == pytest.approx(expected)
    assert estimate.plot(truth=given[form]).axes
    for values in (estimate.values, np.asarray(estimate), estimate.to_xarray()["estimate"]):
        assert tmca.evaluate(values, given["labelled"]) == pytest.approx(expected)


def test_the_viewer_takes_arrays():
    with pytest.warns(SceneWarning, match="array: 3 bands"):
        (item,) = in_memory_items(scenes()["NumPy"])
    assert item.kind == "cube"
    (item,) = in_memory_items(torch.rand(3, 3, 12, 16))
    assert item.kind == "light field"
    with pytest.raises(DataError, match="shape"):
        of_array(np.zeros(5))


def test_a_camera_whose_scenes_are_not_rendered_is_decoded_without_a_prior_and_that_is_said():
    camera = tmca.SpectralCamera(bands=[400e-9, 700e-9, 1000e-9], size=(12, 16), slots=2)
    snapshot = tmca.simulate(scenes()["NumPy"], camera)
    with pytest.warns(NoRenderedPrior, match="admm-tv instead of lmmse"):
        estimate = tmca.reconstruct(snapshot)
    assert estimate.decoder == "admm-tv"
    assert "prior" not in estimate.notes


def test_an_estimate_says_which_prior_it_was_made_with(tmp_path):
    camera = tmca.SpectralCamera(bands=BANDS, size=(12, 16), slots=2)
    snapshot = tmca.simulate(scenes()["labelled"], camera)
    prior = tmca.priors.learn_prior([scenes((3, 40, 60))["labelled"]], camera)
    estimate = tmca.reconstruct(snapshot, "lmmse", prior=prior)
    assert estimate.notes["prior"] == "gaussian, learned from 1 scene (given)"
    assert "prior: gaussian" in repr(estimate)
    file = prior.save(tmp_path / "p.nc")
    assert str(file) in tmca.reconstruct(snapshot, "lmmse", prior=file).notes["prior"]


@pytest.mark.parametrize(("kind", "axes"), [
    ("spectral", ("wavelength", "y", "x")), ("light-field", ("view_v", "view_u", "y", "x")),
])  # fmt: skip
def test_a_predicted_deviation_is_held_against_the_errors_in_memory_and_in_files(kind, axes, tmp_path):
    draw = np.random.default_rng(3)
    values = draw.random((3, 3, 12, 16)[4 - len(axes) :], dtype=np.float32)
    sigma = draw.uniform(0.05, 0.2, values.shape).astype(np.float32)
    waves = {"wavelength": [5e-7, 6e-7, 7e-7]} if kind == "spectral" else {}
    truth = xr.DataArray(np.clip(values + sigma * draw.standard_normal(values.shape), 0, 1), waves, axes)
    truth = truth.astype(np.float32)
    known = {"estimate": (axes, values), "deviation": (axes, sigma)}
    stored = xr.Dataset(known, waves, {"camera": kind, "decoder": "lmmse"})
    stored.to_netcdf(tmp_path / "e.nc")
    expected = np.mean(np.abs(values - truth.values) <= sigma)
    assert tmca.evaluate(stored, truth)["coverage_1s"] == pytest.approx(expected)
    assert tmca.evaluate(tmp_path / "e.nc", truth)["coverage_1s"] == pytest.approx(expected)
    merits, twice = tmca.evaluate(stored, truth), np.mean(np.abs(values - truth.values) <= 2 * sigma)
    assert merits["coverage_2s"] == pytest.approx(twice)
    assert merits["rank_correlation"] == pytest.approx(rank_correlation(values, truth.values, sigma))
    assert "coverage_1s" not in tmca.evaluate(stored[["estimate"]], truth)
    with pytest.raises(DataError, match="below 0"):
        tmca.evaluate(stored.assign(deviation=-stored["deviation"]), truth)
    of_pixels = stored.assign(deviation=stored["deviation"][(0,) * (len(axes) - 2)])
    assert "coverage_1s" not in tmca.evaluate(of_pixels, truth)
