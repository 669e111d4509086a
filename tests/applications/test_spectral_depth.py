"""Scenes with depth → snapshot → cube and depth, with files and pictures."""

import warnings

import numpy as np
import pytest
import torch
import xarray as xr

from tmca.applications import application_of, evaluate, simulate
from tmca.applications.camera_figures import psf_figure
from tmca.applications.pictures import estimate_pictures
from tmca.cameras import SpectralCamera, SpectralDepthCamera
from tmca.data import rendered_scene, write_dataset
from tmca.data.depth_scenes import load_spectral_depth
from tmca.data.fitting import middle_of
from tmca.data.scene_names import SceneWarning
from tmca.decoders import decode
from tmca.errors import DataError, SettingError
from tmca.operators.window_moments import needed_block
from tmca.optics import PhaseMaskBench
from tmca.plots.cube import sample_points
from tmca.plots.style import save_figure
from tmca.priors import GaussianPrior

WAVES = (480e-9, 560e-9, 640e-9)
SIZE = (36, 41)


@pytest.fixture(scope="module")
def camera():
    bench = PhaseMaskBench(window=(11, 11), mask_pixels=32)
    return SpectralDepthCamera(WAVES, SIZE, 4, planes=4, bench=bench, shutter="one-hot", channels="rgb")


@pytest.fixture(scope="module")
def prior():
    cube = rendered_scene("chelsea", wavelengths=WAVES, size=(60, 80))["radiance"].values
    return GaussianPrior.learn([torch.from_numpy(cube)], needed_block(8, (11, 11)), wavelengths=WAVES)


def scene_of(source="coffee", **how):
    return load_spectral_depth(source, WAVES, near=0.4, far=2.0, size=SIZE, **{"reduce": 8, **how})


def test_a_scene_comes_to_the_cameras_bands_size_and_range():
    scene = scene_of()
    assert dict(scene.sizes) == {"wavelength": 3, "y": 36, "x": 41}
    fitted = load_spectral_depth("coffee", WAVES, near=0.4, far=2.0, reduce=8)
    assert float(fitted["depth"].min()) == pytest.approx(0.4, rel=1e-5)
    assert float(fitted["depth"].max()) == pytest.approx(2.0, rel=1e-5)
    xr.testing.assert_equal(scene["depth"], middle_of(fitted, SIZE, "coffee")["depth"])  # cropped after it was fitted
    whole = rendered_scene("coffee", wavelengths=WAVES)["radiance"].values
    assert float(scene["radiance"].mean()) == pytest.approx(float(whole.mean()), rel=0.5)


def test_metric_depth_is_kept_or_told_how_it_was_mapped(camera):
    true, fitted = scene_of(fitted=False), scene_of()
    whole = rendered_scene("coffee", wavelengths=WAVES)["depth"].values
    assert set(np.unique(true["depth"].values)) <= set(np.unique(whole))
    kept = simulate(fitted, camera).notes
    mapped = kept["inverse_depth_scale"] / true["depth"].values + kept["inverse_depth_shift"]
    np.testing.assert_allclose(1 / mapped, fitted["depth"].values, rtol=1e-5)
    true["depth"][:3] = 2.1  # less than half a bin beyond the range
    unmapped = simulate(true, camera).notes
    assert "inverse_depth_scale" not in unmapped
    assert unmapped["unknown_depth_pixels"] == unmapped["unknown_outside"] == 3 * 41


def test_depth_that_is_mapped_is_said_and_an_argument_keeps_metres(camera):
    scene = rendered_scene("coffee", wavelengths=WAVES)[["radiance", "depth"]].isel(y=slice(36), x=slice(41))
    metres = np.linspace(1, 3, 36 * 41, dtype=np.float32).reshape(36, 41)
    scene["depth"].values[:] = metres
    with pytest.warns(SceneWarning, match=r"depths of 1 to 3 m mapped onto 0.4 to 2 m .*metric_depth=True"):
        mapped = simulate(scene, camera)
    assert "inverse_depth_scale" in mapped.notes
    kept = simulate(scene, camera, metric_depth=True)
    assert kept.notes["metric_depth"] == 1
    assert "inverse_depth_scale" not in kept.notes
    assert kept.notes["unknown_outside"] == int((metres > 2.0).sum()) > 0
    truth = scene.assign(radiance=scene["radiance"], depth=scene["depth"].clip(max=2.0))
    stored = truth.assign(confidence=truth["depth"]).assign_attrs(
        camera="spectral-depth", decoder="x", depth_planes='{"near": 0.4, "far": 2.0, "count": 4}', metric_depth=1
    )
    assert evaluate(stored, scene)["depth_mae"] == 0
    mapped_one = stored.assign_attrs({})
    del mapped_one.attrs["metric_depth"]
    with pytest.warns(SceneWarning, match="mapped onto 0.4 to 2 m"):
        found = evaluate(mapped_one, scene)
    assert found["depth_mae"] > 0
    assert found["depth_mae_of_constant"] > 0
    said = "depths of 1 to 3 m mapped onto 0.4 to 2 m"
    assert application_of("spectral-depth").remarks(stored.assign_attrs(mapped.notes)) == [
        f"metres are those of the mapped scene: {said}"
    ]
    assert application_of("spectral-depth").remarks(stored) == []
    far = scene.assign(depth=scene["depth"] + 2.05)
    with pytest.raises(DataError, match=r"choose another range \(--depth 3,5\.1\)"):
        simulate(far, camera, metric_depth=True)


def test_only_scenes_with_depth_have_metres():
    camera = SpectralCamera(slots=1, shutter="open")
    with pytest.raises(SettingError, match="metric_depth"):
        simulate(rendered_scene("coffee", wavelengths=WAVES)["radiance"][:, :9, :9], camera, metric_depth=True)


@pytest.mark.parametrize("how", [{"placed": "random"}, {"from_rgb": True}])
def test_a_scene_with_spectra_and_depth_needs_no_others(how):
    with pytest.raises(DataError, match=rf"coffee.*leave --{next(iter(how)).replace('_', '-')} out"):
        scene_of(**how)


def test_a_cube_is_placed_and_its_bands_are_chosen(tmp_path):

    waves = np.arange(400, 701, 20) * 1e-9
    values = np.random.default_rng(0).random((16, 40, 50)).astype(np.float32)
    cube = xr.DataArray(values, dims=("wavelength", "y", "x"), coords={"wavelength": waves}, name="radiance")
    file = write_dataset(cube.to_dataset(), tmp_path / "cube.nc")
    scene = scene_of(str(file), placed="pieces", reduce=1)
    np.testing.assert_allclose(scene["radiance"].values, values[[4, 8, 12], 2:38, 4:45], rtol=1e-5)
    with pytest.raises(DataError, match="740 nm"):
        load_spectral_depth(str(file), (480e-9, 740e-9), near=0.4, far=2.0, placed="pieces")


@pytest.mark.slow
def test_a_snapshot_gives_cube_and_depth_back_with_files_and_pictures(tmp_path, camera, prior):
    scene = scene_of()
    taken = simulate(scene, camera)
    assert taken.notes["unknown_depth_pixels"] == 0
    found = decode(taken, prior=prior, window=8)
    metrics = evaluate(found, scene)
    assert metrics["psnr"] > 15
    constant = float(abs(scene["depth"] - 2 / (1 / 0.4 + 1 / 2.0)).mean())  # the middle of the inverse range
    assert metrics["depth_mae"] < 0.7 * constant
    assert 0 <= metrics["within_bin"] <= 1
    file = found.save(tmp_path / "found.nc")
    with xr.open_dataset(file) as kept:
        assert set(kept.data_vars) == {"radiance", "depth", "depth_deviation", "confidence"}
    for picture in estimate_pictures(found, file, snapshot=taken, truth=scene):
        assert picture.stat().st_size > 10_000
    assert estimate_pictures(found, tmp_path / "alone.nc")[0].exists()
    assert save_figure(psf_figure(camera), tmp_path / "psf.png").stat().st_size > 10_000


def test_unknown_depth_is_counted_and_left_out_of_the_metrics(camera, prior):
    scene = scene_of()
    scene["depth"][:6] = np.nan
    taken = simulate(scene, camera)
    assert taken.notes["unknown_depth_pixels"] == 6 * 41
    assert np.isfinite(evaluate(decode(taken, prior=prior, window=8), scene)["depth_mae"])


def test_the_truth_of_another_scene_is_told(tmp_path, camera, prior):
    taken = simulate(scene_of(), camera)
    with pytest.warns(SceneWarning, match="rocket is beside a snapshot of coffee"):
        application_of(camera).truth("rocket", camera, taken.notes)
    found = decode(taken, "likelihood", prior=prior, window=8)
    found.save(tmp_path / "found.nc")
    with warnings.catch_warnings():
        warnings.simplefilter("error", SceneWarning)
        same = evaluate(tmp_path / "found.nc", "coffee")
    with pytest.warns(SceneWarning, match="rocket is beside a snapshot of coffee"):
        other = evaluate(tmp_path / "found.nc", "rocket")
    assert same["psnr"] > other["psnr"]


def test_points_of_a_large_picture_are_looked_for_on_a_coarser_grid(monkeypatch):
    cube = np.random.default_rng(0).random((3, 60, 80))
    monkeypatch.setattr("tmca.plots.cube._LOOKED_AT", 1000)
    coarse = sample_points(cube)  # 4800 pixels: every third
    assert len(set(coarse)) == 3
    assert coarse == [(3 * row, 3 * column) for row, column in sample_points(cube[:, ::3, ::3])]
