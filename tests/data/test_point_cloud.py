"""Depth maps as points: geometry of a pinhole, and what lies in the file."""

import numpy as np
import pytest

from tmca.data.point_cloud import points_of, write_ply
from tmca.errors import OutputError, SettingError, ShapeError


def read_back(path):
    """Points and colours of a PLY file, by its own head alone."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    lines = head.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    sizes = {"float": "<f4", "uchar": "u1"}
    fields = [(words[2], sizes[words[1]]) for words in map(str.split, lines) if words[0] == "property"]
    count = next(int(line.split()[2]) for line in lines if line.startswith("element vertex"))
    found = np.frombuffer(body, dtype=fields)
    assert len(found) == count
    return [np.stack([found[name] for name in names], 1) for names in (("x", "y", "z"), ("red", "green", "blue"))]


@pytest.mark.parametrize("size", [(7, 9), (8, 12)])
def test_a_tilted_plane_stays_a_plane(tmp_path, size):
    normal, focal = np.array([0.3, -0.2, 0.9]), 20.0
    y, x = np.mgrid[: size[0], : size[1]]
    right, up = (x - (size[1] - 1) / 2) / focal, -(y - (size[0] - 1) / 2) / focal
    depth = 2.0 / (normal[2] - normal[0] * right - normal[1] * up)  # of normal · (x, y, z) = -2
    colours = np.random.default_rng(0).random((*size, 3))
    points, shown = read_back(write_ply(*points_of(depth, colours, focal), tmp_path / "p.ply", comment="two\nlines"))
    np.testing.assert_allclose(points @ normal, -2.0, rtol=1e-5)
    np.testing.assert_allclose(shown / 255, colours.reshape(-1, 3), atol=0.5 / 255 + 1e-6)
    assert points[0, 0] < 0 < points[-1, 0]
    assert points[0, 1] > 0 > points[-1, 1]


def test_unknown_pixels_are_left_out():
    depth = np.array([[1.0, np.nan, 0.0], [np.inf, 2.0, -1.0]])
    points, _ = points_of(depth, np.zeros((2, 3, 3)), 3.0)
    np.testing.assert_array_equal(points[:, 2], [-1, -2])
    assert len(points_of(depth, np.zeros((2, 3, 3)), 3.0, np.zeros((2, 3)))[0]) == 0


def test_what_is_no_cloud_is_refused(tmp_path):
    with pytest.raises(SettingError, match="above 0"):
        points_of(np.ones((2, 2)), np.zeros((2, 2, 3)), 0.0)
    with pytest.raises(ShapeError):
        points_of(np.ones((2, 2)), np.zeros((2, 3, 3)), 1.0)
    with pytest.raises(OutputError, match="rename"):
        write_ply(np.zeros((1, 3), np.float32), np.zeros((1, 3), np.uint8), tmp_path / "a.obj")
