"""`read_spectral_depth`: spectral scenes with depth, from one labelled file or a folder with a cube and a depth map."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.data.checks import Negative
from tmca.data.cubes import read
from tmca.data.depth_maps import UNKNOWN, labelled_kinds, read_depth_map, unknown_kinds
from tmca.data.formats import envi
from tmca.data.formats.opening import is_zarr, open_contents
from tmca.data.light_fields import centre_window
from tmca.data.rendering.pictures import Materials, spectral_from_rgb
from tmca.data.rendering.resample import area_average, nearest
from tmca.data.rgbd import read_rgbd, refuse_rgbd
from tmca.errors import DataError

if TYPE_CHECKING:
    import xarray as xr

CUBE_NAMES, DEPTH_NAMES = ("cube", "spectral"), ("depth",)
"""What the two parts of a scene's folder are called, before the suffix."""


def read_spectral_depth(
    path: str | Path,
    *,
    wavelengths: Sequence[float] | None = None,
    variable: str | None = None,
    scale: float | None = None,
    depth_scale: float | None = None,
    negative: Negative = "error",
    reduce: int | None = None,
    from_rgb: bool = False,
    seed: int = 0,
    illuminant: str = "D65",
    materials: Materials = "train",
) -> xr.Dataset:
    """Read a spectral cube together with its depth map.

    The scene is one file with both (NetCDF, HDF5, Zarr, ``.mat``: a cube, ``radiance`` where there are several, and
    ``depth``), or a folder with a cube ``cube.*`` or ``spectral.*`` in any format of `tmca.data.read` and a depth map
    ``depth.*`` in any of `tmca.data.read_depth_map`: the layout for sets with a cube and a depth map per scene, such as
    the 18 scenes of Baek et al. (ICCV 2021). An RGB-D scene of `tmca.data.read_rgbd` is taken where ``from_rgb``
    asks for it: its spectra are made up by `tmca.data.spectral_from_rgb`.

    Args:
        path: the file, the folder, or an RGB-D scene.
        wavelengths: of the cube's bands where the file does not say, metres; of an RGB-D scene the ones to make up.
        variable: which array is the cube, where the file has several.
        scale: stored value of the cube that is relative irradiance 1; see `tmca.data.read`.
        depth_scale: metres per stored unit of the depth map; see `tmca.data.read_depth_map`.
        negative: what is done with negative pixels of the cube: ``"error"``, ``"clip"`` to 0, or ``"keep"``.
        reduce: whole number of pixels per axis whose light is averaged into one; depth is sampled at its middle, what
            is left over at the end is dropped. Of an RGB-D scene that is done before its spectra are made up.
        from_rgb: make up spectra for an RGB-D scene.
        seed, illuminant, materials: of made-up spectra.

    Returns:
        A dataset of float32 ``radiance`` ``(wavelength, y, x)``, relative irradiance, and ``depth`` ``(y, x)``, metres,
        NaN where unknown, with the counts of `tmca.data.read_depth_map`; attributes ``name``, ``source``, ``metric``,
        what the file says of itself, and of an RGB-D scene those of both conversions.

    Raises:
        DataError: a missing or broken part, sizes that differ, no known depth, or RGB without ``from_rgb``.
        SettingError: an impossible argument.
    """
    path = Path(path)
    if from_rgb:
        return _made_up(path, wavelengths, reduce, seed=seed, illuminant=illuminant, materials=materials)
    refuse_rgbd(path)
    options: dict[str, Any] = {"wavelengths": wavelengths, "scale": scale, "negative": negative}
    parts = scene_parts(path)
    if parts is None and path.is_dir() and not is_zarr(path):
        there = ", ".join(sorted(file.name for file in path.iterdir())[:4]) or "nothing"
        raise DataError(path, there, "cube.* or spectral.*, and depth.*", "name the two parts of the scene so")
    if parts is None:
        named, about = _beside(path)
        cube = read(path, variable=named if variable is None else variable, **options)
        depth = read_depth_map(path, scale=depth_scale)
    else:
        about = {}
        cube, depth = read(parts[0], variable=variable, **options), read_depth_map(parts[1], scale=depth_scale)
    about |= {"name": path.stem, "source": str(path), "metric": bool(about.get("metric", True))}
    return reduced_scene(label_spectral_depth(cube, depth, about), reduce, path)


def label_spectral_depth(cube: xr.DataArray, depth: xr.DataArray, attrs: dict[str, Any] | None = None) -> xr.Dataset:
    """Cube and depth map as one dataset with ``radiance`` and ``depth``.

    Args:
        cube: ``(wavelength, y, x)``, as from `tmca.data.read`.
        depth: ``(y, x)`` metres, as from `tmca.data.read_depth_map`.
        attrs: of the dataset.

    Raises:
        DataError: no cube, or another size than the depth map's.
    """
    import xarray as xr

    where = (attrs or {}).get("source", cube.attrs.get("source", "cube"))
    if cube.dims != ("wavelength", "y", "x"):
        raise DataError(where, f"dims {cube.dims}", "a spectral cube (wavelength, y, x)")
    if cube.shape[1:] != depth.shape:
        sizes = [f"{height}×{width}" for height, width in (depth.shape, cube.shape[1:])]
        raise DataError(where, f"a depth map of {sizes[0]} pixels", f"{sizes[1]} as its cube has", "crop one of them")
    # The labels of the pixels are the cube's: a depth map of another file may count them differently.
    plain = depth.drop_vars([name for name in depth.coords if name != UNKNOWN])
    plain = plain.assign_coords({d: cube[d] for d in ("y", "x") if d in cube.coords})
    return xr.Dataset({"radiance": cube, "depth": plain}, attrs=attrs or {})


def scene_parts(path: Path) -> tuple[Path, Path] | None:
    """Cube and depth map of a scene's folder; None where there is no ``cube.*`` or ``spectral.*`` in it.

    Raises:
        DataError: no depth map beside the cube, or several of one part.
    """
    if not path.is_dir() or is_zarr(path):
        return None
    cube = _part(path, CUBE_NAMES)
    if cube is None:
        return None
    depth = _part(path, DEPTH_NAMES)
    if depth is None:
        raise DataError(path, f"no depth.* beside {cube.name}", "a cube and a depth map", "add the depth map")
    return cube, depth


def _part(folder: Path, names: Iterable[str]) -> Path | None:
    """The entry of the folder with one of the names; of an ENVI pair the header."""
    found = [entry for entry in sorted(folder.iterdir()) if entry.stem.lower() in names]
    headers = {entry.with_suffix("") for entry in found if entry.suffix.lower() == ".hdr"}
    data = envi.DATA_SUFFIXES
    found = [e for e in found if e.suffix.lower() not in data or e.is_dir() or e.with_suffix("") not in headers]
    if len(found) > 1:
        there, one = ", ".join(entry.name for entry in found), " or ".join(f"{name}.*" for name in names)
        raise DataError(folder, f"{there} side by side", f"one {one}", "take the others away")
    return found[0] if found else None


def _beside(path: Path) -> tuple[str | None, dict[str, Any]]:
    """The cube's variable in a file that holds a depth map too, None for the only one; and what the file says."""
    with open_contents(path) as contents:
        if "depth" not in contents.arrays:
            there = ", ".join(contents.arrays) or "nothing"
            raise DataError(path, f"no depth in it ({there})", "a cube and depth", "give it depth with place_cube")
        return "radiance" if "radiance" in contents.arrays else None, dict(contents.attrs)


def reduced_scene(scene: xr.Dataset, by: int | None, where: str | Path) -> xr.Dataset:
    """``radiance`` and ``depth`` with ``by`` pixels per axis in one: light averaged, depth sampled at the middle.

    Raises:
        SettingError: not a whole number above 0, or more than the scene has.
    """
    if by is None:
        return scene
    rows, columns = centre_window((scene.sizes["y"], scene.sizes["x"]), None, by, where)
    window = scene.isel(y=rows, x=columns).drop_vars(["y", "x"], errors="ignore")
    size = window.sizes["y"] // by, window.sizes["x"] // by
    small = area_average(window["radiance"].values, size)
    cube = window["radiance"].drop_vars(UNKNOWN, errors="ignore").isel(y=slice(size[0]), x=slice(size[1]))
    kinds = nearest(unknown_kinds(window["depth"]), size)
    depth = labelled_kinds(nearest(window["depth"].values, size), kinds, where)
    return label_spectral_depth(cube.copy(data=small), depth, scene.attrs)


def _made_up(path: Path, wavelengths: Sequence[float] | None, reduce: int | None, **settings: Any) -> xr.Dataset:
    picture = read_rgbd(path, scale=reduce)
    spectra = spectral_from_rgb(picture["rgb"], wavelengths, **settings)
    scene = label_spectral_depth(spectra["radiance"], picture["depth"])
    return scene.assign_attrs({**spectra.attrs, **picture.attrs})
