"""Scenes in the formats of others and in ours."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io
import tifffile
import xarray as xr
from PIL import Image

from tests.data import rgbd_scenes
from tests.data.light_field_files import hci_name, shifted_plane, write_folder, write_parameters, write_pfm
from tests.data.rgbd_scenes import disparities, nyuv2, picture, write_picture
from tests.data.test_read_formats import save_73, save_cave, save_envi
from tests.fuzz.kinds import kind
from tmca.data import (
    describe,
    label,
    label_depth,
    label_light_field,
    label_spectral_depth,
    nm_to_metres,
    read,
    read_array,
    read_depth_map,
    read_disparity,
    read_light_field,
    read_rgbd,
    read_spectral_depth,
    read_split,
    write_dataset,
    write_light_field,
    write_split,
    write_tiff,
)

NM = np.array([450.0, 500.0, 550.0, 600.0, 650.0])
UNITS = {"units": "nm"}


def cube() -> np.ndarray:
    """(5, 6, 7) band, y, x in [0, 1]."""
    return np.random.default_rng(0).random((5, 6, 7), dtype=np.float32)


def _labelled() -> Any:
    return label(cube(), nm_to_metres(NM))


def _read_bands(path: Path) -> Any:
    return read(path, wavelengths=NM * 1e-9)


def _npy(path: Path) -> None:
    np.save(path, cube())


def _npz(path: Path) -> None:
    np.savez_compressed(path, cube=cube())


def _ours(path: Path) -> None:
    write_dataset(_labelled(), path)


def _classic(path: Path) -> None:
    coords = {"wavelength": ("wavelength", NM, UNITS)}
    xr.DataArray(cube(), dims=("wavelength", "y", "x"), coords=coords, name="cube").to_netcdf(path, engine="scipy")


def _plain_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("group/cube", data=cube(), chunks=(1, 6, 7), compression="gzip").attrs["units"] = "1"
        file.create_dataset("wavelengths", data=NM).attrs["units"] = "nm"


def _matlab_5(path: Path) -> None:
    scipy.io.savemat(path, {"cube": cube().transpose(1, 2, 0), "wavelengths": NM}, do_compression=True)


def _matlab_73(path: Path) -> None:
    save_73(path, cube=(cube().transpose(1, 2, 0), "single"), wavelengths=(NM[None], "double"))


def _envi(interleave: str) -> Callable[[Path], None]:
    """What writes an ENVI header with its data beside it, whichever of the two the path names."""

    def write(path: Path) -> None:
        save_envi(path.parent, cube(), NM, interleave, "Nanometers").rename(path.with_suffix(".hdr"))
        data = path if path.suffix != ".hdr" else path.with_suffix(".raw")
        (path.parent / "scene.raw").rename(data)

    return write


def _imagej(path: Path) -> None:
    write_tiff(_labelled(), path)


def _ome(path: Path) -> None:
    channels = {
        "Name": [f"{nm:g} nm" for nm in NM],
        "EmissionWavelength": list(NM),
        "EmissionWavelengthUnit": ["nm"] * 5,
    }
    tifffile.imwrite(path, cube(), ome=True, metadata={"axes": "CYX", "Channel": channels})


def _cave(path: Path) -> None:
    save_cave(path, np.random.default_rng(0).integers(0, 65535, (31, 4, 5), dtype=np.uint16))


def _picture(path: Path) -> None:
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (6, 7, 3), dtype=np.uint8)).save(path)


def _views(path: Path) -> None:
    write_folder(path, np.repeat(shifted_plane(3, (6, 7))[..., None], 3, axis=-1), hci_name(3))
    write_parameters(path, 3, (6, 7))
    write_pfm(path / "gt_disp_lowres.pfm", np.linspace(-1, 1, 42, dtype=np.float32).reshape(6, 7))


def _read_views(path: Path) -> Any:
    return read_light_field(path), read_disparity(path), read_rgbd(path)


def _lenslet(path: Path) -> None:
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (42, 56, 3), dtype=np.uint8)).save(path)


def _pfm(path: Path) -> None:
    write_pfm(path, np.linspace(-1, 1, 42, dtype=np.float32).reshape(6, 7))


def _npz_map(path: Path) -> None:
    np.savez(path, disparity=np.linspace(-1, 1, 42, dtype=np.float32).reshape(6, 7), views=np.ones((2, 3)))


def _our_views(path: Path) -> None:
    write_light_field(label_light_field(shifted_plane(3, (6, 7)) / 255.0), path)


def _depth() -> np.ndarray:
    """(6, 7) metres."""
    return np.linspace(0.4, 2.0, 42, dtype=np.float32).reshape(6, 7)


def _our_depth_scene(path: Path) -> None:
    write_dataset(label_spectral_depth(_labelled(), label_depth(_depth(), path)), path)


def _depth_folder(path: Path) -> None:
    path.mkdir()
    _matlab_5(path / "cube.mat")
    np.save(path / "depth.npy", _depth())


def _depth_map(path: Path) -> None:
    xr.DataArray(_depth(), dims=("y", "x"), name="depth", attrs={"units": "m"}).to_netcdf(path, engine="h5netcdf")


def _depth_png(path: Path) -> None:
    Image.fromarray((_depth() * 1000).astype(np.uint16)).save(path)


def _made(name: str, **options: Any) -> Callable[[Path], object]:
    """What writes an RGB-D scene of a layout of ``tests.data.rgbd_scenes``, small, into a folder."""

    def write(path: Path) -> None:
        path.mkdir()
        getattr(rgbd_scenes, name)(path, **options)

    return write


def _middlebury_2005(path: Path) -> None:
    write_picture(path / "view1.png", picture((9, 11)))
    write_picture(path / "disp1.png", np.random.default_rng(0).integers(60, 200, (9, 11), dtype=np.uint8))
    (path / "dmin.txt").write_text("17\n")


def _motorcycle(path: Path) -> None:
    write_picture(path / "motorcycle_left.png", picture((9, 11)))
    np.savez_compressed(path / "motorcycle_disp.npz", disparities((9, 11)))


def _nyuv2(path: Path) -> None:
    nyuv2(path, size=(9, 11))
    entry = {"rgb": "rgb_00007.png", "cam_in": [518.9, 518.9, 5.0, 4.0], "depth_scale": 1000.0}
    (path / "metric3d_annotations.json").write_text(json.dumps({"files": [entry]}))


def _with_sidecar(path: Path) -> None:
    path.mkdir()
    np.save(path / "scene.npy", cube())
    (path / "scene.wavelengths.txt").write_text("# nm\nwavelength\n" + "\n".join(f"{nm:g}" for nm in NM) + "\n")


def _read_beside(path: Path) -> Any:
    return read(path / "scene.npy")


def _split(path: Path) -> None:
    path.mkdir()
    for name in ("a.npy", "b.npy"):
        np.save(path / name, cube())
    write_split([path / "a.npy", path / "b.npy"], path / "split.txt")


def _read_split(path: Path) -> Any:
    return [str(file) for file in read_split(path / "split.txt")]


def _describe(path: Path) -> Any:
    return str(describe(path))


kind("array.npy", _npy, read_array, infinite=True)
kind("arrays.npz", _npz, _read_bands)
kind("scene.nc", _ours, read)
kind("scene.zarr", _ours, read)
kind("classic.nc", _classic, read)
kind("plain.h5", _plain_hdf5, read)
kind("matlab5.mat", _matlab_5, read)
kind("matlab73.mat", _matlab_73, read)
kind("envi.hdr", _envi("bil"), read)
kind("lines.bil", _envi("bil"), read)
kind("bands.bsq", _envi("bsq"), read)
kind("pixels.bip", _envi("bip"), read)
kind("imagej.tif", _imagej, read)
kind("microscope.ome.tif", _ome, read)
kind("cave_ms", _cave, read)
kind("picture.png", _picture, read_array)
kind("inspected.h5", _plain_hdf5, _describe)
kind("views_hci", _views, _read_views, infinite=True)
kind("lenslet_eslf.png", _lenslet, read_light_field)
kind("disparity.pfm", _pfm, read_disparity)
kind("disparities.npz", _npz_map, read_disparity)
kind("views.nc", _our_views, read_light_field)
kind("views.zarr", _our_views, read_light_field)
kind("depth_scene.nc", _our_depth_scene, read_spectral_depth, infinite=True)
kind("depth_folder", _depth_folder, read_spectral_depth, infinite=True)
kind("depth.nc", _depth_map, read_depth_map, infinite=True)
kind("depth.png", _depth_png, read_depth_map, infinite=True)
kind("rgbd_2014", _made("middlebury_2014", size=(9, 11)), read_rgbd, infinite=True)
kind("rgbd_2005", _middlebury_2005, read_rgbd, infinite=True)
kind("rgbd_filled", _made("hole_filled", size=(33, 35)), read_rgbd, infinite=True)
kind("rgbd_motorcycle", _motorcycle, read_rgbd, infinite=True)
kind("rgbd_nyuv2", _nyuv2, read_rgbd, infinite=True)
kind("rgbd_open3d", _made("open3d", size=(9, 11)), read_rgbd, infinite=True)
kind("with_sidecar", _with_sidecar, _read_beside)
kind("split", _split, _read_split)
