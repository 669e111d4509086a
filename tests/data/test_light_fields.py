"""Light fields from every format: the right view at the right place, in one orientation, in the stored values."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from PIL import Image
from scipy.ndimage import map_coordinates

from tests.data.light_field_files import hci_name, shifted_plane, write_folder, write_pfm, write_png16
from tmca.data import (
    describe,
    label_light_field,
    read,
    read_disparity,
    read_light_field,
    read_split,
    view_shifts,
    write_light_field,
)
from tmca.data.describe import agreement
from tmca.data.formats.images import read_picture
from tmca.data.formats.view_names import find_views
from tmca.errors import DataError

VIEWS = shifted_plane()
NAMES = {
    "hci": hci_name(5),
    "plain": lambda v, u: f"{v}_{u}.png",
    "inria": lambda v, u: f"lf_{v + 1}_{u + 1}.png",
    "padded": lambda v, u: f"scene2_{v:02d}_{u:02d}.png",
    "stride": lambda v, u: f"view_{2 * v}_{2 * u}.png",
    "stanford": lambda v, u: f"out_{v:02d}_{u:02d}_{-380.5 + 40 * v:.6f}_{1100.25 + 40 * u:.6f}.png",
    "stanford trailing": lambda v, u: f"out_{v:02d}_{u:02d}_{-380.5 + 40 * v:.6f}_{1100.25 + 40 * u:.6f}_.png",
    "reversed cameras": lambda v, u: f"cam_{4 - v:02d}_{4 - u:02d}_{-60 + 30.0 * v:.6f}_{-60 + 30.0 * u:.6f}_30_36.png",
}


PATTERNS = {
    "b{column}a{row}.png": lambda v, u: f"b{u}a{v}.png",
    "shot{index}.png": lambda v, u: f"shot{v * 5 + u}.png",
    "*-{row}.{column}.png": lambda v, u: f"tilt{v + u}-{v}.{u}.png",
    "up {-row} {column}.png": lambda v, u: f"up {4 - v} {u}.png",
    "{-row}_{-column}.png": lambda v, u: f"{4 - v}_{4 - u}.png",
}


@pytest.mark.parametrize("name", [*NAMES, *PATTERNS])
def test_every_view_is_where_its_name_or_the_pattern_says(tmp_path, name):
    folder = write_folder(tmp_path / "scene", VIEWS, {**NAMES, **PATTERNS}[name])
    field = read_light_field(folder, pattern=name if name in PATTERNS else None)
    assert field.dims == ("view_v", "view_u", "y", "x")
    assert field.dtype == np.float32
    np.testing.assert_array_equal(field.values, VIEWS.astype(np.float32) / np.float32(255))
    np.testing.assert_array_equal(field.view_v, [-2, -1, 0, 1, 2])
    assert field.attrs["name"] == "scene"
    assert list(field.attrs["grid"]) == [5, 5]


def test_other_pictures_beside_the_views_do_not_matter(tmp_path):
    folder = write_folder(tmp_path, VIEWS, NAMES["inria"])
    for name in ("thumbnail.png", "depth_3_3.png", "mask.png"):
        Image.fromarray(np.zeros((7, 7), np.uint8)).save(folder / name)
    np.testing.assert_allclose(read_light_field(folder).values, VIEWS / 255, atol=1e-6)


def test_the_centre_views_are_those_around_the_middle(tmp_path):
    folder = write_folder(tmp_path, VIEWS, NAMES["plain"])
    field = read_light_field(folder, views=3)
    np.testing.assert_allclose(field.values, VIEWS[1:4, 1:4] / 255, atol=1e-6)
    np.testing.assert_array_equal(field.view_u, [-1, 0, 1])
    even = read_light_field(write_folder(tmp_path / "even", VIEWS[:4, :4], NAMES["plain"]), views=3)
    np.testing.assert_allclose(even.values, VIEWS[1:4, 1:4] / 255, atol=1e-6)


def test_scale_is_a_mean_over_areas_and_crop_the_middle_of_the_result(tmp_path):
    folder = write_folder(tmp_path, VIEWS[..., :39, :47], NAMES["plain"])
    slow = np.array([[VIEWS[2, 3, 3 * i : 3 * i + 3, 3 * j : 3 * j + 3].mean() for j in range(15)] for i in range(13)])
    whole = read_light_field(folder, scale=3)
    assert whole.shape == (5, 5, 13, 15)
    np.testing.assert_allclose(whole.values[2, 3], slow / 255, atol=1e-6)
    np.testing.assert_allclose(
        read_light_field(folder, scale=3, crop=(5, 7)).values[2, 3], slow[4:9, 4:11] / 255, atol=1e-6
    )


def test_grey_is_the_luminance_of_the_stored_values(tmp_path):
    colours = np.random.default_rng(2).integers(0, 256, (3, 3, 8, 9, 3), dtype=np.uint8)
    folder = write_folder(tmp_path, colours, NAMES["plain"])
    colour = read_light_field(folder, colour=True)
    assert colour.dims == ("colour", "view_v", "view_u", "y", "x")
    np.testing.assert_allclose(colour.sel(colour="green"), colours[..., 1] / 255, atol=1e-6)
    grey = colours @ np.array([0.2126, 0.7152, 0.0722]) / 255
    np.testing.assert_allclose(read_light_field(folder), grey, atol=1e-6)


def test_sixteen_bit_colour_keeps_all_its_bits(tmp_path):
    pixels = np.random.default_rng(3).integers(0, 65536, (11, 13, 3), dtype=np.uint16)
    np.testing.assert_array_equal(read_picture(write_png16(tmp_path / "deep.png", pixels)), pixels)
    for v in range(3):
        for u in range(3):
            write_png16(tmp_path / f"{v}_{u}.png", pixels)
    field = read_light_field(tmp_path, colour=True)
    np.testing.assert_allclose(field.values[:, 1, 2], np.moveaxis(pixels, -1, 0) / 65535, atol=1e-7)


def test_a_lenslet_picture_gives_its_lit_centre_views(tmp_path):
    views = np.random.default_rng(4).integers(0, 65536, (14, 14, 6, 5, 3), dtype=np.uint16)
    lenslet = np.empty((6 * 14, 5 * 14, 3), np.uint16)
    for v in range(14):
        for u in range(14):
            lenslet[v::14, u::14] = views[v, u]
    path = write_png16(tmp_path / "flower_eslf.png", lenslet)
    field = read_light_field(path, colour=True)
    np.testing.assert_allclose(np.moveaxis(field.values, 0, -1), views[4:11, 4:11] / 65535, atol=1e-6)
    assert list(field.attrs["grid"]) == [14, 14]
    assert read_light_field(path, views=5).shape == (5, 5, 6, 5)
    np.testing.assert_allclose(read_light_field(path, views=5), read_light_field(path).values[1:6, 1:6], atol=1e-6)
    assert read(path).dims == ("view_v", "view_u", "y", "x")
    assert describe(path)["light_field"]["views"] == [14, 14]
    with pytest.raises(DataError, match=r"flower_eslf.png: found 84×70 pixels .* multiple of the 9×9"):
        read_light_field(path, lens=(9, 9))


@pytest.mark.parametrize("suffix", [".nc", ".h5", ".zarr"])
@pytest.mark.parametrize("colour", [False, True])
def test_a_written_light_field_comes_back(tmp_path, suffix, colour):
    shape = (3, 5, 5, 9, 8) if colour else (5, 5, 9, 8)
    values = np.random.default_rng(6).random(shape, dtype=np.float32)
    path = write_light_field(label_light_field(values, {"name": "mine", "pattern": "made up"}), tmp_path / f"a{suffix}")
    again = read_light_field(path, colour=colour)
    np.testing.assert_array_equal(again.values, values)
    assert again.attrs["name"] == "mine"
    inner = read_light_field(path, views=3, crop=(4, 4), colour=colour)
    np.testing.assert_array_equal(inner.values, values[..., 1:4, 1:4, 2:6, 2:6])
    assert read(path).sizes["view_v"] == 5


def test_of_several_arrays_the_estimate_is_the_light_field(tmp_path):
    values = np.random.default_rng(7).random((2, 3, 3, 6, 6), dtype=np.float32)
    fields = {name: label_light_field(v) for name, v in zip(("estimate", "deviation"), values, strict=True)}
    xr.Dataset(fields).to_netcdf(tmp_path / "e.nc", engine="h5netcdf")
    np.testing.assert_array_equal(read(tmp_path / "e.nc").values, values[0])
    np.testing.assert_array_equal(read(tmp_path / "e.nc", variable="deviation").values, values[1])


@pytest.mark.parametrize("endian", ["<", ">"])
def test_a_pfm_is_read_upright_in_either_byte_order(tmp_path, endian):
    truth = np.random.default_rng(8).normal(size=(12, 17)).astype(np.float32)
    found = read_disparity(write_pfm(tmp_path / "d.pfm", truth, endian))
    assert found.dims == ("y", "x")
    np.testing.assert_array_equal(found.values, truth)


def test_disparity_shrinks_with_the_picture_and_is_never_mixed_across_edges(tmp_path):
    truth = np.where(np.arange(48) < 25, -1.5, 3.0) * np.ones((40, 1))
    folder = write_folder(tmp_path, VIEWS, NAMES["hci"])
    write_pfm(folder / "gt_disp_lowres.pfm", truth)
    small = read_disparity(folder, scale=2, crop=(10, 12))
    assert small.shape == read_light_field(folder, scale=2, crop=(10, 12)).shape[2:]
    assert set(np.unique(small)) == {np.float32(-0.75), np.float32(1.5)}
    np.save(tmp_path / "d.npy", truth.astype(np.float32))
    np.testing.assert_array_equal(read_disparity(tmp_path / "d.npy", scale=2, crop=(10, 12)), small)


def test_shifts_tell_a_reversed_axis(tmp_path):
    views = label_light_field(shifted_plane(3, (96, 96)).astype(np.float32) / 255)
    np.testing.assert_allclose(view_shifts(views), 1, atol=0.05)
    assert agreement(view_shifts(views)) == pytest.approx(1, abs=1e-3)
    turned = view_shifts(views[::-1])
    np.testing.assert_allclose(turned, np.tile([-1.0, 1.0], (len(turned), 1)), atol=0.05)
    path = write_light_field(views[::-1], tmp_path / "t.nc")
    assert "opposite" in describe(path)["note"]


def test_describe_says_what_a_folder_holds(tmp_path):
    folder = write_folder(tmp_path, shifted_plane(5, (64, 64)), NAMES["hci"])
    write_pfm(folder / "gt_disp_lowres.pfm", np.full((64, 64), 1.0))
    about = describe(folder)
    assert about["kind"] == "light field"
    facts = about["light_field"]
    assert facts["views"] == [5, 5]
    assert facts["size"] == [64, 64]
    assert facts["colour"] is False
    assert facts["disparity"] == {"source": "gt_disp_lowres.pfm", "min": 1, "max": 1}
    assert facts["shifts"]["median_rows"] == pytest.approx(1, abs=0.05)
    assert about["max"] == 255


# Real files


@pytest.mark.parametrize(
    ("folder", "shape", "shifts"),
    [
        ("hci_antinous", (9, 9, 256, 256), (-1.6, 1.4)),
        ("lytro_books_5x5_stride2", (5, 5, 217, 312), (-0.4, 0.7)),
        ("blender_shop_9x9", (9, 9, 320, 480), (0.1, 2.9)),
    ],
)
def test_real_light_fields_have_one_sign_of_disparity_along_both_axes(real_data, folder, shape, shifts):
    path = real_data / "lf" / folder
    field = read_light_field(path, views=3, scale=2)
    assert list(field.attrs["grid"]) == list(shape[:2])
    assert field.shape == (3, 3, *shape[2:])
    assert 0 <= float(field.min()) < float(field.max()) <= 1
    found = view_shifts(field)
    assert agreement(found) > 0.7
    low, high = np.percentile(found, [5, 95])
    assert shifts[0] < low < high < shifts[1]


def test_true_disparity_brings_real_views_onto_the_centre_view(real_data):
    folder = real_data / "lf/hci_antinous"
    field, truth = read_light_field(folder, views=5, crop=(200, 200)), read_disparity(folder, crop=(200, 200)).values
    y, x = np.mgrid[:200, :200]
    centre = field.values[2, 2]
    for v, u in ((-2, 0), (0, 2), (1, -1)):
        view = field.values[2 + v, 2 + u]
        errors = [
            np.median(abs(map_coordinates(view, [y - s * v * truth, x - t * u * truth], order=3) - centre))
            for s, t in ((1, 1), (-1, -1))
        ]
        assert errors[0] < 0.4 * errors[1]


@pytest.mark.slow
def test_light_field_splits_hold(real_data):
    train, test = (read_split(real_data / "splits" / f"light_field_{part}.txt") for part in ("train", "test"))
    assert train
    assert test
    assert not set(train) & set(test)
    for folder in train + test:
        assert find_views(folder) is not None
        assert describe(folder)["kind"] == "light field"
