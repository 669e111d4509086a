"""`read_scene`: scenes of every camera, from files or rendered ones by name; and spectral cubes of so many bands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args
from warnings import warn

from tmca.arguments import Float, Floats, Int, IntPair, checked
from tmca.data.cubes import Negative, read
from tmca.data.depth_scenes import load_spectral_depth
from tmca.data.describe import depth_in
from tmca.data.fitting import VISIBLE, bands_within, middle_of, select_bands, usual_span
from tmca.data.formats.opening import open_contents
from tmca.data.light_field_scenes import load_light_field
from tmca.data.light_fields import find_light_field, not_spectral
from tmca.data.rendering import is_rendered, rendered_scene
from tmca.data.rendering.photographs import no_such_scene
from tmca.data.rgbd import holds_rgbd, refuse_rgbd
from tmca.data.scene_names import SOURCE_BANDS, SceneWarning
from tmca.data.spectral_depth import scene_parts
from tmca.errors import SettingError, check_choice

if TYPE_CHECKING:
    import xarray as xr

Kind = Literal["spectral", "light-field", "spectral-depth"]
SCENE_KINDS: tuple[Kind, ...] = get_args(Kind)
"""Cameras that scenes are read for."""
Bands = Int | Literal["up to 12"]


class DarkScene(SceneWarning):
    """A scene without light."""


@checked
def read_scene(source: str | Path, kind: Kind | None = None, **reading: Any) -> xr.DataArray | xr.Dataset:
    """A scene for any camera.

    Args:
        source: a file or folder, or the name of a rendered scene (``coffee``).
        kind: of the camera: ``"spectral"``, ``"light-field"`` or ``"spectral-depth"``; without, what the file is: a
            light field, a scene with depth, or else a cube, as rendered scenes are.
        reading: how it is read. For every camera ``size``: (H, W) pixels, the middle of the scene (``--crop``).
            Spectral: ``bands``, how many (None: all), ``range``, (first, last) metres that they are taken from,
            ``wavelengths`` of the file, metres, ``variable`` of several, ``scale``, the stored value of white,
            ``negative``. Light field: ``views``, n of the centre n×n (None: all), ``scale``, so many pixels per axis
            averaged into one, ``colour``, ``pattern``, ``lens``. With depth: ``wavelengths``, metres, ``near`` and
            ``far`` of the camera's range, metres, ``reduce``, so many pixels per axis averaged into one,
            ``fitted=False``, which keeps metres, ``placed``, ``from_rgb``, ``materials``. `tmca.data.load_scene`,
            `load_light_field` and `load_spectral_depth` say more.

    Returns:
        (wavelength, y, x) relative irradiance; (view_v, view_u, y, x) or with colours first; or a dataset of
        ``radiance`` and ``depth`` in metres.

    Raises:
        DataError: no such file or scene, or one that cannot be used.
        SettingError: an unknown kind, or an unknown argument, one of another type, or that the scene does not allow.
    """
    readers: dict[str, Callable[..., xr.DataArray | xr.Dataset]] = {
        "spectral": load_scene, "light-field": load_light_field, "spectral-depth": load_spectral_depth,
    }  # fmt: skip
    chosen = scene_kind(source) if kind is None else kind
    check_choice("kind", chosen, readers)
    return readers[chosen](str(source), **reading)


def scene_kind(source: str | Path) -> Kind:
    """Which camera a scene is for, as its files say.

    Raises:
        DataError: a file that cannot be opened.
    """
    if holds_rgbd(source):
        return "spectral-depth"
    if not Path(source).exists():
        return "spectral"
    if scene_parts(Path(source)) is not None:
        return "spectral-depth"
    with open_contents(source) as contents:
        if find_light_field(contents) is not None:
            return "light-field"
        return "spectral-depth" if "pixels" in (depth_in(contents) or {}) else "spectral"


@checked
def load_scene(
    source: str | Path,
    *,
    bands: Bands | None = "up to 12",
    range: Floats | None = None,
    size: IntPair | None = None,
    wavelengths: Floats | None = None,
    variable: str | None = None,
    scale: Float | None = None,
    negative: Negative = "error",
) -> xr.DataArray:
    """A spectral cube of ``bands`` bands.

    Args:
        source: a file or folder that ``tmca.data.read`` reads, or the name of a rendered scene (``coffee``).
        bands: number of bands, nearest to even spacing over the range; None keeps all bands, and so does
            ``"up to 12"`` of a file with fewer.
        range: (first, last) wavelength that bands are taken from, metres; 400 to 700 nm without it, or all where all
            bands are kept. With ``"up to 12"`` of a cube that does not cover these it is what the cube covers.
        size: (H, W) centre crop; None keeps the whole scene.
        wavelengths: of the file's bands, metres, where the file does not say.
        variable: which one, where the file holds several.
        scale: stored value that is relative irradiance 1; see ``tmca.data.read``.
        negative: what is done with negative pixels of a file: ``"error"``, ``"clip"`` to 0, or ``"keep"``.

    Returns:
        (wavelength, y, x) relative irradiance with a coordinate ``wavelength`` in metres; attributes ``name``, and
        ``source_bands``, how many bands there are, where only some of them are taken.

    Raises:
        DataError: no such file or scene, or a file that cannot be used.
        SettingError: a crop larger than the scene, an unknown argument, or one of another type.
    """
    name = str(source)
    if is_rendered(name):
        cube = rendered_scene(name)["radiance"]
    elif not Path(name).exists() and not Path(name).suffix:
        refuse_rgbd(name)
        raise no_such_scene(name)
    else:
        cube = read(name, wavelengths=wavelengths, variable=variable, scale=scale, negative=negative)
        if "view_v" in cube.dims:
            raise not_spectral(name)
    there = cube.sizes["wavelength"]
    cube = _banded(cube, bands, None if range is None else _span(range))
    if cube.sizes["wavelength"] < there:
        cube.attrs[SOURCE_BANDS] = there
    cube = cube if size is None else middle_of(cube, size, name)
    cube.attrs["name"] = Path(name).stem
    if not cube.values.any():
        warn(f"{name}: every pixel is zero", DarkScene, stacklevel=2)
    return cube


def _span(given: Sequence[float]) -> tuple[float, float]:
    """Raises SettingError unless it is a range of wavelengths."""
    if len(given) != 2 or not 0 < given[0] < given[1] < float("inf"):
        raise SettingError("range", repr(tuple(given)), "(first, last) wavelength in metres, the first below the last")
    return given[0], given[1]


def _banded(cube: xr.DataArray, bands: int | str | None, span: tuple[float, float] | None) -> xr.DataArray:
    """The bands that are asked for."""
    inside = cube if span is None or isinstance(bands, int) else bands_within(cube, span)
    if bands == "up to 12":
        bands = 12 if inside.sizes["wavelength"] >= 12 else None
        if bands is not None and span is None:
            span = usual_span({str(cube.attrs.get("source", "cube")): cube["wavelength"].values})
    return inside if not isinstance(bands, int) else select_bands(cube, bands, span or VISIBLE)
