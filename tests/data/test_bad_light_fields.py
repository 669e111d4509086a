"""Light fields that cannot be used: the error names the file or the argument at fault."""

from __future__ import annotations

import re

import numpy as np
import pytest
import xarray as xr
from PIL import Image

from tests.data.light_field_files import hci_name, shifted_plane, write_folder, write_parameters, write_pfm
from tmca.data import label_light_field, read, read_disparity, read_light_field, write_light_field
from tmca.errors import DataError, SettingError, ShapeError

VIEWS = shifted_plane()


def plain(folder, views=VIEWS):
    return write_folder(folder / "bad", views, lambda v, u: f"{v}_{u}.png")


def hci(folder, **parameters):
    bad = write_folder(folder / "bad", VIEWS, hci_name(5))
    if parameters:
        write_parameters(bad, **parameters)
    return bad


def replaced(bad, name, pixels):
    Image.fromarray(pixels).save(bad / name)


def edited(bad, old, new):
    file = bad / "parameters.cfg"
    file.write_text(file.read_text().replace(old, new))


def without(bad, *names):
    for name in names:
        (bad / name).unlink()
    return bad


def cut(file, size):
    file.write_bytes(file.read_bytes()[:size])


def nothing(bad):
    bad.mkdir()
    (bad / "notes.txt").write_text("hello")


ONE = VIEWS[0, 0]
SPOILT = {
    "a view missing": (lambda f: without(plain(f), "1_3.png"), "bad", "row 1 column 3"),
    "a row missing": (lambda f: without(plain(f), *(f"2_{u}.png" for u in range(5))), "bad", "row 2"),
    "a view too many": (lambda f: replaced(plain(f), "5_0.png", ONE), "bad", "row 5 column 1"),
    "a view twice": (lambda f: replaced(plain(f), "00_00.png", ONE), "bad/0_0.png", "second picture"),
    "a number missing": (lambda f: without(hci(f), "input_Cam017.png"), "bad", "number 17"),
    "a number too many": (lambda f: replaced(hci(f), "input_Cam025.png", ONE), "bad", "number 25"),
    "another size": (lambda f: replaced(plain(f), "3_2.png", ONE[:-1]), "bad/3_2.png", "39×48"),
    "another depth": (lambda f: replaced(plain(f), "3_2.png", ONE.astype(np.uint16)), "bad/3_2.png", "uint16"),
    "other colours": (lambda f: replaced(plain(f), "3_2.png", np.stack([ONE] * 3, -1)), "bad/3_2.png", "(40, 48, 3)"),
    "a broken view": (lambda f: cut(plain(f) / "3_2.png", 300), "bad/3_2.png", "truncated"),
    "no picture": (lambda f: (plain(f) / "3_2.png").write_text("hello"), "bad/3_2.png", "unreadable"),
    "an empty view": (lambda f: cut(plain(f) / "3_2.png", 0), "bad/3_2.png", "empty"),
    "an even grid": (lambda f: plain(f, VIEWS[:4, :4]), "bad", "4×4"),
    "an oblong grid": (lambda f: plain(f, VIEWS[:3]), "bad", "3×5"),
    "no numbers": (lambda f: hci(f, without=("num_cams_x", "baseline_mm")), "bad/parameters.cfg", "baseline_mm"),
    "no text": (lambda f: (hci(f) / "parameters.cfg").write_bytes(b"\xff\xfe"), "bad/parameters.cfg", "UTF-8 text"),
    "another resolution": (lambda f: hci(f, size=(512, 512)), "bad/parameters.cfg", "512×512"),
    "another grid": (lambda f: hci(f, side=9), "bad", "9×9 grid"),
    "another grid of names": (lambda f: write_parameters(plain(f), side=9), "bad/parameters.cfg", "num_cams_y = 9"),
    "a stated grid": (
        lambda f: edited(without(hci(f, side=9), "input_Cam017.png"), "num_cams_y = 9", "num_cams_y = 3"),
        "bad", "3×9",
    ),
    "no views": (lambda f: nothing(f / "bad"), "bad", "band images or views"),
}  # fmt: skip


@pytest.mark.parametrize("name", SPOILT)
@pytest.mark.parametrize("reader", [read_light_field, read])
def test_folders_that_cannot_be_used(tmp_path, name, reader):
    spoil, where, said = SPOILT[name]
    spoil(tmp_path)
    with pytest.raises(DataError) as caught:
        reader(tmp_path / "bad")
    assert caught.value.where == str(tmp_path / where)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("options", "where"),
    [
        *(({"views": views}, "views") for views in (4, 0, 7)), *(({"scale": scale}, "scale") for scale in (0, 1.5)),
        ({"crop": (41, 48)}, "crop"), ({"crop": (30, 30), "scale": 2}, "crop"), ({"pattern": "view.png"}, "pattern"),
        ({"pattern": "{row}_{row}_{column}.png"}, "pattern"),
    ],
)  # fmt: skip
def test_impossible_wishes(tmp_path, options, where):
    with pytest.raises(SettingError) as caught:
        read_light_field(plain(tmp_path), **options)
    assert caught.value.where == where


LENGTHS = ("focal_length_mm", "sensor_size_mm", "baseline_mm", "focus_distance_m")


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        *(("num_cams_x", count, "a whole number of views from 1") for count in ("nan", "inf", "0", "5.5", "1e+30")),
        *((name, length, "a finite length above 0") for name in LENGTHS for length in ("nan", "inf", "0", "-5")),
    ],
)
def test_impossible_parameters_are_refused(tmp_path, name, value, expected):
    folder = hci(tmp_path, without=(name,))
    edited(folder, "num_cams_y", f"{name} = {value}\nnum_cams_y")
    with pytest.raises(DataError, match=re.escape(f"{name} = {value}, expected {expected}")) as caught:
        read_light_field(folder)
    assert caught.value.where == str(folder / "parameters.cfg")


def test_what_a_folder_does_not_have_is_refused(tmp_path):
    folder = plain(tmp_path)
    for options in ({"pattern": "view_{row}_{column}.png"}, {"colour": True}):
        with pytest.raises(DataError, match=folder.name):
            read_light_field(folder, **options)
    with pytest.raises(SettingError) as refusal:
        read(folder, wavelengths=[400e-9])
    assert refusal.value.where == "wavelengths"


def test_a_light_field_with_nan_is_refused(tmp_path):
    values = np.ones((3, 3, 4, 4), np.float32)
    values[1, 2, 3, 0] = np.nan
    path = write_light_field(label_light_field(values), tmp_path / "n.nc")
    with pytest.raises(DataError, match="1 NaN pixel, the first at view row 1, column 2, y 3, x 0"):
        read_light_field(path)


def test_what_is_no_light_field_is_not_written(tmp_path):
    with pytest.raises(ShapeError, match="dims"):
        write_light_field(xr.DataArray(np.zeros((2, 2))), tmp_path / "x.nc")
    with pytest.raises(ShapeError, match="shape"):
        label_light_field(np.zeros((2, 5, 5, 4, 4)))


def test_a_disparity_that_does_not_fit_is_refused(tmp_path):
    folder = hci(tmp_path)
    file = folder / "gt_disp_lowres.pfm"
    for spoil, where in (
        (lambda: None, folder),
        (lambda: write_pfm(file, np.zeros((20, 24))), file),
        (lambda: cut(file, file.stat().st_size - 8), file),
        (lambda: write_pfm(file, np.full((40, 48), np.inf)), file),
    ):
        spoil()
        with pytest.raises(DataError) as caught:
            read_disparity(folder)
        assert caught.value.where == str(where)
