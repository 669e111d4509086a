"""Every supported format gives the same labelled cube, axes and wavelengths right."""

from __future__ import annotations

import warnings
from functools import partial
from itertools import permutations

import h5py
import numpy as np
import pytest
import scipy.io
import tifffile
import xarray as xr
import zarr
from PIL import Image

from tests.data.light_field_files import write_pfm
from tmca.data import describe, nm_to_metres, read, read_array, write_dataset, write_tiff
from tmca.data.scene_names import SceneWarning
from tmca.errors import DataError

CAVE_NM = np.arange(400.0, 701.0, 10.0)


def save_73(path, **variables):
    """A MATLAB 7.3 file as MATLAB writes it: a header block and column-major data, hence reversed axes."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, (values, kind) in variables.items():
            data = file.create_dataset(name, data=np.asarray(values).T)
            data.attrs["MATLAB_class"] = np.bytes_(kind)
    with path.open("rb+") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return path


def save_envi(folder, pixels, nm, interleave, units):
    """An ENVI cube written by hand, so that the reader is not tested against its own library."""
    order = {"bsq": (0, 1, 2), "bil": (1, 0, 2), "bip": (1, 2, 0)}[interleave]
    (folder / "scene.raw").write_bytes(np.ascontiguousarray(pixels.transpose(order)).tobytes())
    bands, lines, samples = pixels.shape
    values = nm if units == "Nanometers" else nm / 1000
    header = f"""ENVI
samples = {samples}
lines = {lines}
bands = {bands}
header offset = 0
file type = ENVI Standard
data type = 4
interleave = {interleave}
byte order = 0
wavelength units = {units}
wavelength = {{{", ".join(f"{v:.6g}" for v in values)}}}
"""
    (folder / "scene.hdr").write_text(header)
    return folder / "scene.hdr"


def save_cave(folder, cube, mode="uint16"):
    folder.mkdir(parents=True)
    for band, plane in enumerate(cube, 1):
        if mode == "rgba":
            opaque = np.full_like(plane, 255)
            Image.fromarray(np.stack([plane, plane, plane, opaque], -1)).save(folder / f"s_ms_{band:02d}.png")
        else:
            Image.fromarray(plane).save(folder / f"s_ms_{band:02d}.png")
    (folder / "s_RGB.bmp").write_bytes(b"not a band")
    (folder / "Thumbs.db").write_bytes(b"not a band")
    return folder


def save_netcdf(path, pixels, nm, unit="nm", order=("wavelength", "y", "x"), engine="h5netcdf"):
    axis = ("wavelength", nm * {"nm": 1.0, "um": 1e-3, "m": 1e-9}[unit], {"units": unit})
    stored = xr.DataArray(pixels, dims=("wavelength", "y", "x"), coords={"wavelength": axis}, name="r")
    stored.transpose(*order).to_netcdf(path, engine=engine)


def save_hdf5(path, pixels, nm):
    with h5py.File(path, "w") as file:
        file.create_dataset("scan/cube", data=pixels)
        file.create_dataset("scan/wavelengths", data=nm / 1000).attrs["units"] = "um"
        file.create_dataset("scan/dark", data=np.zeros((10, 13)))


def save_zarr(path, pixels, nm):
    group = zarr.open_group(str(path), mode="w")
    group["cube"], group["wavelength_nm"] = pixels, nm


def save_tiff(path, pixels, nm):
    """Its wavelengths in a list beside it, or as OME has them."""
    channels = {"EmissionWavelength": nm.tolist(), "EmissionWavelengthUnit": ["nm"] * 7}
    about = {"metadata": {"axes": "CYX", "Channel": channels}} if ".ome" in path.name else {}
    tifffile.imwrite(path, pixels, photometric="minisblack", **about)
    if not about:
        path.with_suffix(".wavelengths.txt").write_text("# nm\n" + "\n".join(map(str, nm)))


def save_envi_as(interleave, units):
    return lambda path, pixels, nm: save_envi(path.parent, pixels, nm, interleave, units)


def last(pixels):
    return np.ascontiguousarray(np.moveaxis(pixels, 0, -1))


STATED = {
    **{f"{unit}.nc": partial(save_netcdf, unit=unit) for unit in ("nm", "um", "m")},
    "classic.nc": partial(save_netcdf, engine="scipy"),
    **{f"{''.join(order)}.nc": partial(save_netcdf, order=order) for order in permutations(("wavelength", "y", "x"))},
    "five.mat": lambda path, pixels, nm: scipy.io.savemat(path, {"hyper": last(pixels), "wavelengths": nm}),
    "packed.npz": lambda path, pixels, nm: np.savez(path, hyper=last(pixels), wavelengths=nm),
    "seven.mat": lambda path, pixels, nm: save_73(
        path, hyper=(last(pixels), "single"), wavelengths=(nm[:, None], "double")
    ),
    "a.h5": save_hdf5, "a.zarr": save_zarr, "a.tif": save_tiff, "a.ome.tif": save_tiff,
    **{f"scene.{suffix} {interleave} {units}": save_envi_as(interleave, units) for suffix in ("hdr", "raw")
       for interleave in ("bsq", "bil", "bip") for units in ("Nanometers", "Micrometers", "Unknown")},
}  # fmt: skip
"""Files that say their wavelengths, and what writes them."""
SILENT = {
    **{f"{axis}.npy": lambda path, pixels, axis=axis: np.save(path, np.moveaxis(pixels, 0, axis)) for axis in range(3)},
    "a.zarr": lambda path, pixels: zarr.save_array(str(path), pixels),
    "pages.tif": lambda path, pixels: tifffile.imwrite(path, pixels, photometric="minisblack"),
    "last.tif": lambda path, pixels: tifffile.imwrite(path, last(pixels), photometric="minisblack"),
    "contig.tif": lambda path, pixels: tifffile.imwrite(
        path, last(pixels), photometric="minisblack", planarconfig="contig"
    ),
}  # fmt: skip
"""Files that do not."""


@pytest.mark.parametrize("name", [*STATED, *(f"without wavelengths: {name}" for name in SILENT)])
def test_every_format_gives_the_same_cube(pixels, nm, tmp_path, name):
    silent = name.removeprefix("without wavelengths: ") if name.startswith("without") else None
    path, options = tmp_path / (silent or name.partition(" ")[0]), {}
    if silent:
        SILENT[silent](path, pixels)
        options["wavelengths"] = nm_to_metres(nm)
    else:
        STATED[name](path, pixels, nm)
    back = read(path, **options)
    np.testing.assert_array_equal(back, pixels)
    np.testing.assert_array_equal(back.wavelength, nm_to_metres(nm))
    assert back.attrs["wavelengths_from"] == ("argument" if silent else "sidecar" if name == "a.tif" else "file")
    np.testing.assert_array_equal(read(path, bands=[5, 2], **options), pixels[[5, 2]])


def test_what_is_missing_and_what_is_chosen_is_told(pixels, nm, tmp_path):
    tifffile.imwrite(tmp_path / "plain.tif", pixels, photometric="minisblack")
    with pytest.raises(DataError, match=r"7 bands without wavelengths.*plain.tif.wavelengths.txt"):
        read(tmp_path / "plain.tif")
    save_hdf5(tmp_path / "a.h5", pixels, nm)
    assert read(tmp_path / "a.h5").attrs["variable"] == "scan/cube"
    np.testing.assert_array_equal(read_array(tmp_path / "a.h5", "scan/wavelengths"), nm / 1000)


def test_a_foreign_cube_above_one_is_divided_by_its_maximum(cube, tmp_path):
    foreign = cube.copy(data=cube.values * 3).drop_attrs(deep=False)
    foreign.to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    back = read(tmp_path / "a.nc", bands=[0, 1])
    assert back.attrs["scale"] == pytest.approx(float(foreign.max()))
    np.testing.assert_allclose(back, foreign[:2] / foreign.max())


def test_spatial_coordinates_survive(cube, tmp_path):
    placed = cube.assign_coords(y=np.linspace(0, 1, 10), x=np.linspace(0, 2, 13))
    xr.testing.assert_equal(read(write_dataset(placed, tmp_path / "a.nc")), placed)


def test_icvl_is_divided_by_twelve_bits(tmp_path):
    counts = np.random.default_rng(0).integers(0, 4000, (12, 14, 31)).astype(np.float64)
    rgb = np.random.default_rng(1).random((12, 14, 3))
    path = tmp_path / "icvl.mat"
    save_73(path, rad=(counts, "double"), bands=(CAVE_NM[None], "double"), rgb=(rgb, "double"))
    back = read(path)
    assert back.attrs["scale"] == 4095
    assert back.attrs["variable"] == "rad"
    assert back.attrs["wavelengths_from"] == "file"
    np.testing.assert_allclose(back, counts.transpose(2, 0, 1) / 4095, rtol=1e-6)
    assert read(path, bands=[0]).attrs["scale"] == 4095


def test_a_double_that_matlab_packed_as_integers_is_scaled_as_a_double(tmp_path):
    counts = np.random.default_rng(0).integers(0, 3000, (6, 7, 31)).astype(np.float64)
    counts[3, 4, 5] = 3000
    scipy.io.savemat(tmp_path / "a.mat", {"x": counts})
    assert read(tmp_path / "a.mat").attrs["scale"] == 3000


@pytest.mark.filterwarnings("ignore:.*of white:tmca.data.scene_names.SceneWarning")
@pytest.mark.parametrize(("dtype", "top"), [("uint8", 255), ("uint16", 65535), ("int16", 32767), ("float32", 1)])
def test_counts_are_divided_by_the_types_maximum(tmp_path, dtype, top):
    counts = np.ones((4, 5, 31), dtype=dtype)
    scipy.io.savemat(tmp_path / "a.mat", {"x": counts})
    back = read(tmp_path / "a.mat")
    assert back.attrs["scale"] == top
    np.testing.assert_allclose(back, 1 / top, rtol=1e-6)
    assert read(tmp_path / "a.mat", scale=10).attrs["scale"] == 10


@pytest.mark.parametrize("nested", [False, True])
def test_cave_folder(tmp_path, nested):
    counts = np.random.default_rng(0).integers(0, 65536, (31, 9, 12)).astype(np.uint16)
    save_cave(tmp_path / "paints_ms" / "paints_ms" if nested else tmp_path / "paints_ms", counts)
    back = read(tmp_path / "paints_ms")
    np.testing.assert_array_equal(back, counts.astype(np.float32) / np.float32(65535))
    np.testing.assert_array_equal(back.wavelength_nm, CAVE_NM)
    np.testing.assert_array_equal(read(tmp_path / "paints_ms", bands=[30, 3]), back[[30, 3]])


def test_cave_watercolors_has_one_luminance_in_rgba(tmp_path):
    counts = np.random.default_rng(0).integers(0, 256, (31, 9, 12)).astype(np.uint8)
    back = read(save_cave(tmp_path / "watercolors_ms", counts, "rgba"))
    np.testing.assert_array_equal(back, counts.astype(np.float32) / np.float32(255))
    assert back.attrs["scale"] == 255


def test_a_tiff_of_a_known_set_may_have_its_bands_last(tmp_path):
    cube = np.random.default_rng(0).random((40, 41, 31), dtype=np.float32)
    tifffile.imwrite(tmp_path / "cave.tif", cube, photometric="minisblack")
    assert describe(tmp_path / "cave.tif")["spectral_axis"] == 2
    np.testing.assert_array_equal(read(tmp_path / "cave.tif"), np.moveaxis(cube, -1, 0))


def test_the_odd_axis_out_is_the_spectral_one(tmp_path):
    cube = np.random.default_rng(0).random((20, 5, 20)).astype(np.float32)
    np.save(tmp_path / "a.npy", cube)
    (tmp_path / "a.wavelengths.csv").write_text("wavelength_nm\n450,500,550,600,650\n")
    np.testing.assert_array_equal(read(tmp_path / "a.npy"), cube.transpose(1, 0, 2))
    np.save(tmp_path / "b.npy", np.zeros((20, 20, 20)))
    with pytest.raises(DataError, match=r"no axis stands out"):
        read(tmp_path / "b.npy")


def test_pictures_are_read_as_arrays(tmp_path):
    capture = np.random.default_rng(0).integers(0, 65536, (9, 12)).astype(np.uint16)
    Image.fromarray(capture).save(tmp_path / "capture.png")
    np.testing.assert_array_equal(read_array(tmp_path / "capture.png"), capture)
    with pytest.raises(DataError, match=r"no array of three axes.*read_array"):
        read(tmp_path / "capture.png")


def test_packed_arrays_and_float_maps_are_arrays_like_others(tmp_path):
    first, second = np.arange(12.0).reshape(3, 4), np.ones(2)
    np.savez(tmp_path / "two.npz", first=first, second=second)
    np.testing.assert_array_equal(read_array(tmp_path / "two.npz", "first"), first)
    assert {name: v["shape"] for name, v in describe(tmp_path / "two.npz")["variables"].items()} == {
        "first": [3, 4],
        "second": [2],
    }
    with pytest.raises(DataError, match="2 arrays that could be the array of numbers"):
        read_array(tmp_path / "two.npz")
    np.testing.assert_array_equal(read_array(write_pfm(tmp_path / "map.pfm", first)), first)


@pytest.mark.parametrize("brightness", [1, 3])
@pytest.mark.parametrize("suffix", [".nc", ".h5", ".zarr", ".tif"])
def test_a_written_cube_reads_back_the_same_above_one_too(cube, tmp_path, suffix, brightness):
    cube = cube.copy(data=cube.values * np.float32(brightness))
    back = read((write_tiff if suffix == ".tif" else write_dataset)(cube, tmp_path / f"a{suffix}"))
    xr.testing.assert_equal(back, cube)
    assert back.attrs["wavelengths_from"] == "file"
    assert back.dtype == np.float32


@pytest.mark.parametrize(("variable", "size", "first"), [("data", (20, 31), 400), ("ref", (6, 8), 420)])
def test_kaist_and_harvard_without_wavelengths_are_known_sets(tmp_path, variable, size, first):
    cube = np.random.default_rng(0).random((*size, 31)).astype(np.float32)
    scipy.io.savemat(tmp_path / "known.mat", {variable: cube, "lbl": np.ones(size)})
    back = read(tmp_path / "known.mat")
    np.testing.assert_array_equal(back, cube.transpose(2, 0, 1))
    np.testing.assert_array_equal(back.wavelength_nm, CAVE_NM - 400 + first)
    assert "known set" in back.attrs["wavelengths_from"]


@pytest.mark.parametrize(
    ("dtype", "top", "said"),
    [
        ("uint16", 4095, "6.2 % of white (scale 65535); counts of 12 bits take --scale 4095 (scale=)"),
        ("uint16", 16383, "25 % of white (scale 65535); counts of 14 bits"), ("uint16", 200, "counts of 8 bits"),
        ("int16", 4095, "12 % of white (scale 32767); counts of 12 bits"), ("int64", 255, "--scale 255"),
        ("uint16", 16384, ""), ("uint8", 40, ""), ("float32", 0.01, ""),
    ],
)  # fmt: skip
def test_counts_that_leave_two_bits_of_their_type_free_are_warned_of(tmp_path, dtype, top, said):
    file, cube = tmp_path / "a.npy", np.zeros((31, 4, 5), dtype)
    cube[7, 2, 3] = top
    np.save(file, cube)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        read(file, scale=top)
        assert not warned
        read(file)
    assert [one.category for one in warned] == [SceneWarning] * bool(said)
    assert said in "".join(str(one.message) for one in warned)
    assert said in describe(file).get("note", "")
