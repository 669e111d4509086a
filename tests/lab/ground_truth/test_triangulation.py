"""Depth where rays meet planes of light: held to points projected by hand."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from studies.rendered_table import bench
from tmca.data.depth_maps import disparity_to_depth
from tmca.errors import DataError
from tmca.lab.ground_truth.geometry import Lens, ProjectorCalibration, camera_rays, load_calibration, triangulate

BENT = np.array([-0.12, 0.03, 0.001, -0.002, 0.004])


def tilted(size, bent=False):
    """A bench whose projector is turned about every axis."""
    from scipy.spatial.transform import Rotation

    plain = bench(size)
    turn = Rotation.from_euler("xyz", [3, 12, -4], degrees=True).as_matrix()
    lenses = [Lens(lens.size, lens.matrix, BENT * sign if bent else np.zeros(5))
              for lens, sign in ((plain.camera, 1), (plain.projector, -1))]  # fmt: skip
    return ProjectorCalibration(*lenses, turn, np.array([-0.21, 0.03, 0.05]))


def projected(lens, point):
    """Brown's model as OpenCV writes it down, a point at a time."""
    x, y = point[0] / point[2], point[1] / point[2]
    k1, k2, p1, p2, k3 = lens.distortion
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return lens.matrix[0, 0] * xd + lens.matrix[0, 2], lens.matrix[1, 1] * yd + lens.matrix[1, 2]


@pytest.mark.parametrize("across", ["x", "y"])
@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize("size", [(12, 16), (13, 15)])
def test_depth_comes_back_from_projected_points(size, bent, across):
    calibration = tilted(size, bent)
    if across == "y":
        calibration = ProjectorCalibration(
            calibration.camera, calibration.projector, calibration.rotation, np.array([0, -0.2, 0])
        )
    depth = np.random.default_rng(0).uniform(0.4, 1.6, size)
    position = np.empty(size)
    for y in range(size[0]):
        for x in range(size[1]):
            point = depth[y, x] * camera_rays(calibration)[:, y, x]
            assert projected(calibration.camera, point) == pytest.approx((x, y), abs=1e-5)
            there = calibration.rotation @ point + calibration.translation
            position[y, x] = projected(calibration.projector, there)[0 if across == "x" else 1]
    found, _ = triangulate(position, 0.1, calibration, across)
    assert np.allclose(found, depth, rtol=1e-4 if bent else 1e-9)


def test_side_by_side_it_is_depth_from_disparity():
    lens = Lens((6, 8), np.array([[100.0, 0, 3.5], [0, 100, 2.5], [0, 0, 1]]))
    side_by_side = ProjectorCalibration(lens, lens, np.eye(3), np.array([-0.2, 0, 0]))
    columns = np.tile(np.arange(8.0), (6, 1))
    disparity = np.linspace(10, 40, 48).reshape(6, 8)
    found, _ = triangulate(columns - disparity, 0.1, side_by_side)
    assert np.allclose(found, disparity_to_depth(disparity, 100.0, 0.2))


@settings(max_examples=20, deadline=None)
@given(scale=st.floats(0.1, 10), seed=st.integers(0, 99))
def test_a_wider_baseline_makes_the_world_larger(scale, seed):
    near = tilted((5, 6))
    far = ProjectorCalibration(near.camera, near.projector, near.rotation, near.translation * scale)
    position = np.random.default_rng(seed).uniform(0, 600, (5, 6))
    one, other = triangulate(position, 0.1, near), triangulate(position, 0.1, far)
    assert np.allclose(other[0], scale * one[0], equal_nan=True)
    assert np.allclose(other[1], scale * one[1], equal_nan=True)


def test_the_standard_deviation_is_the_slope_times_that_of_the_position():
    calibration, step = tilted((7, 8)), 1e-3
    position = np.full((7, 8), 500.0)
    depth, std = triangulate(position, 0.2, calibration)
    moved, _ = triangulate(position + step, 0.2, calibration)
    assert np.allclose(std, 0.2 * np.abs(moved - depth) / step, rtol=1e-3, equal_nan=True)


def test_rays_that_miss_the_light_have_no_depth():
    depth, std = triangulate(np.array([[np.nan, 5000.0]]), 0.1, bench((1, 2)))
    assert np.isnan(depth).all()
    assert np.isnan(std).all()


def test_a_calibration_comes_back_from_its_file(tmp_path):
    kept = tilted((12, 16), bent=True)
    found = load_calibration(kept.save(tmp_path / "c.json"))
    for lens, other in ((kept.camera, found.camera), (kept.projector, found.projector)):
        assert lens.size == other.size
        assert np.allclose(lens.matrix, other.matrix)
        assert np.allclose(lens.distortion, other.distortion)
    assert np.allclose(kept.rotation, found.rotation)
    assert np.allclose(kept.translation, found.translation)


LENS = {"size": [8, 8], "matrix": np.eye(3).tolist()}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 2]]}, "no rotation"),
        ({"rotation": [1, 2]}, "rotation"),
        ({"translation_m": None}, "translation_m"),
        ({"camera": None}, "camera"),
        ({"projector": {"size": [8, 8], "matrix": [[0, 0, 0]] * 3}}, "not positive"),
        ({"projector": LENS | {"distortion": [0] * 6}}, "distortion"),
        ({"projector": LENS | {"distortion": "abc"}}, "distortion"),
        ({"projector": LENS | {"distortion": {"k1": 1}}}, "projector.distortion"),
        ({"projector": LENS | {"size": [8.7, 8]}}, "projector.size"),
        ({"projector": {"size": [8, 8]}}, "projector.matrix"),
    ],
)
def test_impossible_calibrations_are_refused(tmp_path, change, said):
    path = bench().save(tmp_path / "c.json")
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(DataError, match=said):
        load_calibration(path)


def test_files_that_are_no_json_are_refused(tmp_path):
    for name, text, said in (("a.json", "{", "JSON"), ("b.json", "[1]", "names with values")):
        (tmp_path / name).write_text(text)
        with pytest.raises(DataError, match=said):
            load_calibration(tmp_path / name)
    with pytest.raises(DataError, match="no such file"):
        load_calibration(tmp_path / "c.json")
