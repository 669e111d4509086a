"""Light fields from every format: the right view at the right place, in one orientation, in the stored values."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from PIL import Image
from scipy.ndimage import map_coordinates

from tests.data.light_field_files import (
    hci_name,
    shifted_plane,
    write_folder,
    write_parameters,
    write_pfm,
    write_png16,
)
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
from tmca.data.formats.images import read_picture
from tmca.data.formats.view_names import find_views
from tmca.data.shifts import agreement
from tmca.errors import DataError, SettingError, ShapeError

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


@pytest.mark.parametrize("name", NAMES)
def test_every_view_is_where_its_name_says(tmp_path, name):
    field = read_light_field(write_folder(tmp_path / "scene", VIEWS, NAMES[name]))
    assert field.dims == ("view_v", "view_u", "y", "x")
    assert field.dtype == np.float32
    np.testing.assert_array_equal(field.values, VIEWS.astype(np.float32) / np.float32(255))
    np.testing.assert_array_equal(field.view_v, [-2, -1, 0, 1, 2])
    assert field.attrs["name"] == "scene"
    assert list(field.attrs["grid"]) == [5, 5]


def test_the_centre_view_is_seen_displaced_by_the_disparity_in_every_other(tmp_path):
    field = read_light_field(write_folder(tmp_path, VIEWS, NAMES["plain"]))
    centre = field.sel(view_v=0, view_u=0).values
    for v in (-2, 1):
        for u in (-1, 2):
            view = field.sel(view_v=v, view_u=u).values
            for y, x in ((10, 10), (25, 30)):
                assert view[y - v, x - u] == centre[y, x]


def test_other_pictures_beside_the_views_do_not_matter(tmp_path):
    folder = write_folder(tmp_path, VIEWS, NAMES["inria"])
    for name in ("thumbnail.png", "depth_3_3.png", "mask.png"):
        Image.fromarray(np.zeros((7, 7), np.uint8)).save(folder / name)
    np.testing.assert_allclose(read_light_field(folder).values, VIEWS / 255, atol=1e-6)


@pytest.mark.parametrize(
    ("pattern", "name"),
    [
        ("b{column}a{row}.png", lambda v, u: f"b{u}a{v}.png"),
        ("shot{index}.png", lambda v, u: f"shot{v * 5 + u}.png"),
        ("*-{row}.{column}.png", lambda v, u: f"tilt{v + u}-{v}.{u}.png"),
        ("up {-row} {column}.png", lambda v, u: f"up {4 - v} {u}.png"),
        ("{-row}_{-column}.png", lambda v, u: f"{4 - v}_{4 - u}.png"),
    ],
)
def test_a_pattern_names_rows_and_columns(tmp_path, pattern, name):
    folder = write_folder(tmp_path / "s", VIEWS, name)
    np.testing.assert_allclose(read_light_field(folder, pattern=pattern).values, VIEWS / 255, atol=1e-6)


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


def test_jpeg_views_are_read(tmp_path):
    smooth = np.broadcast_to(np.linspace(20, 200, 32)[:, None], (3, 3, 32, 32)).astype(np.uint8)
    folder = write_folder(tmp_path, smooth, lambda v, u: f"a_{v}_{u}.jpg")
    np.testing.assert_allclose(read_light_field(folder), smooth / 255, atol=0.02)


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


def test_another_lens_grid_is_read_when_it_is_given(tmp_path):
    lenslet = np.random.default_rng(5).integers(0, 256, (15, 20), dtype=np.uint8)
    Image.fromarray(lenslet).save(tmp_path / "lens.png")
    field = read_light_field(tmp_path / "lens.png", lens=(5, 5))
    np.testing.assert_allclose(field.values[1, 3], lenslet[1::5, 3::5] / 255, atol=1e-6)


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


def test_parameters_of_the_benchmark_are_kept_in_metres(tmp_path):
    folder = write_folder(tmp_path, VIEWS, NAMES["hci"])
    write_parameters(folder)
    attrs = read_light_field(folder).attrs
    assert attrs["baseline_m"] == pytest.approx(0.05)
    assert attrs["focus_distance_m"] == pytest.approx(10)


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


# Bad input


def plain(folder, views=VIEWS):
    return write_folder(folder / "bad", views, NAMES["plain"])


def missing(folder):
    (plain(folder) / "1_3.png").unlink()


def missing_row(folder):
    bad = plain(folder)
    for u in range(5):
        (bad / f"2_{u}.png").unlink()


def extra(folder):
    Image.fromarray(VIEWS[0, 0]).save(plain(folder) / "5_0.png")


def twice(folder):
    Image.fromarray(VIEWS[0, 0]).save(plain(folder) / "00_00.png")


def hci_missing(folder):
    (write_folder(folder / "bad", VIEWS, NAMES["hci"]) / "input_Cam017.png").unlink()


def hci_extra(folder):
    Image.fromarray(VIEWS[0, 0]).save(write_folder(folder / "bad", VIEWS, NAMES["hci"]) / "input_Cam025.png")


def unequal(folder):
    Image.fromarray(VIEWS[0, 0, :-1]).save(plain(folder) / "3_2.png")


def other_depth(folder):
    Image.fromarray(VIEWS[0, 0].astype(np.uint16)).save(plain(folder) / "3_2.png")


def broken(folder):
    file = plain(folder) / "3_2.png"
    file.write_bytes(file.read_bytes()[:300])


def no_picture(folder):
    (plain(folder) / "3_2.png").write_text("hello")


def even(folder):
    plain(folder, VIEWS[:4, :4])


def oblong(folder):
    plain(folder, VIEWS[:3])


def no_keys(folder):
    write_parameters(write_folder(folder / "bad", VIEWS, NAMES["hci"]), without=("num_cams_x", "baseline_mm"))


def other_size(folder):
    write_parameters(write_folder(folder / "bad", VIEWS, NAMES["hci"]), size=(512, 512))


def other_grid(folder):
    write_parameters(write_folder(folder / "bad", VIEWS, NAMES["hci"]), side=9)


def no_views(folder):
    (folder / "bad").mkdir()
    (folder / "bad" / "notes.txt").write_text("hello")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (missing, r"24 views on a grid of 5 rows and 5 columns, none for row 1 column 3"),
        (missing_row, r"none for row 2"),
        (extra, r"26 views .*none for row 5 column 1"),
        (twice, r"second picture of one view"),
        (hci_missing, r"24 views, without number 17, expected 5×5 views"),
        (hci_extra, r"26 views, with number 25 too, expected 5×5 views"),
        (unequal, r"3_2.png: found 39×48 pixels .* expected 40×48"),
        (other_depth, r"3_2.png: .*uint16.* expected .*uint8"),
        (broken, r"3_2.png: found an unreadable or truncated image"),
        (no_picture, r"3_2.png: found an unreadable or truncated image"),
        (even, r"found 4×4 views.*n odd, with views= .*such as 3"),
        (oblong, r"found 3×5 views.*such as 3"),
        (no_keys, r"parameters.cfg: found no number for \[extrinsics\] num_cams_x, \[extrinsics\] baseline_mm"),
        (other_size, r"parameters.cfg: found 512×512 px, expected 48×40"),
        (other_grid, r"25 views, without number 25, 26, 27 and 53 more, expected 9×9"),
        (no_views, r"a folder without band images or views"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_folders_that_cannot_be_used(tmp_path, spoil, words):
    spoil(tmp_path)
    with pytest.raises(DataError, match=words):
        read_light_field(tmp_path / "bad")
    with pytest.raises(DataError, match=words):
        read(tmp_path / "bad")


@pytest.mark.parametrize("count", ["nan", "inf", "0", "5.5", "1e30"])
def test_an_impossible_number_of_cameras_is_refused(tmp_path, count):
    folder = write_folder(tmp_path / "bad", VIEWS, NAMES["hci"])
    write_parameters(folder, without=("num_cams_x",))
    text = (folder / "parameters.cfg").read_text()
    (folder / "parameters.cfg").write_text(text.replace("num_cams_y", f"num_cams_x = {count}\nnum_cams_y"))
    with pytest.raises(DataError, match=r"parameters.cfg: found num_cams_x = .*a whole number of views from 1 to"):
        read_light_field(folder)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"views": 4}, r"views: found 4, expected an odd number"),
        ({"views": 0}, r"views: found 0"),
        ({"views": 7}, r"views: found 7, expected odd, at most 5"),
        ({"crop": (41, 48)}, r"crop: found 41×48, expected at most the 40×48"),
        ({"crop": (30, 30), "scale": 2}, r"expected at most the 20×24"),
        ({"scale": 0}, r"scale: found 0"),
        ({"scale": 1.5}, r"scale: found 1.5"),
        ({"pattern": "view.png"}, r"pattern: found 'view.png', expected \{row\} and \{column\}"),
        ({"pattern": "{row}_{row}_{column}.png"}, r"once each"),
    ],
)
def test_impossible_wishes(tmp_path, options, words):
    with pytest.raises(SettingError, match=words):
        read_light_field(plain(tmp_path), **options)


def test_a_pattern_that_no_file_has(tmp_path):
    with pytest.raises(DataError, match="no picture with such a name"):
        read_light_field(plain(tmp_path), pattern="view_{row}_{column}.png")


def test_colour_of_grey_views_is_refused(tmp_path):
    with pytest.raises(DataError, match="grey views"):
        read_light_field(plain(tmp_path), colour=True)


def test_wavelengths_make_no_sense_for_a_light_field(tmp_path):
    with pytest.raises(SettingError, match="light field"):
        read(plain(tmp_path), wavelengths=[400e-9])


def test_a_light_field_with_nan_is_refused(tmp_path):
    values = np.ones((3, 3, 4, 4), np.float32)
    values[1, 2, 3, 0] = np.nan
    path = write_light_field(label_light_field(values), tmp_path / "n.nc")
    with pytest.raises(DataError, match="1 NaN or infinite pixels, the first at view row 1, column 2, y 3, x 0"):
        read_light_field(path)


def test_what_is_no_light_field_is_not_written(tmp_path):
    with pytest.raises(ShapeError, match="dims"):
        write_light_field(xr.DataArray(np.zeros((2, 2))), tmp_path / "x.nc")
    with pytest.raises(ShapeError, match="shape"):
        label_light_field(np.zeros((2, 5, 5, 4, 4)))


def test_a_disparity_that_does_not_fit_is_refused(tmp_path):
    folder = write_folder(tmp_path, VIEWS, NAMES["hci"])
    with pytest.raises(DataError, match="no disparity map"):
        read_disparity(folder)
    file = write_pfm(folder / "gt_disp_lowres.pfm", np.zeros((20, 24)))
    with pytest.raises(DataError, match=r"gt_disp_lowres.pfm: found 20×24 pixels .* expected 40×48"):
        read_disparity(folder)
    file.write_bytes(file.read_bytes()[:-8])
    with pytest.raises(DataError, match="truncated"):
        read_disparity(folder)
    write_pfm(file, np.full((40, 48), np.inf))
    with pytest.raises(DataError, match="1920 NaN or infinite"):
        read_disparity(folder)


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


def test_in_the_real_capture_the_foreground_is_nearer(real_data):
    field = read_light_field(real_data / "lf/lytro_books_5x5_stride2")
    board, wall = field[:, :, 100:300, 180:430], field[:, :, 20:160, 480:600]
    assert np.median(view_shifts(board)) > np.median(view_shifts(wall)) + 0.4


def test_light_field_splits_hold(real_data):
    train, test = (read_split(real_data / "splits" / f"light_field_{part}.txt") for part in ("train", "test"))
    assert train
    assert test
    assert not set(train) & set(test)
    for folder in train + test:
        assert find_views(folder) is not None
        assert describe(folder)["kind"] == "light field"
