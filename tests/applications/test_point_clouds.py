"""Points of scenes with depth and of light fields, against the geometry of planes."""

import json

import numpy as np
import pytest
import torch
import xarray as xr
from PIL import Image

import tmca
from tmca.data import read_spectral_depth, write_dataset, write_light_field
from tmca.data.fitting import fit_depth_scene
from tmca.data.in_memory import SceneWarning
from tmca.decoders import Estimate
from tmca.errors import DataError, SettingError


def light_field(distance, focal, baseline, focus, size=(7, 10)):
    """Maps of a plane at a distance, by the parallax of two pinholes: f b / z, less that of the plane in focus."""
    disparity = focal * baseline / distance - focal * baseline / focus
    maps = {"disparity": np.full(size, disparity), "confidence": np.linspace(0, 1, 70).reshape(size)}
    maps["all_in_focus"] = np.full(size, 0.5)
    return xr.Dataset({name: (("y", "x"), values) for name, values in maps.items()})


@pytest.mark.parametrize("distance", [0.8, 1.5, 4.0])
def test_disparities_of_a_plane_are_points_of_it(distance):
    scene = light_field(distance, 100.0, 0.02, 1.5)
    cloud = tmca.point_cloud(scene, 100.0, baseline=0.02, focus=1.5)
    assert len(cloud.points) == 70
    np.testing.assert_allclose(cloud.points[:, 2], -distance, rtol=1e-6)
    np.testing.assert_allclose(np.ptp(cloud.points[:, 0]), 9 / 100 * distance, rtol=1e-5)
    assert np.ptp(cloud.colours) == 0


def test_what_lies_beyond_the_farthest_distance_is_no_point():
    scene = light_field(2.0, 100.0, 0.02, 1.5)
    scene["disparity"][:, :4] = -100 * 0.02 / 1.5 - 0.1
    assert len(tmca.point_cloud(scene, 100.0, baseline=0.02, focus=1.5).points) == 42


def test_why_pixels_are_no_points_is_counted():
    scene = light_field(2.0, 100.0, 0.02, 1.5)
    scene["disparity"][:, :4] = -100 * 0.02 / 1.5 - 0.1
    cloud = tmca.point_cloud(scene, 100.0, 0.5, baseline=0.02, focus=1.5)
    low = int((scene["confidence"][:, 4:] < 0.5).sum())
    assert dict(cloud.left_out) == {"with a disparity beyond infinity": 28, "below the confidence": low}
    assert len(cloud.points) == 70 - 28 - low
    assert cloud.distance == pytest.approx((2.0, 2.0))


def test_points_that_are_nearly_at_infinity_are_warned_of():
    scene = light_field(2.0, 100.0, 0.02, 1.5)
    scene["disparity"][0, :3] = -100 * 0.02 / 1.5 + 100 * 0.02 / 200
    with pytest.warns(SceneWarning, match="3 of 70 points lie beyond 150 m"):
        tmca.point_cloud(scene, 100.0, baseline=0.02, focus=1.5)


@pytest.mark.filterwarnings("ignore::tmca.data.in_memory.SceneWarning")
def test_a_mapped_depth_is_mapped_back_to_the_scene():
    cube = xr.DataArray(np.ones((3, 4, 5)), {"wavelength": [450e-9, 550e-9, 650e-9]}, ("wavelength", "y", "x"))
    metres = np.linspace(2.0, 5.0, 20).reshape(4, 5)
    scene = xr.Dataset({"radiance": cube, "depth": (("y", "x"), metres)})
    mapped = fit_depth_scene(scene, cube["wavelength"].values, (4, 5), 0.4, 2.0)
    assert float(mapped["depth"].max()) < 2.001
    np.testing.assert_allclose(tmca.point_cloud(mapped, 10.0).points, tmca.point_cloud(scene, 10.0).points, rtol=1e-4)


def test_pixels_of_low_confidence_are_left_out():
    scene = light_field(2.0, 100.0, 0.02, 1.5)
    kept = tmca.point_cloud(scene, 100.0, 0.5, baseline=0.02, focus=1.5)
    assert len(kept.points) == int((scene["confidence"] >= 0.5).sum())


@pytest.mark.parametrize(
    "given", [{}, {"baseline": 0.02}, {"focus": 1.0}, {"baseline": -1.0, "focus": 1.0}, {"baseline": 0.1, "focus": 0.0}]
)
def test_a_light_field_needs_its_geometry(given):
    with pytest.raises(SettingError, match="of the light field"):
        tmca.point_cloud(light_field(2.0, 100.0, 0.02, 1.5), 100.0, **given)


def test_what_is_missing_of_a_light_field_is_asked_for_at_once():
    with pytest.raises(SettingError, match=r"give focal_px, baseline, focus \(--focal, --baseline, --focus\)"):
        tmca.point_cloud(light_field(2.0, 100.0, 0.02, 1.5))


def test_a_scene_with_depth_takes_none():
    cube = xr.DataArray(np.ones((3, 4, 5)), {"wavelength": [450e-9, 550e-9, 650e-9]}, ("wavelength", "y", "x"))
    scene = xr.Dataset({"radiance": cube, "depth": (("y", "x"), np.full((4, 5), 2.0))})
    np.testing.assert_allclose(tmca.point_cloud(scene, 10.0).points[:, 2], -2.0)
    with pytest.raises(SettingError, match="baseline"):
        tmca.point_cloud(scene, baseline=0.1)


def test_a_cloud_is_said_drawn_and_written(tmp_path):
    cloud = tmca.point_cloud(light_field(2.0, 100.0, 0.02, 1.5), 100.0, baseline=0.02, focus=1.5)
    assert "70" in repr(cloud)
    assert cloud.plot().axes
    assert cloud.save(tmp_path / "plane.ply").read_bytes().startswith(b"ply\n")


def test_an_estimate_of_a_light_field_is_a_cloud():
    scene = tmca.read("coffee:1", "light-field", views=3, size=(24, 32))
    camera = tmca.LightFieldCamera(slots=1, shutter="open")
    estimate = tmca.reconstruct(tmca.simulate(scene, camera), "dagger")
    cloud = tmca.point_cloud(estimate, 40.0, baseline=0.05, focus=1.0)
    depth = 1 / (1 / 1.0 + estimate.maps["disparity"].values / (40.0 * 0.05))
    np.testing.assert_allclose(np.sort(-cloud.points[:, 2]), np.sort(depth[depth > 0]), rtol=1e-5)


def test_light_fields_of_every_origin_are_the_same_points(tmp_path):
    how = {"focal_px": 40.0, "baseline": 0.05, "focus": 1.0}
    scene = tmca.read("coffee:1", "light-field", views=3, size=(24, 32))
    estimate = tmca.reconstruct(tmca.simulate(scene, tmca.LightFieldCamera(slots=1, shutter="open")), "dagger")
    of_estimate = tmca.point_cloud(estimate, **how).points
    np.testing.assert_array_equal(tmca.point_cloud(estimate.save(tmp_path / "e.nc"), **how).points, of_estimate)
    views = estimate.to_xarray()["estimate"]
    np.testing.assert_array_equal(tmca.point_cloud(views, **how).points, of_estimate)
    np.testing.assert_array_equal(tmca.point_cloud(views.to_dataset(), **how).points, of_estimate)
    write_light_field(views, tmp_path / "views.nc")
    from_file = tmca.point_cloud(tmp_path / "views.nc", **how).points
    np.testing.assert_allclose(np.median(from_file, 0), np.median(of_estimate, 0), rtol=0.05, atol=0.05)


@pytest.mark.parametrize("scene", [xr.DataArray(np.ones((3, 4, 5)), dims=("wavelength", "y", "x")), np.ones((4, 5))])
def test_what_has_no_depth_is_refused(scene):
    with pytest.raises(DataError, match="expected radiance and depth, or a light field"):
        tmca.point_cloud(scene)


def test_a_reduced_scene_has_a_shorter_focal_length(tmp_path):
    """A wall that fills a field of view has the same width in metres at any number of pixels."""
    pixels = np.full((48, 64, 3), 128, np.uint8)
    Image.fromarray(pixels).save(tmp_path / "color_0.jpg")
    Image.fromarray(np.full((48, 64), 2000, np.uint16)).save(tmp_path / "depth_0.png")
    matrix = [52.0, 0, 0, 0, 52.0, 0, 32, 24, 1]
    (tmp_path / "camera.json").write_text(json.dumps({"intrinsic_matrix": matrix, "width": 64, "height": 48}))
    whole, small = (read_spectral_depth(tmp_path, from_rgb=True, reduce=by) for by in (None, 4))
    assert (whole.attrs["focal_px"], small.attrs["focal_px"]) == (52.0, 13.0)
    width = [np.ptp(tmca.point_cloud(scene).points[:, 0]) for scene in (whole, small)]
    np.testing.assert_allclose(width, [63 * 2 / 52, 15 * 2 / 13], rtol=1e-5)
    labelled = write_dataset(whole, tmp_path / "whole.nc")
    assert read_spectral_depth(labelled, reduce=2).attrs["focal_px"] == 26.0


def test_an_estimate_takes_the_focal_length_of_its_scene_before_that_of_the_bench():
    waves, size = (500e-9, 600e-9), (20, 20)
    bench = tmca.optics.PhaseMaskBench(window=(5, 5), mask_pixels=8)
    camera = tmca.SpectralDepthCamera(waves, size, 1, planes=2, bench=bench)
    cube = xr.DataArray(np.full((2, *size), 0.5), {"wavelength": list(waves)}, ("wavelength", "y", "x"))
    scene = xr.Dataset({"radiance": cube, "depth": (("y", "x"), np.full(size, 1.0))})
    for attrs, expected in (({}, bench.distance / bench.pitch), ({"focal_px": 131.25}, 131.25)):
        snapshot = tmca.simulate(scene.assign_attrs(attrs), camera)
        values = torch.full((1, 2, *size), 0.5)
        plane = torch.ones(1, 1, *size)
        one = Estimate(values, snapshot.camera, "x", depth=plane, confidence=plane, notes=snapshot.notes)
        cloud = tmca.point_cloud(one)
        assert cloud.focal_px == pytest.approx(expected)
        assert ("that of the bench" in repr(cloud)) == (not attrs)
