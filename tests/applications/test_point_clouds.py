"""Points of scenes with depth and of light fields, against the geometry of planes."""

import numpy as np
import pytest
import xarray as xr

import tmca
from tmca.errors import SettingError


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
