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

from tests.data.test_read_formats import save_cave, save_envi
from tmca.data import describe, nm_to_metres, read, read_array, read_dataset, write_dataset
from tmca.errors import DataError, SettingError

CAVE = np.zeros((5, 6, 31))


def mat(**variables):
    """What writes a MATLAB file of these variables."""
    return lambda folder: scipy.io.savemat(folder / "a.mat", variables)


def text(name, words):
    return lambda folder: (folder / name).write_text(words)


def with_sidecar(words):
    def write(folder):
        mat(x=np.zeros((20, 22, 9)))(folder)
        text("a.mat.wavelengths.txt", words)(folder)

    return write


def folder_of(name, *files):
    def write(folder):
        (folder / name).mkdir()
        for file in files:
            (folder / name / file).write_text("x")

    return write


def uneven_pages(folder):
    with tifffile.TiffWriter(folder / "a.tif") as tiff:
        tiff.write(np.zeros((5, 6), np.uint16))
        tiff.write(np.zeros((7, 6), np.uint16))


def cave_without_a_band(folder):
    (save_cave(folder / "s_ms", np.zeros((31, 4, 4), np.uint16)) / "s_ms_07.png").unlink()


def envi(change):
    """A cube of ENVI, then something done to its header and its data."""

    def write(folder):
        header = save_envi(folder, np.zeros((7, 10, 13), np.float32), np.linspace(400, 700, 7), "bsq", "Nanometers")
        change(header, header.with_suffix(".raw"))

    return write


UNUSABLE = {
    "a CAVE band missing": (cave_without_a_band, "s_ms", {}, "without 07"),
    "ENVI cut short": (envi(lambda _, data: data.write_bytes(b"0" * 3636)), "scene.raw", {}, "3636 bytes"),
    "ENVI without data": (envi(lambda _, data: data.unlink()), "scene.hdr", {}, "no data file beside"),
    "no ENVI": (envi(lambda header, _: header.write_text("none")), "scene.hdr", {}, "truncated ENVI header"),
    "missing": (lambda folder: None, "gone.mat", {}, "no such file or folder"),
    "missing beside another": (text("painting.mat", "x"), "paintin.mat", {}, "did you mean painting.mat?"),
    "missing beside code": (text("painting.py", "x"), "painting.mat", {}, "check the path"),
    "a text": (text("a.npy", "hello, this is text"), "a.npy", {}, "(it does not begin as what numpy.save writes)"),
    "an empty folder": (folder_of("empty"), "empty", {}, "_ms_01.png"),
    "a folder of other things": (folder_of("other", "notes.txt"), "other", {}, "without band images"),
    "an export": (folder_of("shown", "manifest.json"), "shown", {}, "`tmca export check "),
    "frames of a bench": (folder_of("frames", "captures.json"), "frames", {}, "joined in frames.nc"),
    "a study": (folder_of("study", "study.html"), "study", {}, "study.html in a browser"),
    "an unknown suffix": (text("a.xyz", "x"), "a.xyz", {}, ".mat"),
    "an empty store": (folder_of("a.zarr"), "a.zarr", {}, "a.zarr"),
    "objects": (
        lambda folder: np.save(folder / "a.npy", np.array([{}], dtype=object), allow_pickle=True),
        "a.npy", {}, "bject",
    ),
    "no wavelengths": (mat(x=np.zeros((20, 22, 9))), "a.mat", {}, "a.mat.wavelengths.txt"),
    "band numbers": (mat(x=np.zeros((20, 22, 9)), bands=np.arange(1.0, 10.0)), "a.mat", {}, "9 bands"),
    "too few in the file": (
        mat(cube=CAVE, wl=np.linspace(400, 700, 30)), "a.mat", {},
        "found 30 wavelengths in wl beside cube of 5×6×31, expected one wavelength for each band; name them",
    ),
    "too many in the file": (mat(x=CAVE, bands=np.linspace(400, 720, 33)), "a.mat", {}, "33 wavelengths in bands"),
    "too few in the sidecar": (with_sidecar("400 410 420"), "a.mat", {}, "found 3 wavelengths"),
    "words in the sidecar": (with_sidecar("400\n410\nviolet\n"), "a.mat.wavelengths.txt", {}, "violet"),
    "micrometres in the sidecar": (with_sidecar("0.4 0.5 0.6"), "a.mat.wavelengths.txt", {}, "in nm"),
    "too few wavelengths": (mat(x=CAVE), "a.mat", {"wavelengths": nm_to_metres(np.linspace(400, 700, 12))}, "found 12"),
    "the same twice": (mat(x=CAVE), "a.mat", {"wavelengths": [5e-7] * 31}, "twice"),
    "wavelengths that are none": (mat(x=CAVE), "a.mat", {"wavelengths": [np.nan] * 31}, "positive"),
    "no such variable": (mat(x=CAVE, flat=CAVE[0], text="hi"), "a.mat", {"variable": "y"}, "x, flat, text"),
    "a flat variable": (mat(x=CAVE, flat=CAVE[..., 0]), "a.mat", {"variable": "flat"}, "(5, 6)"),
    "a variable of text": (mat(x=CAVE, text="hello"), "a.mat", {"variable": "text"}, "text"),
    "pages of two sizes": (uneven_pages, "a.tif", {}, "different shapes"),
}  # fmt: skip


@pytest.mark.parametrize("name", UNUSABLE)
def test_a_file_that_cannot_be_used_is_named(tmp_path, name):
    write, file, options, said = UNUSABLE[name]
    write(tmp_path)
    with pytest.raises(DataError) as caught:
        read(tmp_path / file.removesuffix(".wavelengths.txt"), **options)
    assert caught.value.where == str(tmp_path / file)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_wavelengths_of_another_length_give_way_to_those_that_are_named(tmp_path):
    mat(cube=CAVE, wl=np.linspace(400, 700, 30))(tmp_path)
    named = nm_to_metres(np.linspace(400, 700, 31))
    np.testing.assert_array_equal(read(tmp_path / "a.mat", wavelengths=named).wavelength, named)


@pytest.mark.parametrize("other", [{"bands": [3, 9, 14]}, {"lambda": [0.1, 1.0]}, {"wl": 31}])
def test_indices_weights_and_counts_are_not_taken_for_wavelengths(tmp_path, other):
    mat(cube=CAVE, **other)(tmp_path)
    assert read(tmp_path / "a.mat").attrs["wavelengths_from"].startswith("known set CAVE")


@pytest.mark.parametrize(
    ("options", "where"),
    [
        ({"wavelengths": np.linspace(400, 700, 31)}, "wavelengths"), ({"negative": "ignore"}, "negative"),
        *(({"scale": scale}, "scale") for scale in (0, -1, np.nan)),
        *(({"bands": bands}, "bands") for bands in ([], [31], [-1], [3, 3])),
    ],
)  # fmt: skip
def test_impossible_settings_are_named(tmp_path, options, where):
    mat(x=CAVE)(tmp_path)
    with pytest.raises(SettingError) as caught:
        read(tmp_path / "a.mat", **options)
    assert caught.value.where == where


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
        assert error.value.where == str(path)
        assert "\n" not in str(error.value)


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


def test_a_file_without_permission_is_named(tmp_path, monkeypatch):
    mat(x=CAVE)(tmp_path)

    def refuse(self, *args, **kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(DataError, match=r"a\.mat: found no permission to read it"):
        read(tmp_path / "a.mat")


@pytest.mark.parametrize(("bad", "word"), [(np.nan, "NaN"), (np.inf, "infinite"), (-0.25, "negative")])
def test_impossible_pixels_are_counted_and_the_first_is_placed(tmp_path, bad, word):
    cube = np.full((6, 7, 31), 0.5)
    cube[4, 5, 2] = cube[5, 1, 9] = bad
    mat(x=cube)(tmp_path)
    with pytest.raises(DataError, match=rf"a.mat: found 2 {word} pixels, the first at band 2, y 4, x 5"):
        read(tmp_path / "a.mat")
    assert read(tmp_path / "a.mat", bands=[0, 1]).shape == (2, 6, 7)


def test_negative_pixels_can_be_clipped_or_kept(tmp_path):
    cube = np.full((6, 7, 31), 0.5)
    cube[4, 5, 2] = -0.25
    mat(x=cube)(tmp_path)
    clipped = read(tmp_path / "a.mat", negative="clip")
    assert float(clipped[2, 4, 5]) == float(clipped.min()) == 0
    assert float(read(tmp_path / "a.mat", negative="keep")[2, 4, 5]) == -0.25


def test_an_infinite_pixel_of_another_band_does_not_become_the_scale(tmp_path):
    cube = np.full((6, 7, 31), 2.0)
    cube[4, 5, 2] = np.inf
    mat(x=cube)(tmp_path)
    assert read(tmp_path / "a.mat", bands=[0]).attrs["scale"] == 2


def test_read_dataset_names_what_is_wrong(cube, tmp_path):
    path = write_dataset(cube, tmp_path / "a.nc")
    assert set(read_dataset(path, required=["cube", "wavelength"]).data_vars) == {"cube"}
    for spoil, file, required in (
        (lambda: None, "gone.nc", []),
        (lambda: None, "a.nc", ["codes"]),
        (lambda: path.write_bytes(path.read_bytes()[:2000]), "a.nc", []),
        (lambda: path.write_text("plain text"), "a.nc", []),
        (lambda: path.write_bytes(b""), "a.nc", []),
        (lambda: (tmp_path / "a.mat").write_bytes(b"x"), "a.mat", []),
    ):
        spoil()
        with pytest.raises(DataError) as caught:
            read_dataset(tmp_path / file, required=required)
        assert caught.value.where == str(tmp_path / file)
