"""`read_spectral_depth`: spectral scenes with depth, from one labelled file or a folder with a cube and a depth map."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from tmca.data.cubes import Negative, read
from tmca.data.depth_maps import UNKNOWN, label_depth, labelled_kinds, read_depth_map, unknown_kinds
from tmca.data.fitting import centre_window, check_depth_range
from tmca.data.formats import envi
from tmca.data.formats.opening import is_zarr, open_contents
from tmca.data.pixels import area_average, nearest, wrong_size
from tmca.data.point_cloud import scaled_lengths
from tmca.data.rendering.photographs import WHITE, generator, staged_depth
from tmca.data.rendering.pictures import COARSE, Materials, regions_of, smooth_field, spectral_from_rgb
from tmca.data.rgbd import read_rgbd, refuse_rgbd
from tmca.errors import DataError, ShapeError, check_choice

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
        raise wrong_size(where, "a depth map", depth.shape, cube.shape[1:], "its cube has")
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
    entries = [entry for entry in sorted(folder.iterdir()) if entry.stem.lower() in names]
    headers = {entry.with_suffix("") for entry in entries if entry.suffix.lower() == ".hdr"}
    data = envi.DATA_SUFFIXES
    entries = [e for e in entries if e.suffix.lower() not in data or e.is_dir() or e.with_suffix("") not in headers]
    if len(entries) > 1:
        there, one = ", ".join(entry.name for entry in entries), " or ".join(f"{name}.*" for name in names)
        raise DataError(folder, f"{there} side by side", f"one {one}", "take the others away")
    return entries[0] if entries else None


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
    return label_spectral_depth(cube.copy(data=small), depth, scaled_lengths(scene.attrs, by))


def _made_up(path: Path, wavelengths: Sequence[float] | None, reduce: int | None, **settings: Any) -> xr.Dataset:
    picture = read_rgbd(path, scale=reduce)
    spectra = spectral_from_rgb(picture["rgb"], wavelengths, **settings)
    scene = label_spectral_depth(spectra["radiance"], picture["depth"])
    return scene.assign_attrs({**spectra.attrs, **picture.attrs})


Placing = Literal["plane", "slanted", "staged", "smooth", "pieces", "random"]
_PIECES = (3, 9)
Map = NDArray[np.float64]


def place_cube(cube: xr.DataArray, near: float, far: float, seed: int = 0, kind: Placing = "random") -> xr.Dataset:
    """Put a spectral cube at drawn depths from ``near`` to ``far``, evenly in inverse depth.

    Args:
        cube: ``(wavelength, y, x)``, as from `tmca.data.read`.
        near, far: metres.
        seed: draws the depths, together with the cube's name.
        kind: ``"plane"``: one depth everywhere; ``"slanted"``: a plane tilted in a drawn direction from ``far`` to
            ``near``; ``"staged"``: regions of the cube's own picture as tilted planes, the lower in the picture the
            nearer (see `staged_depth`); ``"smooth"``: smooth hills; ``"pieces"``: tilted planes with sharp, straight
            borders that know nothing of the picture; ``"random"``: one of the last two. All but ``"plane"`` reach both
            ends of the range; ``"smooth"`` has every inverse depth equally often.

    Returns:
        A dataset with ``radiance`` (the cube) and ``depth`` ``(y, x)``, float32 metres; attributes ``placed`` (the
        kind), ``placed_seed``, ``near`` and ``far``.

    Raises:
        ShapeError: not a cube.
        SettingError: an impossible range, seed or kind.
    """
    if cube.dims != ("wavelength", "y", "x"):
        raise ShapeError("cube", f"dims {cube.dims}", "(wavelength, y, x)")
    check_choice("kind", kind, get_args(Placing))
    check_depth_range(near, far)
    # Two cubes under one seed shall not get the same depths, and a moved file the same ones as before.
    name = str(cube.attrs.get("name", Path(str(cube.attrs.get("source", ""))).stem))
    rng = generator(crc32(f"placed {name}".encode()), seed)
    if kind == "staged":
        picture = false_colours(cube)
        depth = staged_depth(picture, regions_of(picture, *COARSE), near, far, rng)
    else:
        nearness = drawn_nearness((cube.sizes["y"], cube.sizes["x"]), rng, kind)
        depth = (1 / (1 / far + nearness * (1 / near - 1 / far))).astype(np.float32)
    return _dataset(cube, depth, {"placed": kind, "placed_seed": seed, "near": float(near), "far": float(far)})


def drawn_nearness(shape: tuple[int, int], rng: np.random.Generator, kind: Placing = "random") -> Map:
    """(H, W) inverse depth as a share of the range, 0 = far, 1 = near; kinds of `place_cube` that need no picture.

    Raises:
        SettingError: another kind.
    """
    drawn: Placing = ("smooth", "pieces")[rng.integers(2)] if kind == "random" else kind
    check_choice("kind", drawn, _NEARNESS)
    return _NEARNESS[drawn](shape, rng)


def _dataset(cube: xr.DataArray, depth: NDArray[np.float32], about: dict[str, object]) -> xr.Dataset:
    named = {key: cube.attrs[key] for key in ("name", "source") if key in cube.attrs}
    depths = label_depth(depth, "depth", {"depth_from": f"drawn: {about['placed']}"})
    return label_spectral_depth(cube.astype(np.float32), depths, {**named, **about, "metric": True})


def false_colours(cube: xr.DataArray) -> NDArray[np.float32]:
    """``(H, W, 3)``: means over the long, middle and short thirds of the bands, their 99 % quantile at `WHITE`."""
    order = np.argsort(-cube["wavelength"].values, kind="stable")
    thirds = np.array_split(order, 3) if len(order) >= 3 else [order] * 3
    picture = np.stack([cube.values[third].mean(axis=0) for third in thirds], axis=-1)
    top = float(np.quantile(picture, 0.99))
    return (WHITE * np.clip(picture / (top if top > 0 else 1.0), 0, 1)).astype(np.float32)


def _plane(shape: tuple[int, int], rng: np.random.Generator) -> Map:
    return np.full(shape, rng.random())


def _slanted(shape: tuple[int, int], rng: np.random.Generator) -> Map:
    """A plane in space: inverse depth is linear in the picture."""
    angle = rng.uniform(-np.pi, np.pi)
    y, x = (axis - (n - 1) / 2 for axis, n in zip(np.mgrid[: shape[0], : shape[1]], shape, strict=True))
    return _stretched(np.sin(angle) * y + np.cos(angle) * x)


def _stretched(values: Map) -> Map:
    extent = np.ptp(values)
    return (values - values.min()) / extent if extent > 0 else np.full(values.shape, 0.5)


def _smooth(shape: tuple[int, int], rng: np.random.Generator) -> Map:
    """Hills, ranked so that every level is there equally often."""
    rank = smooth_field(shape, rng).ravel().argsort(kind="stable").argsort(kind="stable")
    return (rank / max(1, rank.size - 1)).reshape(shape)


def _pieces(shape: tuple[int, int], rng: np.random.Generator) -> Map:
    """Tilted planes in the cells of random points; their levels are even, one in each step of the range."""
    count = int(rng.integers(*_PIECES))
    y, x = (axis / max(shape) for axis in np.mgrid[: shape[0], : shape[1]])
    points = rng.random((count, 2)) * shape / max(shape)
    away = (y[..., None] - points[:, 0]) ** 2 + (x[..., None] - points[:, 1]) ** 2
    cell = away.argmin(axis=-1)
    level = (rng.permutation(count) + rng.random(count)) / count
    tilt = rng.normal(0, 0.3, (count, 2))
    return _stretched(level[cell] + tilt[cell, 0] * (y - points[cell, 0]) + tilt[cell, 1] * (x - points[cell, 1]))


_NEARNESS: dict[str, Callable[[tuple[int, int], np.random.Generator], Map]] = {
    "plane": _plane,
    "slanted": _slanted,
    "smooth": _smooth,
    "pieces": _pieces,
}
