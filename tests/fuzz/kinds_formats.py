"""Scenes in the formats of others and in ours."""

from __future__ import annotations

import json
from collections.abc import Callable
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


def _envi(interleave: str) -> Callable[[Path], None]:
    """What writes an ENVI header with its data beside it, whichever of the two the path names."""

    def write(path: Path) -> None:
        from tests.data.test_read_formats import save_envi

        save_envi(path.parent, cube(), NM, interleave, "Nanometers").rename(path.with_suffix(".hdr"))
        data = path if path.suffix != ".hdr" else path.with_suffix(".raw")
        (path.parent / "scene.raw").rename(data)

    return write


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


def _views(path: Path) -> None:
    from tests.data.light_field_files import hci_name, shifted_plane, write_folder, write_parameters, write_pfm

    write_folder(path, np.repeat(shifted_plane(3, (6, 7))[..., None], 3, axis=-1), hci_name(3))
    write_parameters(path, 3, (6, 7))
    write_pfm(path / "gt_disp_lowres.pfm", np.linspace(-1, 1, 42, dtype=np.float32).reshape(6, 7))


def _read_views(path: Path) -> Any:
    from tmca.data import read_disparity, read_light_field, read_rgbd

    return read_light_field(path), read_disparity(path), read_rgbd(path)


def _lenslet(path: Path) -> None:
    from PIL import Image

    Image.fromarray(np.random.default_rng(0).integers(0, 255, (42, 56, 3), dtype=np.uint8)).save(path)


def _read_light_field(path: Path) -> Any:
    from tmca.data import read_light_field

    return read_light_field(path)


def _pfm(path: Path) -> None:
    from tests.data.light_field_files import write_pfm

    write_pfm(path, np.linspace(-1, 1, 42, dtype=np.float32).reshape(6, 7))


def _npz_map(path: Path) -> None:
    np.savez(path, disparity=np.linspace(-1, 1, 42, dtype=np.float32).reshape(6, 7), views=np.ones((2, 3)))


def _read_disparity(path: Path) -> Any:
    from tmca.data import read_disparity

    return read_disparity(path)


def _our_views(path: Path) -> None:
    from tests.data.light_field_files import shifted_plane
    from tmca.data import label_light_field, write_light_field

    write_light_field(label_light_field(shifted_plane(3, (6, 7)) / 255.0), path)


def _depth() -> np.ndarray:
    """(6, 7) metres."""
    return np.linspace(0.4, 2.0, 42, dtype=np.float32).reshape(6, 7)


def _our_depth_scene(path: Path) -> None:
    from tmca.data import label_depth, label_spectral_depth, write_dataset

    write_dataset(label_spectral_depth(_labelled(), label_depth(_depth(), path)), path)


def _depth_folder(path: Path) -> None:
    path.mkdir()
    _matlab_5(path / "cube.mat")
    np.save(path / "depth.npy", _depth())


def _read_depth_scene(path: Path) -> Any:
    from tmca.data import read_spectral_depth

    return read_spectral_depth(path)


def _depth_map(path: Path) -> None:
    import xarray as xr

    xr.DataArray(_depth(), dims=("y", "x"), name="depth", attrs={"units": "m"}).to_netcdf(path, engine="h5netcdf")


def _depth_png(path: Path) -> None:
    from PIL import Image

    Image.fromarray((_depth() * 1000).astype(np.uint16)).save(path)


def _read_depth(path: Path) -> Any:
    from tmca.data import read_depth_map

    return read_depth_map(path)


def _made(name: str, **options: Any) -> Callable[[Path], object]:
    """What writes an RGB-D scene of a layout of ``tests.data.rgbd_scenes``, small, into a folder."""

    def write(path: Path) -> None:
        from tests.data import rgbd_scenes

        path.mkdir()
        getattr(rgbd_scenes, name)(path, **options)

    return write


def _middlebury_2005(path: Path) -> None:
    from tests.data.rgbd_scenes import picture, write_picture

    write_picture(path / "view1.png", picture((9, 11)))
    write_picture(path / "disp1.png", np.random.default_rng(0).integers(60, 200, (9, 11), dtype=np.uint8))
    (path / "dmin.txt").write_text("17\n")


def _motorcycle(path: Path) -> None:
    from tests.data.rgbd_scenes import disparities, picture, write_picture

    write_picture(path / "motorcycle_left.png", picture((9, 11)))
    np.savez_compressed(path / "motorcycle_disp.npz", disparities((9, 11)))


def _nyuv2(path: Path) -> None:
    from tests.data.rgbd_scenes import nyuv2

    nyuv2(path, size=(9, 11))
    entry = {"rgb": "rgb_00007.png", "cam_in": [518.9, 518.9, 5.0, 4.0], "depth_scale": 1000.0}
    (path / "metric3d_annotations.json").write_text(json.dumps({"files": [entry]}))


def _read_rgbd(path: Path) -> Any:
    from tmca.data import read_rgbd

    return read_rgbd(path)


def _with_sidecar(path: Path) -> None:
    path.mkdir()
    np.save(path / "scene.npy", cube())
    (path / "scene.wavelengths.txt").write_text("# nm\nwavelength\n" + "\n".join(f"{nm:g}" for nm in NM) + "\n")


def _read_beside(path: Path) -> Any:
    from tmca.data import read

    return read(path / "scene.npy")


def _split(path: Path) -> None:
    from tmca.data import write_split

    path.mkdir()
    for name in ("a.npy", "b.npy"):
        np.save(path / name, cube())
    write_split([path / "a.npy", path / "b.npy"], path / "split.txt")


def _read_split(path: Path) -> Any:
    from tmca.data import read_split

    return [str(file) for file in read_split(path / "split.txt")]


def _describe(path: Path) -> Any:
    from tmca.data import describe

    return str(describe(path))


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
kind("envi.hdr", _envi("bil"), _read)
kind("lines.bil", _envi("bil"), _read)
kind("bands.bsq", _envi("bsq"), _read)
kind("pixels.bip", _envi("bip"), _read)
kind("imagej.tif", _imagej, _read)
kind("microscope.ome.tif", _ome, _read)
kind("cave_ms", _cave, _read)
kind("picture.png", _picture, _read_array)
kind("inspected.h5", _plain_hdf5, _describe)
kind("views_hci", _views, _read_views, infinite=True)
kind("lenslet_eslf.png", _lenslet, _read_light_field)
kind("disparity.pfm", _pfm, _read_disparity)
kind("disparities.npz", _npz_map, _read_disparity)
kind("views.nc", _our_views, _read_light_field)
kind("views.zarr", _our_views, _read_light_field)
kind("depth_scene.nc", _our_depth_scene, _read_depth_scene, infinite=True)
kind("depth_folder", _depth_folder, _read_depth_scene, infinite=True)
kind("depth.nc", _depth_map, _read_depth, infinite=True)
kind("depth.png", _depth_png, _read_depth, infinite=True)
kind("rgbd_2014", _made("middlebury_2014", size=(9, 11)), _read_rgbd, infinite=True)
kind("rgbd_2005", _middlebury_2005, _read_rgbd, infinite=True)
kind("rgbd_filled", _made("hole_filled", size=(33, 35)), _read_rgbd, infinite=True)
kind("rgbd_motorcycle", _motorcycle, _read_rgbd, infinite=True)
kind("rgbd_nyuv2", _nyuv2, _read_rgbd, infinite=True)
kind("rgbd_open3d", _made("open3d", size=(9, 11)), _read_rgbd, infinite=True)
kind("with_sidecar", _with_sidecar, _read_beside)
kind("split", _split, _read_split)
