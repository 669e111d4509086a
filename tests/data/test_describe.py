"""A description has every fact of the file, in JSON's own types."""

from __future__ import annotations

import json

import numpy as np
import pytest
import scipy.io
import xarray as xr

from tmca.data import describe, write_dataset, write_tiff
from tmca.errors import DataError


def test_a_cube_of_every_format_has_its_wavelengths(cube, tmp_path):
    paths = [write_dataset(cube, tmp_path / name) for name in ("a.nc", "a.h5", "a.zarr")]
    for path in (*paths, write_tiff(cube, tmp_path / "a.tif")):
        about = describe(path)
        assert about["kind"] == "cube"
        assert about["shape"] == [7, 10, 13]
        assert about["dtype"] == "float32"
        waves = about["wavelengths"]
        assert (waves["count"], waves["first_nm"], waves["last_nm"], waves["from"]) == (7, 412.5, 699, "file")
        assert waves["spacing_nm"] == pytest.approx([30, 66.7])
        assert about["min"] == pytest.approx(float(cube.min()))
        assert about["mean"] == pytest.approx(float(cube.mean()), rel=1e-5)
        json.dumps(about, allow_nan=False)


def test_shares_of_zero_saturated_and_not_finite(tmp_path):
    counts = np.full((4, 5, 31), 7, dtype=np.uint8)
    counts[0, 0, :3], counts[1, :2, 0] = 0, 255
    scipy.io.savemat(tmp_path / "a.mat", {"x": counts})
    about = describe(tmp_path / "a.mat")
    assert about["zero_share"] == pytest.approx(3 / 620)
    assert about["saturated_share"] == pytest.approx(2 / 620)
    values = np.full((4, 5, 31), 0.5)
    values[0, 0, :3], values[2, 2, 2], values[3, 1, 1] = np.nan, 1.0, 1.0  # the maximum in two slices
    scipy.io.savemat(tmp_path / "b.mat", {"x": values})
    about = describe(tmp_path / "b.mat")
    assert (about["not_finite"], about["max"]) == (3, 1)
    assert about["saturated_share"] == pytest.approx(2 / 620)
    json.dumps(about, allow_nan=False)


def test_a_snapshot_is_a_dataset_with_every_variable(tmp_path):
    variables = {"snapshot": (("y", "x"), np.ones((6, 17))), "aperture": (("slot", "y", "x0"), np.zeros((4, 6, 6)))}
    dataset = xr.Dataset(variables, attrs={"exposure": "equal", "codes": {"slots": 4}})
    about = describe(write_dataset(dataset, tmp_path / "a.nc"))
    assert about["kind"] == "dataset"
    assert about["variables"]["snapshot"]["dims"] == ["y", "x"]
    assert about["variables"]["aperture"]["zero_share"] == 1
    assert about["attrs"]["exposure"] == "equal"


def test_text_and_empty_variables_are_listed_without_statistics(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"x": np.ones((3, 4)), "text": "hello", "none": np.zeros((0, 0))})
    about = describe(tmp_path / "a.mat", "x")
    assert set(about["variables"]) == {"x", "text", "none"}
    assert "min" not in about["variables"]["text"]
    assert about["mean"] == 1
    with pytest.raises(DataError, match=r"no variable 'y'"):
        describe(tmp_path / "a.mat", "y")
