"""Scenes in the formats of others and in ours."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.kinds import kind

NM = np.array([450.0, 500.0, 550.0, 600.0, 650.0])
UNITS = {"units": "nm"}


def cube() -> np.ndarray:
    """(5, 6, 7) band, y, x in [0, 1]."""
    return np.random.default_rng(0).random((5, 6, 7), dtype=np.float32)


def _labelled() -> Any:
    from tmca.data import label, nm_to_metres

    return label(cube(), nm_to_metres(NM))


def _read(path: Path) -> Any:
    from tmca.data import read

    return read(path)


def _read_bands(path: Path) -> Any:
    from tmca.data import read

    return read(path, wavelengths=NM * 1e-9)


def _npy(path: Path) -> None:
    np.save(path, cube())


def _npz(path: Path) -> None:
    np.savez_compressed(path, cube=cube())


def _ours(path: Path) -> None:
    from tmca.data import write_dataset

    write_dataset(_labelled(), path)


def _classic(path: Path) -> None:
    import xarray as xr

    coords = {"wavelength": ("wavelength", NM, UNITS)}
    xr.DataArray(cube(), dims=("wavelength", "y", "x"), coords=coords, name="cube").to_netcdf(path, engine="scipy")


def _plain_hdf5(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file.create_dataset("group/cube", data=cube(), chunks=(1, 6, 7), compression="gzip").attrs["units"] = "1"
        file.create_dataset("wavelengths", data=NM).attrs["units"] = "nm"


def _matlab_5(path: Path) -> None:
    import scipy.io

    scipy.io.savemat(path, {"cube": cube().transpose(1, 2, 0), "wavelengths": NM}, do_compression=True)


def _matlab_73(path: Path) -> None:
    from tests.data.test_read_formats import save_73

    save_73(path, cube=(cube().transpose(1, 2, 0), "single"), wavelengths=(NM[None], "double"))


def _envi(path: Path) -> None:
    from tests.data.test_read_formats import save_envi

    save_envi(path.parent, cube(), NM, "bil", "Nanometers").rename(path)
    (path.parent / "scene.raw").rename(path.with_suffix(".raw"))


def _imagej(path: Path) -> None:
    from tmca.data import write_tiff

    write_tiff(_labelled(), path)


def _ome(path: Path) -> None:
    import tifffile

    channels = {
        "Name": [f"{nm:g} nm" for nm in NM],
        "EmissionWavelength": list(NM),
        "EmissionWavelengthUnit": ["nm"] * 5,
    }
    tifffile.imwrite(path, cube(), ome=True, metadata={"axes": "CYX", "Channel": channels})


def _cave(path: Path) -> None:
    from tests.data.test_read_formats import save_cave

    save_cave(path, np.random.default_rng(0).integers(0, 65535, (31, 4, 5), dtype=np.uint16))


def _picture(path: Path) -> None:
    from PIL import Image

    Image.fromarray(np.random.default_rng(0).integers(0, 255, (6, 7, 3), dtype=np.uint8)).save(path)


def _read_array(path: Path) -> Any:
    from tmca.data import read_array

    return read_array(path)


kind("array.npy", _npy, _read_array, infinite=True)
kind("arrays.npz", _npz, _read_bands)
kind("scene.nc", _ours, _read)
kind("scene.zarr", _ours, _read)
kind("classic.nc", _classic, _read)
kind("plain.h5", _plain_hdf5, _read)
kind("matlab5.mat", _matlab_5, _read)
kind("matlab73.mat", _matlab_73, _read)
kind("envi.hdr", _envi, _read)
kind("imagej.tif", _imagej, _read)
kind("microscope.ome.tif", _ome, _read)
kind("cave_ms", _cave, _read)
kind("picture.png", _picture, _read_array)
