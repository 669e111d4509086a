"""An output is there whole or not at all, and the old one stays until the new one is complete."""

from __future__ import annotations

import errno
import json
import os
import resource
import threading
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import tifffile
import xarray as xr

from tmca.data import (
    atomic,
    atomic_path,
    label,
    read,
    read_attributes,
    read_dataset,
    write_dataset,
    write_json,
    write_text,
    write_tiff,
)
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


@pytest.mark.parametrize("suffix", [".nc", ".h5"])
def test_netcdf_opens_in_plain_xarray_and_h5py(cube, tmp_path, suffix):
    path = write_dataset(cube, tmp_path / f"a{suffix}")
    with xr.open_dataset(path) as dataset:
        xr.testing.assert_equal(dataset["cube"], cube)
    with h5py.File(path) as file:
        np.testing.assert_array_equal(file["cube"], cube.values)
        np.testing.assert_array_equal(file["wavelength"], cube.wavelength.values)
        assert file["wavelength"].attrs["units"] == "m"


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


def test_json_holds_numpy_and_marks_what_is_not_finite(tmp_path):
    value = {"a": np.float32(0.5), "b": np.arange(3), "c": np.nan, "d": (1, np.inf), "e": tmp_path, 1: np.bool_(True)}
    path = write_json(value, tmp_path / "a.json")
    expected = {"a": 0.5, "b": [0, 1, 2], "c": None, "d": [1, None], "e": str(tmp_path), "1": True}
    assert json.loads(path.read_text()) == expected
    with pytest.raises(TypeError):
        write_json({"a": object()}, tmp_path / "b.json")
    assert os.listdir(tmp_path) == ["a.json"]


def test_text_and_json_are_as_safe(tmp_path, full_disk):
    write_text("old", tmp_path / "a.txt")
    full_disk()
    for write in (write_text, write_json):
        with pytest.raises(OutputError, match=r"full disk"):
            write("new", tmp_path / "a.txt", overwrite=True)
    assert (tmp_path / "a.txt").read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


@pytest.mark.parametrize(
    ("raised", "error"),
    [
        (KeyboardInterrupt(), KeyboardInterrupt), (OSError("280000 requested and 46968 written"), OutputError),
        (PermissionError(errno.EACCES, "denied"), OutputError), (None, OutputError),
    ],
)  # fmt: skip
def test_a_block_that_ends_early_leaves_nothing(tmp_path, raised, error):
    def block():
        with atomic_path(tmp_path / "a.png") as temporary:
            assert (temporary.name, temporary.parent.parent) == ("a.png", tmp_path)
            if raised is not None:
                temporary.write_bytes(b"half")
                raise raised

    with pytest.raises(error):
        block()
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    ("write", "error"),
    [
        (lambda cube, folder: write_dataset(cube, folder / "gone" / "a.nc"), OutputError),
        (lambda cube, folder: write_dataset(cube, folder / "a.txt"), OutputError),
        (lambda cube, folder: write_tiff(cube, folder / "a.png"), OutputError),
        (lambda cube, folder: write_tiff(cube[0], folder / "a.tif"), ShapeError),
        (lambda cube, folder: write_text("x", folder / "there", overwrite=True), OutputError),
    ],
)
def test_what_cannot_be_written_there_is_refused(cube, tmp_path, write, error):
    (tmp_path / "there").mkdir()
    with pytest.raises(error):
        write(cube, tmp_path)
    assert os.listdir(tmp_path) == ["there"]


@pytest.mark.parametrize("name", ["afile/a.nc", "afile/deep/a.nc"])
def test_a_file_in_the_place_of_a_folder_is_named(cube, tmp_path, name):
    (tmp_path / "afile").touch()
    with pytest.raises(OutputError, match="afile, a file, expected a folder"):
        write_dataset(cube, tmp_path / name)


@pytest.mark.parametrize("kind", [".nc", ".zarr", "classic", "fixed length"])
def test_attributes_alone_are_those_of_the_whole_file(tmp_path, kind):
    stored = xr.Dataset({"a": ("x", np.arange(3.0))}, attrs={"date": "2026-03-31", "size": [2, 3], "gain": 0.5})
    path = tmp_path / ("a.zarr" if kind == ".zarr" else "a.nc")
    if kind == "classic":
        stored.to_netcdf(path, engine="scipy")
    else:
        write_dataset(stored, path)
    if kind == "fixed length":
        with h5py.File(path, "a") as file:
            file.attrs["date"] = np.bytes_("2026-03-31")
    alone, whole = read_attributes(path), read_dataset(path).attrs
    assert alone.keys() == whole.keys()
    assert all(np.array_equal(alone[name], whole[name]) for name in whole)
    assert alone["date"] == "2026-03-31"


def test_what_a_thread_writes_on_after_a_failure_does_not_stay(tmp_path):
    """As Zarr's do, which make the folders of their files anew."""

    def write_on(place):
        time.sleep(0.15)
        place.mkdir(parents=True, exist_ok=True)
        (place / "late").touch()

    def fail():
        with atomic_path(tmp_path / "a.zarr") as temporary:
            temporary.mkdir()
            threads.append(threading.Thread(target=write_on, args=(temporary,)))
            threads[0].start()
            raise OutputError("a", "nothing", "something")

    threads = []
    with pytest.raises(OutputError):
        fail()
    threads[0].join()
    assert [*tmp_path.iterdir()] == []
