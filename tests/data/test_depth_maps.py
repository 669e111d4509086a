"""Depth maps: unknown pixels counted, files in metres or millimetres, inverse depth mapped exactly."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import scipy.io
import tifffile
import xarray as xr
from PIL import Image

from tests.data.light_field_files import write_pfm
from tmca.data import fitted_depth, label_depth, read_depth_map
from tmca.data.depth_maps import disparity_to_depth, unknown_kinds
from tmca.errors import DataError, SettingError, ShapeError


def drawn(size=(9, 14)):
    """Metres, one pixel of every kind that is unknown."""
    values = np.random.default_rng(0).uniform(0.5, 4, size).astype(np.float32)
    values[0, :4] = 0, -1, np.nan, np.inf
    return values


def test_what_is_unknown_is_counted_and_never_clamped():
    depth = label_depth(drawn(), "here")
    about = depth.attrs
    assert [about[f"unknown_{kind}"] for kind in ("zero", "negative", "not_finite", "pixels")] == [1, 1, 2, 4]
    assert np.isnan(depth.values[0, :4]).all()
    np.testing.assert_array_equal(depth.values[1:], drawn()[1:])
    with pytest.raises(DataError, match=r"here: found no known depth in 6 pixels"):
        label_depth(np.zeros((2, 3)), "here")
    with pytest.raises(ShapeError, match=r"shape \(3,\)"):
        label_depth(np.ones(3), "here")


def write(path, values):
    """A depth map by means of each format's own library; 16-bit PNG and ``whole.tif`` in millimetres."""
    millimetres = np.clip(np.nan_to_num(values, posinf=0), 0, None) * 1000
    if path.suffix == ".npy":
        np.save(path, values)
    elif path.suffix == ".pfm":
        write_pfm(path, values)
    elif path.suffix == ".mat":
        scipy.io.savemat(path, {"depth": values, "other": np.ones((3, 3))})
    elif path.suffix == ".tif":
        tifffile.imwrite(path, millimetres.round().astype(np.uint16) if path.stem == "whole" else values)
    elif path.suffix == ".png":
        Image.fromarray(millimetres.round().astype(np.uint16)).save(path)
    elif path.suffix == ".h5":
        with h5py.File(path, "w") as file:
            file["depth"] = values
    else:
        # Columns before rows: the names of the axes tell.
        array = xr.DataArray(values.T, dims=("x", "y"), name="depth", attrs={"units": "m"})
        array.to_dataset().to_zarr(path, consolidated=False) if path.suffix == ".zarr" else array.to_netcdf(path)


@pytest.mark.parametrize("name", ["d.npy", "d.pfm", "d.mat", "d.tif", "whole.tif", "d.png", "d.h5", "d.nc", "d.zarr"])
@pytest.mark.parametrize("size", [(9, 14), (12, 5)])
def test_a_depth_map_of_every_format_comes_in_metres(tmp_path, name, size):
    write(tmp_path / name, drawn(size))
    depth = read_depth_map(tmp_path / name)
    assert depth.dims == ("y", "x")
    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth.values[1:], drawn(size)[1:], atol=6e-4 if name in ("d.png", "whole.tif") else 1e-7)
    assert depth.attrs["unknown_pixels"] == 4


def test_units_come_from_the_argument_the_file_or_the_type(tmp_path):
    values = np.full((4, 5), 700.0)
    xr.DataArray(values, dims=("y", "x"), name="depth", attrs={"units": "mm"}).to_netcdf(tmp_path / "mm.nc")
    np.testing.assert_allclose(read_depth_map(tmp_path / "mm.nc"), 0.7, rtol=1e-6)
    np.save(tmp_path / "m.npy", values)
    np.testing.assert_allclose(read_depth_map(tmp_path / "m.npy"), 700)
    np.testing.assert_allclose(read_depth_map(tmp_path / "m.npy", scale=1e-3), 0.7, rtol=1e-6)
    np.save(tmp_path / "int.npy", values.astype(np.int32))
    np.testing.assert_allclose(read_depth_map(tmp_path / "int.npy"), 0.7, rtol=1e-6)
    with pytest.raises(SettingError, match="scale"):
        read_depth_map(tmp_path / "m.npy", scale=-1)


def test_what_is_no_depth_map_is_refused(tmp_path):
    for name in ("d.npy", "d.pfm"):
        with pytest.raises(DataError, match=rf"{name}: found no such file"):
            read_depth_map(tmp_path / name)
    Image.fromarray(np.full((4, 5), 9, np.uint8)).save(tmp_path / "d.png")
    with pytest.raises(DataError, match=r"d.png: .*one channel of 16 bits in millimetres"):
        read_depth_map(tmp_path / "d.png")
    scipy.io.savemat(tmp_path / "two.mat", {"a": np.ones((4, 5)), "b": np.ones((4, 5))})
    with pytest.raises(DataError, match=r"two.mat: found no depth map \(a .*, b"):
        read_depth_map(tmp_path / "two.mat")
    np.save(tmp_path / "c.npy", np.ones((4, 5), complex))
    with pytest.raises(DataError, match=r"no depth map"):
        read_depth_map(tmp_path / "c.npy")


def test_disparity_follows_similar_triangles():
    disparity = np.array([[1.0, 7.5, -2.0], [-3.0, np.inf, np.nan]])
    depth = disparity_to_depth(disparity, 900.0, 0.2, 3.0)
    np.testing.assert_allclose(depth[0], [900 * 0.2 / 4, 900 * 0.2 / 10.5, 900 * 0.2 / 1], rtol=1e-12)
    assert np.isnan(depth[1]).all()


@pytest.mark.parametrize("percentiles", [(0, 100), (5, 98)])
@pytest.mark.parametrize("size", [(9, 14), (12, 5)])
def test_inverse_depth_is_mapped_affinely(size, percentiles):
    depth = label_depth(drawn(size), "here")
    fitted, about = fitted_depth(depth, 0.4, 2.0, percentiles=percentiles)
    known = np.isfinite(depth.values)
    inverse = 1 / depth.values[known].astype(np.float64)
    ends = np.percentile(inverse, percentiles)
    truth = 1 / 2.0 + (inverse - ends[0]) / (ends[1] - ends[0]) * (1 / 0.4 - 1 / 2.0)
    np.testing.assert_allclose(1 / fitted.values[known], truth, rtol=1e-6)
    told = about["inverse_depth_scale"] * inverse + about["inverse_depth_shift"]
    np.testing.assert_allclose(told, truth, rtol=1e-12)
    assert np.isnan(fitted.values[~known]).all()
    assert about["unknown_pixels"] == 4
    assert about["outside_pixels"] == np.sum((truth < 0.5 - 1e-9) | (truth > 2.5 + 1e-9))
    assert (about["outside_pixels"] == 0) == (percentiles == (0, 100))
    assert fitted.attrs["inverse_depth_scale"] == about["inverse_depth_scale"]
    np.testing.assert_allclose([about["source_far"], about["source_near"]], 1 / ends)


def test_a_scene_of_one_depth_comes_to_the_middle():
    depth = label_depth(np.full((4, 5), 3.0), "here")
    fitted, about = fitted_depth(depth, 0.5, 2.0)
    np.testing.assert_allclose(fitted, 1 / 1.25, rtol=1e-6)
    assert about["inverse_depth_scale"] == 1


def test_what_falls_behind_infinity_is_unknown():
    values = np.linspace(1, 1.2, 100).reshape(10, 10)
    values[0, 0] = 1000.0
    fitted, about = fitted_depth(label_depth(values, "here"), 0.4, 2.0, percentiles=(10, 100))
    assert np.isnan(fitted.values[0, 0])
    assert about["unknown_pixels"] == 1
    assert about["outside_pixels"] == 10


def test_kinds_of_unknown_pixels_stay_with_them():
    depth = label_depth(np.array([[0.0, -1.0, np.nan, 1.0], [np.inf, 0.0, 2.0, -3.0]]), "map")
    assert unknown_kinds(depth).tolist() == [[1, 2, 3, 0], [3, 1, 0, 2]]
    part = depth.isel(x=slice(1, 3))
    assert unknown_kinds(part).tolist() == [[2, 3], [1, 0]]
    moved = depth.copy(data=np.where(depth.values == 2, np.nan, depth.values))
    assert unknown_kinds(moved).tolist() == [[1, 2, 3, 0], [3, 1, 3, 2]]
    assert "unknown" not in label_depth(np.array([[np.nan, 1.0]]), "map").coords


@pytest.mark.parametrize(
    ("ends", "how", "where"),
    [
        *((ends, {}, "near, far") for ends in ((0, 1), (2, 1), (1, np.inf), (1, 1))),
        ((1, 2), {"percentiles": (50, 50)}, "percentiles"),
    ],
)  # fmt: skip
def test_impossible_ranges_are_refused(ends, how, where):
    with pytest.raises(SettingError) as caught:
        fitted_depth(label_depth(np.ones((2, 2)), "here"), *ends, **how)
    assert caught.value.where == where
