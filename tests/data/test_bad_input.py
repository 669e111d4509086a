"""Whatever is wrong with a file, one line names the file, what was found, and what to do."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st

from tmca.data import describe, nm_to_metres, read, read_array, read_dataset, write_dataset
from tmca.errors import DataError, SettingError


@pytest.fixture
def whole(cube, tmp_path):
    """One whole file of each format, by suffix."""
    values = np.random.default_rng(0).random((12, 14, 31))
    scipy.io.savemat(tmp_path / "five.mat", {"x": values}, do_compression=True)
    scipy.io.savemat(tmp_path / "plain.mat", {"x": values})
    with h5py.File(tmp_path / "seven.mat", "w", userblock_size=512) as file:
        file["x"] = values.T
    np.save(tmp_path / "a.npy", values)
    write_dataset(cube, tmp_path / "a.nc")
    return [tmp_path / name for name in ("five.mat", "plain.mat", "seven.mat", "a.npy", "a.nc")]


@pytest.mark.parametrize("share", [0.0, 0.001, 0.01, 0.1, 0.3, 0.5, 0.9, 0.99])
def test_a_truncated_file_is_named_in_one_line(whole, share):
    for path in whole:
        content = path.read_bytes()
        path.write_bytes(content[: int(share * len(content))])
        with pytest.raises(DataError) as error:
            read(path)
        assert str(path) in str(error.value)
        assert "\n" not in str(error.value)
        path.write_bytes(content)


@pytest.mark.parametrize("compression", [None, "zlib"])
def test_a_cut_tiff_is_an_error_or_has_every_pixel(cube, tmp_path, compression):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, cube.values, photometric="minisblack", compression=compression)
    content, metres, refused = path.read_bytes(), cube.wavelength.values, 0
    for size in np.linspace(1, len(content) - 1, 97).astype(int):
        path.write_bytes(content[:size])
        try:
            np.testing.assert_array_equal(read(path, wavelengths=metres), cube)
        except DataError:
            refused += 1
    assert refused > 50


@settings(max_examples=60, deadline=None)
@given(junk=st.binary(min_size=1, max_size=400), suffix=st.sampled_from([".mat", ".npy", ".nc", ".h5", ".tif", ".png"]))
def test_bytes_that_are_no_file_are_refused(tmp_path_factory, junk, suffix):
    path = tmp_path_factory.mktemp("junk") / f"a{suffix}"
    path.write_bytes(junk)
    for action in (read, read_array, describe):
        with pytest.raises(DataError):
            action(path)


@settings(max_examples=60, deadline=None)
@given(place=st.floats(0, 1), byte=st.integers(0, 255))
def test_a_damaged_byte_gives_data_or_a_clear_error(tmp_path_factory, place, byte):
    path = tmp_path_factory.mktemp("damage") / "a.mat"
    scipy.io.savemat(path, {"x": np.full((5, 6, 31), 0.5), "y": np.ones(3)}, do_compression=True)
    content = bytearray(path.read_bytes())
    content[int(place * (len(content) - 1))] = byte
    path.write_bytes(content)
    with suppress(DataError):
        cube = read(path)
        assert cube.dims == ("wavelength", "y", "x")
        assert np.isfinite(cube).all()


def test_missing_empty_and_unknown(tmp_path):
    with pytest.raises(DataError, match=r"no such file or folder"):
        read(tmp_path / "gone.mat")
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match=r"an empty folder.*_ms_01.png"):
        read(tmp_path / "empty")
    (tmp_path / "empty" / "notes.txt").write_text("x")
    with pytest.raises(DataError, match=r"a folder without band images"):
        read(tmp_path / "empty")
    (tmp_path / "a.xyz").write_text("x")
    with pytest.raises(DataError, match=r"unknown suffix '.xyz'.*\.mat"):
        read(tmp_path / "a.xyz")
    (tmp_path / "a.zarr").mkdir()
    with pytest.raises(DataError, match=r"a\.zarr"):
        read(tmp_path / "a.zarr")


def test_a_file_without_permission_is_named(tmp_path, monkeypatch):
    scipy.io.savemat(tmp_path / "a.mat", {"x": np.zeros((5, 6, 31))})

    def refuse(self, *args, **kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(DataError, match=r"a\.mat: found no permission to read it"):
        read(tmp_path / "a.mat")


def test_objects_in_npy_are_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(DataError, match=r"allow_pickle|object"):
        read(tmp_path / "a.npy")


def test_a_file_without_wavelengths_says_three_ways_out(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"x": np.zeros((20, 22, 9))})
    with pytest.raises(
        DataError, match=r"a\.mat: found 9 bands.*wavelengths=.*--wavelengths.*a\.mat\.wavelengths\.txt"
    ):
        read(tmp_path / "a.mat")
    (tmp_path / "a.mat.wavelengths.txt").write_text("400 410 420")
    with pytest.raises(DataError, match=r"found 3 wavelengths from the sidecar file for 9 bands"):
        read(tmp_path / "a.mat")
    (tmp_path / "a.mat.wavelengths.txt").write_text("400\n410\nviolet\n")
    with pytest.raises(DataError, match=r"violet"):
        read(tmp_path / "a.mat")
    (tmp_path / "a.mat.wavelengths.txt").write_text("0.4 0.5 0.6")
    with pytest.raises(DataError, match=r"from 0.4 to 0.6, expected wavelengths in nm"):
        read(tmp_path / "a.mat")


def test_wavelengths_argument_of_wrong_count_unit_or_value(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"x": np.zeros((20, 22, 31))})
    with pytest.raises(DataError, match=r"found 12 wavelengths from wavelengths= for 31 bands"):
        read(tmp_path / "a.mat", wavelengths=nm_to_metres(np.linspace(400, 700, 12)))
    with pytest.raises(SettingError, match=r"from 400 to 700, expected metres"):
        read(tmp_path / "a.mat", wavelengths=np.linspace(400, 700, 31))
    with pytest.raises(DataError, match=r"the same wavelength twice"):
        read(tmp_path / "a.mat", wavelengths=[5e-7] * 31)
    with pytest.raises(DataError, match=r"not a positive number"):
        read(tmp_path / "a.mat", wavelengths=[np.nan] * 31)


def test_band_numbers_are_not_taken_for_micrometres(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"x": np.zeros((20, 22, 9)), "bands": np.arange(1.0, 10.0)})
    with pytest.raises(DataError, match=r"9 bands without wavelengths"):
        read(tmp_path / "a.mat")


@pytest.mark.parametrize(("bad", "word"), [(np.nan, "NaN"), (np.inf, "infinite"), (-0.25, "negative")])
def test_impossible_pixels_are_counted_and_the_first_is_placed(tmp_path, bad, word):
    cube = np.full((6, 7, 31), 0.5)
    cube[4, 5, 2] = cube[5, 1, 9] = bad
    scipy.io.savemat(tmp_path / "a.mat", {"x": cube})
    with pytest.raises(DataError, match=rf"a.mat: found 2 {word} pixels, the first at band 2, y 4, x 5"):
        read(tmp_path / "a.mat")
    assert read(tmp_path / "a.mat", bands=[0, 1]).shape == (2, 6, 7)


def test_negative_pixels_can_be_clipped_or_kept(tmp_path):
    cube = np.full((6, 7, 31), 0.5)
    cube[4, 5, 2] = -0.25
    scipy.io.savemat(tmp_path / "a.mat", {"x": cube})
    clipped = read(tmp_path / "a.mat", negative="clip")
    assert float(clipped[2, 4, 5]) == 0
    assert float(clipped.min()) == 0
    assert float(read(tmp_path / "a.mat", negative="keep")[2, 4, 5]) == -0.25
    with pytest.raises(SettingError, match="one of error, clip, keep"):
        read(tmp_path / "a.mat", negative="ignore")


def test_an_infinite_pixel_of_another_band_does_not_become_the_scale(tmp_path):
    cube = np.full((6, 7, 31), 2.0)
    cube[4, 5, 2] = np.inf
    scipy.io.savemat(tmp_path / "a.mat", {"x": cube})
    assert read(tmp_path / "a.mat", bands=[0]).attrs["scale"] == 2


def test_a_variable_that_is_not_there_or_no_cube(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"x": np.zeros((5, 6, 31)), "flat": np.zeros((5, 6)), "text": "hello"})
    with pytest.raises(DataError, match=r"no variable 'y'.*one of x, flat, text"):
        read(tmp_path / "a.mat", variable="y")
    with pytest.raises(DataError, match=r"variable 'flat' of shape \(5, 6\)"):
        read(tmp_path / "a.mat", variable="flat")
    with pytest.raises(DataError, match=r"variable 'text'"):
        read(tmp_path / "a.mat", variable="text")


@pytest.mark.parametrize("bands", [[], [31], [-1], [3, 3]])
def test_impossible_band_indices(tmp_path, bands):
    scipy.io.savemat(tmp_path / "a.mat", {"x": np.zeros((5, 6, 31))})
    with pytest.raises(SettingError, match=r"from 0 to 30"):
        read(tmp_path / "a.mat", bands=bands)


def test_tiff_pages_of_different_shapes(tmp_path):
    with tifffile.TiffWriter(tmp_path / "a.tif") as tiff:
        tiff.write(np.zeros((5, 6), np.uint16))
        tiff.write(np.zeros((7, 6), np.uint16))
    with pytest.raises(DataError, match=r"different shapes"):
        read(tmp_path / "a.tif")


def test_read_dataset_says_what_is_wrong(cube, tmp_path):
    with pytest.raises(DataError, match=r"no such file"):
        read_dataset(tmp_path / "gone.nc")
    path = write_dataset(cube, tmp_path / "a.nc")
    with pytest.raises(DataError, match=r"no variable codes.*cube"):
        read_dataset(path, required=["codes"])
    assert set(read_dataset(path, required=["cube", "wavelength"]).data_vars) == {"cube"}
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(DataError, match=r"truncated"):
        read_dataset(path)
    path.write_text("plain text")
    with pytest.raises(DataError, match=r"a\.nc"):
        read_dataset(path)
    path.write_bytes(b"")
    with pytest.raises(DataError, match=r"empty file"):
        read_dataset(path)
    (tmp_path / "a.mat").write_bytes(b"x")
    with pytest.raises(DataError, match=r"suffix '.mat'"):
        read_dataset(tmp_path / "a.mat")
