"""Scenes for experiments: files, or rendered ones by name, brought to the bands and the size of a camera."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING
from warnings import warn

import numpy as np

from tmca.errors import DataError, SettingError

if TYPE_CHECKING:
    import xarray as xr

    from tmca.data import Negative


class SceneWarning(UserWarning):
    """What is odd about a scene, said when it is read."""


class DarkScene(SceneWarning):
    """A scene without light."""


def load_scene(
    source: str | Path,
    *,
    bands: int | None = 12,
    size: tuple[int, int] | None = None,
    wavelengths: Sequence[float] | None = None,
    variable: str | None = None,
    scale: float | None = None,
    negative: Negative = "error",
) -> xr.DataArray:
    """A spectral cube of ``bands`` bands.

    Args:
        source: a file or folder that ``tmca.data.read`` reads, or the name of a rendered scene (``coffee``).
        bands: number of bands, nearest to even spacing from 400 to 700 nm; None keeps all bands.
        size: (H, W) centre crop; None keeps the whole scene.
        wavelengths: of the file's bands, metres, where the file does not say.
        variable: which one, where the file holds several.
        scale: stored value that is relative irradiance 1; see ``tmca.data.read``.
        negative: what is done with negative pixels of a file: ``"error"``, ``"clip"`` to 0, or ``"keep"``.

    Returns:
        (wavelength, y, x) relative irradiance with a coordinate ``wavelength`` in metres; attribute ``name``.

    Raises:
        DataError: no such file or scene, or a file that cannot be used.
        SettingError: a crop larger than the scene.
    """
    from tmca.data import read, refuse_rgbd, rendered_names, rendered_scene, select_bands

    name = str(source)
    if not Path(name).exists() and name in rendered_names():
        cube = rendered_scene(name)["radiance"]
    elif not Path(name).exists() and not Path(name).suffix:
        refuse_rgbd(name)
        raise DataError(
            name, "no such file, folder or rendered scene", f"a path, or one of {', '.join(rendered_names())}"
        )
    else:
        cube = read(name, wavelengths=wavelengths, variable=variable, scale=scale, negative=negative)
    if bands is not None:
        cube = select_bands(cube, bands)
    cube = cube if size is None else centre_crop(cube, size, name)
    cube.attrs["name"] = Path(name).stem
    if not cube.values.any():
        warn(f"{name}: every pixel is zero", DarkScene, stacklevel=2)
    return cube


def check_readable(scenes: Iterable[str | Path], bands: int, size: tuple[int, int] | None = None) -> None:
    """Read every scene as later work will, so that one that cannot be used is named before anything is made.

    Args:
        scenes: names that ``load_scene`` understands.
        bands, size: as for ``load_scene``.

    Raises:
        DataError, SettingError: as ``load_scene``.
    """
    for scene in dict.fromkeys(map(str, scenes)):
        load_scene(scene, bands=bands, size=size)


def at_bands(cube: xr.DataArray, wavelengths: Sequence[float]) -> xr.DataArray:
    """The cube's nearest band for every wavelength.

    Raises:
        DataError: a wavelength farther from every band than half their spacing.
    """
    own = cube["wavelength"].values
    wanted = np.asarray(wavelengths)
    if len(own) == len(wanted) and np.allclose(own, wanted, rtol=1e-6):
        return cube
    chosen = np.abs(own[:, None] - wanted).argmin(0)
    spacing = np.diff(own).max() if len(own) > 1 else 20e-9
    worst = int(np.abs(own[chosen] - wanted).argmax())
    if abs(own[chosen][worst] - wanted[worst]) > spacing / 2 * (1 + 1e-6) or len(set(chosen)) < len(wanted):
        found = f"bands from {own[0] * 1e9:.0f} to {own[-1] * 1e9:.0f} nm"
        raise DataError(cube.attrs.get("source", "cube"), found, f"one near {wanted[worst] * 1e9:.0f} nm")
    return cube.isel(wavelength=chosen).assign_coords(wavelength=("wavelength", wanted, {"units": "m"}))


def identity_of(source: str) -> str | None:
    """Checksum of a scene's file, of a folder's files, or of an RGB-D scene's, which a stem may name; of every scene of
    a split; None for a rendered scene, or one that is not there."""
    from tmca.data import checksum_of, read_split, rendered_names, rgbd_sources

    path = Path(source)
    if path.suffix == ".txt" and path.is_file():
        return " ".join(str(identity_of(str(scene))) for scene in read_split(path))
    if not path.exists() and source in rendered_names():
        return None
    files = sorted(file for file in path.iterdir() if file.is_file()) if path.is_dir() else rgbd_sources(path)
    if path.is_dir() or files:
        parts = [f"{file.name} {checksum_of(file)}" for file in files]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()
    return checksum_of(path) if path.is_file() else None


def short_names(scenes: Sequence[str]) -> dict[str, str]:
    """A short name for every scene, longer where two would be the same.

    Raises:
        SettingError: a scene that is named twice.
    """
    if len(set(scenes)) < len(scenes):
        raise SettingError("scenes", "one that is named twice", "different scenes")
    stems = [Path(scene).name if Path(scene).is_dir() else Path(scene).stem for scene in scenes]
    return {
        scene: stem if stems.count(stem) == 1 else str(Path(scene).with_suffix(""))
        for scene, stem in zip(scenes, stems, strict=True)
    }


def centre_crop(cube: xr.DataArray, size: tuple[int, int], where: str) -> xr.DataArray:
    """The middle (H, W) of a cube.

    Raises:
        SettingError: the crop is larger than the cube.
    """
    height, width = cube.shape[1:]
    if size[0] > height or size[1] > width or min(size) < 1:
        raise SettingError("crop", f"{size[0]}x{size[1]}", f"at most the {height}x{width} pixels of {where}")
    top, left = (height - size[0]) // 2, (width - size[1]) // 2
    return cube[:, top : top + size[0], left : left + size[1]]
