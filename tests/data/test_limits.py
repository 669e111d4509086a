"""Files that declare more than they hold, or that would run code, are refused before memory is taken."""

from __future__ import annotations

import json
import re
import tracemalloc
import zipfile
import zlib

import h5py
import numcodecs
import numpy as np
import pytest
import scipy.io
import zarr
from PIL import Image

from tests.data.test_read_formats import save_envi
from tmca.data import read, read_array, read_dataset, read_depth_map, write_dataset
from tmca.data.formats.stored import whole_file
from tmca.errors import DataError, SettingError

HUGE = (31, 40_000, 40_000)


def hdf5(folder):
    with h5py.File(folder / "a.h5", "w") as file:
        file.create_dataset("cube", HUGE, "f8", chunks=(1, 100, 100), compression="gzip")
    return folder / "a.h5"


def matlab_73(folder):
    return hdf5(folder).rename(folder / "a.mat")


def matlab_5(folder):
    """A compressed variable whose part declares 3 GB."""
    scipy.io.savemat(folder / "a.mat", {"cube": np.ones((20, 22, 31))}, do_compression=True)
    data = (folder / "a.mat").read_bytes()
    inside = bytearray(zlib.decompress(data[136:]))
    place = inside.find((20 * 22 * 31 * 8).to_bytes(4, "little"), 8)
    inside[place : place + 4] = (3 * 10**9).to_bytes(4, "little")
    packed = zlib.compress(bytes(inside))
    (folder / "a.mat").write_bytes(data[:132] + len(packed).to_bytes(4, "little") + packed)
    return folder / "a.mat"


def npz(folder):
    with zipfile.ZipFile(folder / "a.npz", "w") as packed, packed.open("cube.npy", "w") as member:
        np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": HUGE})
    return folder / "a.npz"


def zarr_store(folder):
    zarr.create_array(folder / "a.zarr", name="cube", shape=HUGE, chunks=(1, 4000, 4000), dtype="f8")
    return folder / "a.zarr"


@pytest.mark.parametrize("write", [hdf5, matlab_73, matlab_5, npz, zarr_store])
def test_a_bomb_is_refused_before_memory_is_taken(write, tmp_path):
    path = write(tmp_path)
    tracemalloc.start()
    with pytest.raises(DataError, match=r"GB in .* on disk, expected at most 268 MB") as said:
        read(path, wavelengths=np.linspace(4e-7, 7e-7, 31))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100e6
    assert path.name in str(said.value)
    assert "TMCA_MAX_READ" in str(said.value)


def test_the_limit_is_set_by_the_environment(cube, tmp_path, monkeypatch):
    path = write_dataset(cube, tmp_path / "a.nc")
    for text in ("100", "0.1 kB", "100B"):
        monkeypatch.setenv("TMCA_MAX_READ", text)
        for reader in (read, read_dataset):
            with pytest.raises(DataError, match="expected at most 100 bytes"):
                reader(path)
    monkeypatch.setenv("TMCA_MAX_READ", "1GiB")
    assert read(path).shape == cube.shape
    monkeypatch.setenv("TMCA_MAX_READ", "much")
    with pytest.raises(SettingError, match="TMCA_MAX_READ: found 'much'"):
        read(path)


def test_a_large_sparse_file_is_read_where_the_limit_says_so(tmp_path, monkeypatch):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("cube", (31, 1100, 1100), "f8", chunks=(1, 100, 100), compression="gzip")
    with pytest.raises(DataError, match="TMCA_MAX_READ"):
        read(tmp_path / "a.h5", bands=[0])
    monkeypatch.setenv("TMCA_MAX_READ", "300MB")
    assert read(tmp_path / "a.h5", bands=[0]).shape == (1, 1100, 1100)


def test_a_band_with_an_absurd_number_is_named_at_once(tmp_path):
    (tmp_path / "s").mkdir()
    for number in (1, 2, 99_999_999):
        Image.fromarray(np.zeros((4, 5), np.uint16)).save(tmp_path / "s" / f"s_ms_{number:02d}.png")
    with pytest.raises(DataError, match=r"bands without 03, 04, .* and more") as said:
        read(tmp_path / "s")
    assert len(str(said.value)) < 500


@pytest.mark.parametrize("entry", ["lines = -4", "samples = 0", "bands = 99999999999", "header offset = -1"])
def test_impossible_sizes_of_envi_are_named(pixels, nm, tmp_path, entry):
    header = save_envi(tmp_path, pixels, nm, "bil", "Nanometers")
    name = entry.partition(" =")[0]
    lines = [entry if line.startswith(name) else line for line in header.read_text().splitlines()]
    header.write_text("\n".join(lines))
    with pytest.raises(DataError, match=name.replace("header offset", "offset|header offset")):
        read(header)


def test_deep_groups_are_refused(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["/".join(["g"] * 200)] = np.zeros((3, 4, 5))
    with pytest.raises(DataError, match="deep"):
        read_array(tmp_path / "a.h5")


@pytest.mark.parametrize("place", ["compressor", "filters"])
def test_a_codec_that_can_run_code_is_refused(cube, tmp_path, place):
    path = write_dataset(cube, tmp_path / "a.zarr")
    for file in path.glob("*/.zarray"):
        said = json.loads(file.read_text())
        said[place] = {"id": "pickle"} if place == "compressor" else [{"id": "pickle"}]
        file.write_text(json.dumps(said))
    for reader in (read, read_dataset):
        with pytest.raises(DataError, match="pickle"):
            reader(path)


def test_what_is_said_of_codecs_elsewhere_counts_for_nothing(tmp_path):
    path, cube = tmp_path / "a.zarr", np.arange(160, dtype="f4").reshape(4, 5, 8) / 160
    zarr.create_array(path, name="cube", data=cube, zarr_format=2)
    zarr.consolidate_metadata(path)
    said = json.loads((path / ".zmetadata").read_text())
    said["metadata"]["cube/.zarray"]["filters"] = [{"id": "pickle"}]
    (path / ".zmetadata").write_text(json.dumps(said))
    np.testing.assert_array_equal(read_array(path), cube)


def test_depth_beyond_float32_is_unknown(tmp_path):
    values = np.full((4, 5), 2.0)
    values[1, 2] = 1e300
    np.save(tmp_path / "a.npy", values)
    depth = read_depth_map(tmp_path / "a.npy")
    assert depth.attrs["unknown_not_finite"] == 1
    assert np.isnan(depth[1, 2])


def test_mistakes_of_our_own_are_not_blamed_on_a_file(tmp_path, monkeypatch):
    from tmca.data.formats import arrays

    monkeypatch.setattr(arrays, "datasets_of", lambda *_: [].gone)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["cube"] = np.zeros((3, 4, 5))
    with pytest.raises(AttributeError):
        read_array(tmp_path / "a.h5")


def test_missing_memory_is_told_as_such(tmp_path):
    with pytest.raises(DataError, match="more than fits into the memory") as said, whole_file(tmp_path):
        raise MemoryError
    assert "unreadable" not in str(said.value)


BLOSC = {
    "version 2": (numcodecs.Blosc, {"zarr_format": 2}),
    "version 3": (zarr.codecs.BloscCodec, {}),
    "shards": (zarr.codecs.BloscCodec, {"shards": (4, 8, 8)}),
    "another name": (zarr.codecs.numcodecs.Blosc, {}),
}


@pytest.mark.filterwarnings("ignore:Numcodecs codecs are not in the Zarr")
@pytest.mark.parametrize("name", BLOSC)
@pytest.mark.parametrize("length", [0, 10**9, 2**31 - 1, 2**32 - 1])
def test_chunks_of_blosc_that_state_another_length_are_refused(tmp_path, name, length):
    codec, settings = BLOSC[name]
    path, cube = tmp_path / "a.zarr", np.arange(256, dtype="f4").reshape(4, 8, 8) / 256
    zarr.create_array(path, name="cube", data=cube, chunks=(2, 8, 8), compressors=codec(), **settings)
    np.testing.assert_array_equal(read_array(path), cube)
    zarr.config.reset()
    chunk = next(file for file in path.rglob("*") if file.is_file() and file.name[0].isdigit())
    stored = bytearray(chunk.read_bytes())
    stored[12:16] = length.to_bytes(4, "little")
    chunk.write_bytes(stored)
    with pytest.raises(DataError, match=re.escape(str(path))):
        read_array(path)
