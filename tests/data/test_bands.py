"""Band selection takes the nearest band, once, within the cube's range."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from tmca.data import label, load_scene, metres_to_nm, nearest_bands, nm_to_metres, select_bands, write_dataset
from tmca.errors import DataError, SettingError
from tmca.plots.cube import false_colour
from tmca.specs import BandsReading


def cube_of(nm):
    nm = np.asarray(nm, dtype=float)
    return label(np.zeros((nm.size, 2, 3), dtype=np.float32), nm_to_metres(nm))


CAVE = cube_of(np.arange(400, 701, 10))


def test_twelve_bands_of_cave_are_the_usual_ones():
    index = np.linspace(0, 30, 12).round().astype(int)
    xr.testing.assert_equal(select_bands(CAVE, 12), CAVE[index])


@pytest.mark.parametrize("count", [1, 2, 4, 7, 11, 16, 31])
def test_selection_is_nearest_to_even_spacing(count):
    chosen = select_bands(CAVE, count).wavelength_nm.values
    targets = np.linspace(400, 700, count) if count > 1 else np.array([550.0])
    assert chosen.size == count
    assert np.abs(chosen - targets).max() <= 5 + 1e-9


def test_order_of_the_bands_in_the_file_does_not_matter():
    backwards = CAVE.isel(wavelength=slice(None, None, -1))
    xr.testing.assert_equal(select_bands(backwards, 12), select_bands(CAVE, 12))


@given(st.lists(st.integers(4000, 7000), min_size=1, max_size=8))
def test_nearest_band_is_nearest_or_two_share_one(tenths):
    targets, nm = np.array(tenths) / 10, np.arange(400.0, 701.0, 10.0)
    nearest = np.abs(nm[None] - targets[:, None]).argmin(axis=1)
    if np.unique(nearest).size < targets.size:
        with pytest.raises(SettingError, match=r"different bands are nearest"):
            nearest_bands(CAVE, nm_to_metres(targets))
    else:
        np.testing.assert_array_equal(nearest_bands(CAVE, nm_to_metres(targets)).wavelength_nm, nm[nearest])


def test_half_a_band_beyond_the_last_centre_is_covered():
    samson = cube_of(np.linspace(401, 889, 156))
    assert select_bands(samson, 12).wavelength_nm.values[0] == 401


@given(st.floats(100, 20000))
def test_nanometres_and_metres_are_inverse_to_the_last_bit(nm):
    nm = round(nm, 6)
    assert metres_to_nm(nm_to_metres(nm)) == nm
    assert nm_to_metres(metres_to_nm(nm_to_metres(nm))) == nm_to_metres(nm)


UNEVEN = cube_of([429.5, 442.5, 456, 471.5, 489.5, 510.5, 534, 562, 598, 646, 687])


@pytest.mark.parametrize(
    ("call", "error"),
    [
        (lambda: select_bands(CAVE, 40), SettingError), (lambda: nearest_bands(CAVE, [400e-9, 401e-9]), SettingError),
        (lambda: select_bands(UNEVEN, 4), DataError), (lambda: select_bands(CAVE, 0), SettingError),
        (lambda: nearest_bands(CAVE, []), SettingError),
        (lambda: select_bands(CAVE.drop_vars(["wavelength", "wavelength_nm"]), 3), DataError),
    ],
)  # fmt: skip
def test_bands_that_are_not_there_are_refused(call, error):
    with pytest.raises(error):
        call()


@pytest.mark.parametrize("count", [7, 8, 11])
def test_bands_of_uneven_spacing_are_all_taken_as_they_are(count):
    chosen = select_bands(UNEVEN, count, (429.5e-9, 687e-9))
    assert len({*chosen.wavelength_nm.values.tolist()}) == count
    if count == 11:
        xr.testing.assert_equal(chosen, UNEVEN)
        xr.testing.assert_equal(select_bands(UNEVEN[::-1], 11, (429.5e-9, 687e-9)), UNEVEN)


@pytest.mark.parametrize(("count", "remedy"), [(9, "ask for 8, or for all 11"), (10, "ask for 8, or for all 11"),
                                               (12, "ask for 11"), (10**6, "ask for 11")])  # fmt: skip
def test_the_remedy_of_bands_that_are_not_there_works(count, remedy):
    with pytest.raises(SettingError, match=f"no {count} different bands.*; {remedy}$"):
        select_bands(UNEVEN, count, (429.5e-9, 687e-9))


NEAR = cube_of(np.arange(700, 1001, 20))


def test_bands_are_taken_from_the_range_that_is_asked_for(tmp_path):
    assert select_bands(NEAR, 4, (700e-9, 1000e-9)).wavelength_nm.values == pytest.approx([700, 800, 900, 1000])
    write_dataset(NEAR.to_dataset(name="cube") + 0.5, tmp_path / "near.nc")
    inside = load_scene(tmp_path / "near.nc", range=(750e-9, 850e-9))
    assert metres_to_nm(inside["wavelength"].values) == pytest.approx([760, 780, 800, 820, 840])
    assert load_scene(tmp_path / "near.nc", bands=3, range=(700e-9, 900e-9)).sizes["wavelength"] == 3
    with pytest.raises(DataError, match="--range"):
        load_scene(tmp_path / "near.nc", bands=4)
    with pytest.raises(DataError, match="within 400 to 500 nm"):
        load_scene(tmp_path / "near.nc", bands=None, range=(400e-9, 500e-9))
    with pytest.raises(SettingError, match="first below the last"):
        load_scene(tmp_path / "near.nc", range=(900e-9, 700e-9))


def test_a_range_is_written_in_nm():
    assert BandsReading(range="400:1000").range == pytest.approx((400e-9, 1000e-9))
    for text in ("400", "700:400", "a:b", "0:500"):
        with pytest.raises((SettingError, ValueError), match="FIRST"):
            BandsReading(range=text)


def test_colours_that_no_eye_sees_are_called_false():
    assert false_colour(CAVE["wavelength"].values) == ""
    assert false_colour(NEAR["wavelength"].values).startswith("false colour: 940 nm as red, 860 nm as green")
    assert false_colour([550e-9]) != ""
