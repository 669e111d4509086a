"""Light fields that cannot be used: the message names what is wrong and what to do about it."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from PIL import Image

from tests.data.light_field_files import hci_name, shifted_plane, write_folder, write_parameters, write_pfm
from tmca.data import label_light_field, read, read_disparity, read_light_field, write_light_field
from tmca.errors import DataError, SettingError, ShapeError

VIEWS = shifted_plane()
NAMES = {"hci": hci_name(5), "plain": lambda v, u: f"{v}_{u}.png"}


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


def other_colours(folder):
    Image.fromarray(np.stack([VIEWS[3, 2]] * 3, axis=-1)).save(plain(folder) / "3_2.png")


def broken(folder):
    file = plain(folder) / "3_2.png"
    file.write_bytes(file.read_bytes()[:300])


def no_picture(folder):
    (plain(folder) / "3_2.png").write_text("hello")


def empty(folder):
    (plain(folder) / "3_2.png").write_bytes(b"")


def even(folder):
    plain(folder, VIEWS[:4, :4])


def oblong(folder):
    plain(folder, VIEWS[:3])


def no_keys(folder):
    write_parameters(write_folder(folder / "bad", VIEWS, NAMES["hci"]), without=("num_cams_x", "baseline_mm"))


def no_text(folder):
    (write_folder(folder / "bad", VIEWS, NAMES["hci"]) / "parameters.cfg").write_bytes(b"\xff\xfe")


def other_size(folder):
    write_parameters(write_folder(folder / "bad", VIEWS, NAMES["hci"]), size=(512, 512))


def other_grid(folder):
    write_parameters(write_folder(folder / "bad", VIEWS, NAMES["hci"]), side=9)


def other_named_grid(folder):
    write_parameters(plain(folder), side=9)


def stated_grid(folder):
    hci_missing(folder)
    write_parameters(folder / "bad", side=9)
    file = folder / "bad" / "parameters.cfg"
    file.write_text(file.read_text().replace("num_cams_y = 9", "num_cams_y = 3"))


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
        (other_depth, r"3_2.png: found grey .*uint16, expected .*uint8 as in the first view; save all views"),
        (other_colours, r"3_2.png: found colour .*expected grey"),
        (broken, r"3_2.png: found an unreadable or truncated PNG .*, expected a whole PNG; fetch"),
        (no_picture, r"3_2.png: found an unreadable or truncated PNG .*, expected a whole PNG; fetch"),
        (empty, r"3_2.png: found an empty file"),
        (even, r"found 4×4 views.*n odd, with views= .*such as 3"),
        (oblong, r"found 3×5 views.*such as 3"),
        (no_keys, r"parameters.cfg: found no number for \[extrinsics\] num_cams_x, \[extrinsics\] baseline_mm"),
        (no_text, r"parameters.cfg: found an unreadable .*; fetch it again, or take it away"),
        (other_size, r"parameters.cfg: found a resolution of 512×512 pixels .* expected 40×48.*; correct it"),
        (other_grid, r"parameters.cfg: found num_cams_y = 9 and num_cams_x = 9, expected 5 and 5, as the 25 views"),
        (other_named_grid, r"parameters.cfg: found num_cams_y = 9 and num_cams_x = 9, expected 5 and 5, as the 25"),
        (stated_grid, r"bad: found 24 views, without number 17.*expected 3×9 views .* as parameters.cfg says; add"),
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
        ({"views": 7}, r"views: found 7 of the 5×5 views of .*bad, expected an odd number, at most 5; give views=5"),
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
    with pytest.raises(DataError, match=r"truncated.*expected a whole PFM; fetch"):
        read_disparity(folder)
    write_pfm(file, np.full((40, 48), np.inf))
    with pytest.raises(DataError, match=r"1920 NaN or infinite.*; mend the map"):
        read_disparity(folder)
