"""An output is there whole or not at all, and the old one stays until the new one is complete."""

from __future__ import annotations

import errno
import json
import os
import resource
from pathlib import Path

import h5py
import numpy as np
import pytest
import tifffile
import xarray as xr

from tmca.data import atomic, atomic_path, label, read, read_dataset, write_dataset, write_json, write_text, write_tiff
from tmca.errors import OutputError, ShapeError

SUFFIXES = [".nc", ".h5", ".zarr", ".tif"]


def save(cube, path, **options):
    return (write_tiff if path.suffix == ".tif" else write_dataset)(cube, path, **options)


@pytest.fixture
def full_disk(monkeypatch):
    """Every write to the disk fails as on a full one, after the file was created."""

    def fail(self, data, *args, **kwargs):
        with open(self, "wb") as file:
            file.write(bytes(data)[:10] if not isinstance(data, str) else data[:10].encode())
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def switch_on():
        monkeypatch.setattr(Path, "write_bytes", fail)
        monkeypatch.setattr(Path, "write_text", fail)
        monkeypatch.setattr(xr.Dataset, "to_zarr", lambda self, path, **kwargs: (path.mkdir(), fail(path / "a", b"")))

    return switch_on


@pytest.fixture
def small_files_only():
    """The system itself stops every file at 100 kB, in the middle of a write."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_existing_output_is_kept_unless_told(cube, tmp_path, suffix):
    path = save(cube, tmp_path / f"a{suffix}")
    with pytest.raises(OutputError, match=r"existing output.*overwrite"):
        save(cube * 0, path)
    xr.testing.assert_equal(read(path), cube)
    save(cube.copy(data=cube.values * 0.5), path, overwrite=True)
    np.testing.assert_array_equal(read(path), cube.values * 0.5)
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_full_disk_leaves_the_old_file_whole(cube, tmp_path, suffix, full_disk):
    path = save(cube, tmp_path / f"a{suffix}")
    full_disk()
    with pytest.raises(OutputError, match=r"full disk.*free some space"):
        save(cube * 0, path, overwrite=True)
    xr.testing.assert_equal(read(path), cube)
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_write_that_the_system_stops_leaves_the_old_file_whole(cube, tmp_path, suffix, small_files_only):
    path = save(cube, tmp_path / f"a{suffix}")
    pixels = np.random.default_rng(0).random((7, 300, 300), dtype=np.float32)
    with pytest.raises(OutputError, match=r"a\."):
        save(label(pixels, cube.wavelength.values), path, overwrite=True)
    xr.testing.assert_equal(read(path), cube)
    assert os.listdir(tmp_path) == [path.name]


def test_a_small_picture_that_the_system_stops_is_no_picture(tmp_path):
    cube = label(np.zeros((1, 16, 16), np.float32), [500e-9])
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (700, hard))
    try:
        with pytest.raises(OutputError, match=r"a\.tif: .*size limit"):
            write_tiff(cube, tmp_path / "a.tif")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert os.listdir(tmp_path) == []


def test_a_short_write_without_the_systems_number_is_a_full_disk_too(tmp_path):
    def short():
        with atomic_path(tmp_path / "a.tif") as temporary:
            temporary.write_bytes(b"half")
            raise OSError("280000 requested and 46968 written")

    with pytest.raises(OutputError, match=r"full disk"):
        short()
    assert os.listdir(tmp_path) == []


def test_text_and_json_are_as_safe(tmp_path, full_disk):
    write_text("old", tmp_path / "a.txt")
    full_disk()
    for write in (write_text, write_json):
        with pytest.raises(OutputError, match=r"full disk"):
            write("new", tmp_path / "a.txt", overwrite=True)
    assert (tmp_path / "a.txt").read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_file_of_a_folder_on_a_full_disk_is_told_by_its_name_to_be(tmp_path, full_disk):
    full_disk()

    def write():
        with atomic_path(tmp_path / "folder") as temporary:
            temporary.mkdir()
            write_json({"a": 1}, temporary / "a.json")

    with pytest.raises(OutputError, match="full disk") as caught:
        write()
    assert caught.value.where == str(tmp_path / "folder" / "a.json")
    assert list(tmp_path.iterdir()) == []


def test_a_missing_folder_is_named(tmp_path, cube):
    with pytest.raises(OutputError, match=r"no such folder .*gone"):
        write_dataset(cube, tmp_path / "gone" / "a.nc")


def test_a_folder_without_permission_is_named(tmp_path, cube, monkeypatch):
    def refuse(self, data):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(Path, "write_bytes", refuse)
    with pytest.raises(OutputError, match=r"no permission to write"):
        write_dataset(cube, tmp_path / "a.nc")


def test_an_interrupted_block_leaves_nothing(tmp_path):
    def interrupted():
        with atomic_path(tmp_path / "a.png") as temporary:
            temporary.write_bytes(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert os.listdir(tmp_path) == []


def test_a_block_that_writes_nothing_is_an_error(tmp_path):
    with pytest.raises(OutputError, match=r"nothing written"), atomic_path(tmp_path / "a.png"):
        pass


def test_an_output_that_appears_meanwhile_is_kept(tmp_path):
    path = tmp_path / "a.txt"

    def race():
        with atomic_path(path) as temporary:
            temporary.write_text("mine")
            path.write_text("theirs")

    with pytest.raises(OutputError, match="existing output"):
        race()
    assert path.read_text() == "theirs"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_the_temporary_name_is_the_same_in_a_folder_beside_it(tmp_path):
    with atomic_path(tmp_path / "figure.png") as temporary:
        assert (temporary.name, temporary.parent.parent) == ("figure.png", tmp_path)
        temporary.write_bytes(b"x")
    assert os.listdir(tmp_path) == ["figure.png"]


def test_a_failed_rename_of_a_folder_puts_the_old_one_back(cube, tmp_path, monkeypatch):
    path = write_dataset(cube, tmp_path / "a.zarr")
    replace = os.replace

    def fail_second(source, target):
        if Path(target) == path and not str(source).endswith(".old"):
            raise OSError(errno.EIO, "input/output error")
        replace(source, target)

    monkeypatch.setattr(os, "replace", fail_second)
    monkeypatch.setattr(atomic, "_renamed", lambda *how: False)  # a system that cannot exchange folders
    with pytest.raises(OutputError, match=r"a failure to write"):
        write_dataset(cube, path, overwrite=True)
    xr.testing.assert_equal(read(path), cube)
    assert os.listdir(tmp_path) == ["a.zarr"]


def test_a_folder_is_not_replaced_by_a_file(tmp_path):
    (tmp_path / "a.nc").mkdir()
    with pytest.raises(OutputError, match=r"an existing folder"):
        write_text("x", tmp_path / "a.nc", overwrite=True)
    assert (tmp_path / "a.nc").is_dir()


@pytest.mark.parametrize("suffix", [".nc", ".h5"])
def test_netcdf_opens_in_plain_xarray_and_h5py(cube, tmp_path, suffix):
    path = write_dataset(cube, tmp_path / f"a{suffix}")
    with xr.open_dataset(path) as dataset:
        xr.testing.assert_equal(dataset["cube"], cube)
    with h5py.File(path) as file:
        np.testing.assert_array_equal(file["cube"], cube.values)
        np.testing.assert_array_equal(file["wavelength"], cube.wavelength.values)
        assert file["wavelength"].attrs["units"] == "m"


def test_zarr_opens_in_plain_xarray(cube, tmp_path, recwarn):
    with xr.open_zarr(write_dataset(cube, tmp_path / "a.zarr")) as dataset:
        xr.testing.assert_equal(dataset["cube"].load(), cube)
    assert not [w for w in recwarn if "onsolidated" in str(w.message)]


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_every_kind_of_attribute_and_type_is_written(tmp_path, suffix):
    attrs = {
        "none": None,
        "yes": True,
        "n": 3,
        "x": 0.5,
        "shape": [3, 4],
        "names": ["a", "b"],
        "deep": {"k": [1, None]},
    }
    variables = {
        "code": (("slot", "y", "x"), np.random.default_rng(0).random((4, 200, 200)) > 0.5),
        "count": ("slot", np.arange(4, dtype=np.uint16)),
        "name": ("slot", ["a", "b", "c", "é"]),
        "sigma": ((), 0.01),
    }
    dataset = xr.Dataset(variables, attrs=attrs)
    back = read_dataset(write_dataset(dataset, tmp_path / f"a{suffix}"))
    xr.testing.assert_equal(back, dataset)
    assert back["code"].dtype == bool
    assert (back.attrs["n"], back.attrs["x"], back.attrs["yes"]) == (3, 0.5, 1)
    assert json.loads(back.attrs["deep"]) == {"k": [1, None]}
    assert json.loads(back.attrs["names"]) == ["a", "b"]
    assert list(back.attrs["shape"]) == [3, 4]
    assert dataset.attrs == attrs


def test_binary_codes_take_little_room(tmp_path):
    code = xr.DataArray(np.zeros((8, 256, 256), dtype=np.float32), dims=("slot", "y", "x"), name="code")
    assert write_dataset(code, tmp_path / "a.nc").stat().st_size < 0.05 * code.nbytes


def test_tiff_is_an_imagej_stack_with_labels(cube, tmp_path):
    with tifffile.TiffFile(write_tiff(cube, tmp_path / "a.tif")) as tiff:
        assert tiff.is_imagej
        assert tiff.imagej_metadata["Labels"][0] == "412.5 nm"
        assert tiff.imagej_metadata["images"] == 7
        assert tiff.series[0].dtype == np.float32
        np.testing.assert_array_equal(tiff.asarray(), cube.values)


def test_wrong_suffix_or_shape_is_refused(cube, tmp_path):
    with pytest.raises(OutputError, match=r"'.txt', expected .nc"):
        write_dataset(cube, tmp_path / "a.txt")
    with pytest.raises(OutputError, match=r"'.png', expected .tif"):
        write_tiff(cube, tmp_path / "a.png")
    with pytest.raises(ShapeError, match=r"wavelength, y, x"):
        write_tiff(cube[0], tmp_path / "a.tif")


def test_json_holds_numpy_and_marks_what_is_not_finite(tmp_path):
    value = {"a": np.float32(0.5), "b": np.arange(3), "c": np.nan, "d": (1, np.inf), "e": tmp_path, 1: np.bool_(True)}
    path = write_json(value, tmp_path / "a.json")
    expected = {"a": 0.5, "b": [0, 1, 2], "c": None, "d": [1, None], "e": str(tmp_path), "1": True}
    assert json.loads(path.read_text()) == expected
    with pytest.raises(TypeError):
        write_json({"a": object()}, tmp_path / "b.json")
    assert os.listdir(tmp_path) == ["a.json"]
