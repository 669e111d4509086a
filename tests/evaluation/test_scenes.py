"""Scenes are read once for all cells of a process."""

import numpy as np
import pytest
import xarray as xr

from tmca.evaluation.scenes import SHARED, read_once


@pytest.fixture
def read():
    """A reader that says what it was asked."""
    asked = []

    def reader(source, bands=None):
        asked.append((source, bands))
        return xr.DataArray(np.arange(3.0), dims="x", attrs={"name": source})

    reader.asked = asked
    return reader


def test_a_scene_is_read_once_for_each_way_of_reading(read):
    for bands in (4, 4, 5, 4):
        scene = read_once(read, "a", bands=bands)
        np.testing.assert_array_equal(scene, np.arange(3.0))
    assert read.asked == [("a", 4), ("a", 5)]


def test_labels_that_a_cell_adds_are_its_own(read):
    read_once(read, "labels").attrs["name"] = "changed"
    assert read_once(read, "labels").attrs["name"] == "labels"


def test_the_one_used_longest_ago_goes(read):
    read_once(read, "first")
    for number in range(SHARED):
        read_once(read, str(number))
    read_once(read, "first")
    assert read.asked.count(("first", None)) == 2


def test_a_file_that_changes_is_read_again(read, tmp_path):
    file = tmp_path / "scene.npy"
    for content in (b"one", b"one", b"other"):
        file.write_bytes(content)
        read_once(read, str(file))
    assert len(read.asked) == 2
