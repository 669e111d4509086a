"""Rendered light fields: views of a staged scene with true occlusion and its disparity, without any download."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from tmca.data.axes import pixel_axes
from tmca.data.pixels import encoded
from tmca.data.rendering.photographs import PHOTOGRAPHS, Photograph, generator, linear_rgb, photograph
from tmca.data.rendering.pictures import COARSE
from tmca.data.rendering.scene import origin, regions
from tmca.data.rendering.surfaces import (
    STEEPEST,
    Outline,
    Relief,
    Surface,
    Texture,
    drawn,
    placed,
    render_view,
    silhouettes,
    similarity,
)
from tmca.errors import SettingError, check_range

if TYPE_CHECKING:
    import xarray as xr

SAMPLES = 3
"""Points per pixel and axis: edges have ten levels of coverage."""
MOST_VIEWS, MOST_DISPARITY = 17, 20
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
_VALIDATION = ("chelsea",)
_FINEST = 2.0
"""Most pixels of the photograph per pixel of a view: finer ones would alias between the sampled points."""
_THINGS = (5, 10)
_WAVES = 3


def split_rendered_light_fields() -> dict[str, tuple[str, ...]]:
    """``{"train": names, "validation": names, "test": names}``: no photograph is in two of them.

    The test photographs are those of `split_rendered`; every surface of a light field carries its own photograph only.
    """
    train = tuple(name for name, entry in PHOTOGRAPHS.items() if entry.split == "train" and name not in _VALIDATION)
    test = tuple(name for name, entry in PHOTOGRAPHS.items() if entry.split == "test")
    return {"train": train, "validation": _VALIDATION, "test": test}


def rendered_light_field(
    name: str | Path,
    *,
    views: int = 5,
    size: tuple[int, int] | None = None,
    disparity: tuple[float, float] = (-2.0, 2.0),
    seed: int = 0,
    colour: bool = False,
    linear: bool = False,
) -> xr.Dataset:
    """Render a light field of a photograph, with its true disparity: one of scikit-image's, or one of your own.

    The photograph covers a slanted, gently waved background; before it, at their own disparities and tilts, stand
    silhouettes of the photograph's own regions and drawn shapes, each covered by another part of the photograph,
    turned, mirrored and shaded. Every surface goes on behind those before it, so what a view sees beside an edge is
    texture that is there and not a filled hole. Surfaces are Lambertian; pixels are the mean of 3×3 points, each looked
    up exactly (`render_view`). Beyond its edges the photograph is mirrored; it is never enlarged.

    Args:
        name: one of `rendered_names`, or the path of a photograph (PNG, JPEG, BMP, TIFF; 32×32 pixels or more).
        views: n for n×n views, odd.
        size: (H, W) in pixels; default the photograph's.
        disparity: (lowest, highest) px per view step; all surfaces lie between. The nearest thing reaches the highest;
            where the background reaches the lowest, a thing may stand before it.
        seed: draws the arrangement; another seed is another scene of the same picture.
        colour: red, green and blue (linear sRGB's) instead of their luminance.
        linear: relative irradiance; else it is encoded as sRGB (IEC 61966-2-1), as the pictures of the public light
            fields are stored.

    Returns:
        A dataset with float32 ``light_field`` ``([colour,] view_v, view_u, y, x)`` in [0, 1] and ``disparity``
        ``(y, x)`` of what the centre view shows. Attributes name photograph, split, credit, encoding and seed.

    Raises:
        SettingError: an unknown name, or impossible views, size, range of disparity or seed.
        DataError: a file that is no photograph.

    Warns:
        GreyPhotograph: a photograph without colours.
    """
    _check(views, disparity, size)
    entry = photograph(name, seed)
    height, width = linear_rgb(entry).shape[:2] if size is None else size
    pixels, shown = _render(entry, seed, views, (height, width), disparity, colour)
    pixels = np.moveaxis(pixels if linear else encoded(pixels), 2, 0)
    about = {
        "name": f"{entry.name}_{seed}",
        **origin(entry),
        "split": "validation" if entry in map(PHOTOGRAPHS.get, _VALIDATION) else entry.split,
        "encoding": "linear" if linear else "sRGB",
        "seed": seed,
    }
    return _dataset(pixels if colour else pixels[0], shown, about)


def _render(
    entry: Photograph, seed: int, views: int, frame: tuple[int, int], disparity: tuple[float, float], colour: bool
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Views (V, U, C, H, W) as relative irradiance, and disparity (H, W) of what the centre view shows."""
    surfaces = _staged(entry, frame, disparity, generator(crc32(f"light field {entry.key}".encode()), seed), colour)
    steps = np.arange(views) - (views - 1) / 2
    rendered = [[render_view(surfaces, v, u, frame, SAMPLES) for u in steps] for v in steps]
    pixels = np.clip(np.stack([np.stack([view for view, _ in row]) for row in rendered]), 0, 1)
    return pixels, rendered[views // 2][views // 2][1]


def _check(views: int, disparity: tuple[float, float], size: tuple[int, int] | None) -> None:
    check_range("views", views, 1, MOST_VIEWS, whole=True)
    if views % 2 == 0:
        raise SettingError("views", str(views), "an odd number n, for n×n views")
    if len(disparity) != 2 or not -MOST_DISPARITY <= disparity[0] <= disparity[1] <= MOST_DISPARITY:
        expected = f"(lowest, highest) px per view step, at most {MOST_DISPARITY} either way"
        raise SettingError("disparity", repr(disparity), expected)
    if size is not None and (len(size) != 2 or min(size) < 16):
        raise SettingError("size", repr(size), "(H, W) of 16 px or more each")


def _staged(
    entry: Photograph, frame: tuple[int, int], disparity: tuple[float, float], rng: np.random.Generator, colour: bool
) -> list[Surface]:
    """Background and things of a scene, all within the range of disparity."""
    low, high = disparity
    coefficients = _coefficients(entry, colour)
    floor = _fitted(_floor(rng, frame, 0.4 * (high - low)), None, frame, low, "lowest")
    background = Surface(floor, _background_texture(coefficients, frame, rng))
    fields, surfaces = _silhouettes(entry), [background]
    levels = np.sort(rng.uniform(0.3, 1.0, rng.integers(*_THINGS)))
    for share in [*levels[:-1], 1.0]:
        natural = bool(fields) and rng.random() < 0.5
        field = fields[rng.integers(len(fields))] if natural else drawn(rng)
        extent = min(frame) * rng.uniform(0.2, 0.6)
        inside = [0.5, 0.5] if share == 1.0 else rng.uniform(0.05, 0.95, 2)
        centre = float(inside[0] * frame[0]), float(inside[1] * frame[1])
        outline = placed(field, extent, centre, rng, natural)
        relief = _card(rng, 0.25 * (high - low) * rng.random(), extent, centre)
        relief = _fitted(relief, outline, frame, low + share * (high - low), "highest", low)
        surfaces.append(Surface(relief, _thing_texture(coefficients, rng), outline))
    return surfaces


def _floor(rng: np.random.Generator, frame: tuple[int, int], change: float) -> Relief:
    """A background that comes nearer downwards, as floors and tables do, with faint waves."""
    angle, steep = rng.normal(np.pi / 2, 0.25), min(change / max(frame), 0.5 * STEEPEST)
    frequency = rng.uniform(1.0, 3.0, (_WAVES, 2)) * rng.choice([-1, 1], (_WAVES, 2)) * np.pi / max(frame)
    amplitude = np.minimum(0.06 * change, 0.4 * STEEPEST / _WAVES / np.hypot(*frequency.T))
    waves = np.column_stack([amplitude, frequency, rng.uniform(0, 2 * np.pi, _WAVES)])
    slope = float(steep * np.sin(angle)), float(steep * np.cos(angle))
    return Relief(0.0, slope, waves, (frame[0] / 2, frame[1] / 2))


def _card(rng: np.random.Generator, change: float, extent: float, middle: tuple[float, float]) -> Relief:
    """A plane tilted any way, by ``change`` px per view over its ``extent``."""
    angle, steep = rng.uniform(-np.pi, np.pi), min(change / extent, 0.5 * STEEPEST)
    return Relief(0.0, (float(steep * np.sin(angle)), float(steep * np.cos(angle))), None, middle)


def _fitted(
    relief: Relief, outline: Outline | None, frame: tuple[int, int], value: float, end: str, low: float = -np.inf
) -> Relief:
    """The relief at a level at which its lowest or highest disparity in the centre view is ``value``.

    A thing that would then reach below ``low`` is flattened into a plane that faces the camera.
    """
    y, x = (axis.ravel().astype(np.float64) for axis in np.mgrid[: frame[0], : frame[1]])
    covered = np.ones(y.size, dtype=bool) if outline is None else outline(y, x)
    seen = relief(y[covered], x[covered]) if covered.any() else np.zeros(1)
    level = value - float(seen.min() if end == "lowest" else seen.max())
    if level + seen.min() < low:
        return Relief(value)
    return Relief(level, relief.slope, relief.waves, relief.middle)


def _background_texture(coefficients: NDArray[np.float32], frame: tuple[int, int], rng: np.random.Generator) -> Texture:
    """A part of the photograph, upright, as large as the frame where it can be."""
    shape = coefficients.shape[1:]
    finest = min(_FINEST, max(1.0, min(n / m for n, m in zip(shape, frame, strict=True))))
    scale = rng.uniform(1.0, finest)
    room = [n - 1 - scale * (m - 1) for n, m in zip(shape, frame, strict=True)]
    origin = [rng.uniform(0, r) if r > 0 else r / 2 for r in room]
    return Texture(coefficients, scale * np.eye(2), (float(origin[0]), float(origin[1])))


def _thing_texture(coefficients: NDArray[np.float32], rng: np.random.Generator) -> Texture:
    """Another part of the photograph: turned, mirrored and darker or not."""
    turn = similarity(rng.uniform(1.0, 1.6), rng, np.pi)
    origin = rng.uniform(0, 1, 2) * coefficients.shape[1:]
    return Texture(coefficients * np.float32(rng.uniform(0.45, 1.0)), turn, (float(origin[0]), float(origin[1])))


@lru_cache(maxsize=2)
def _coefficients(entry: Photograph, colour: bool) -> NDArray[np.float32]:
    """Cubic spline coefficients ``(C, h, w)`` of the photograph in linear light."""
    from scipy.ndimage import spline_filter

    rgb = linear_rgb(entry)
    planes = np.moveaxis(rgb, -1, 0) if colour else (rgb @ _LUMINANCE)[None]
    return np.stack([spline_filter(plane, order=3, output=np.float32, mode="mirror") for plane in planes])


@lru_cache(maxsize=4)
def _silhouettes(entry: Photograph) -> list[NDArray[np.float32]]:
    return silhouettes(regions(entry, *COARSE))


def _dataset(pixels: NDArray[np.float32], disparity: NDArray[np.float32], about: dict[str, Any]) -> xr.Dataset:
    import xarray as xr

    from tmca.data.light_fields import label_light_field

    height, width = disparity.shape
    light_field = label_light_field(pixels, {"name": about["name"], "source": "rendered", "pattern": "rendered"})
    truth = (("y", "x"), disparity, {"units": "px per view step", "long_name": "disparity, positive = nearer"})
    return xr.Dataset({"light_field": light_field, "disparity": truth}, pixel_axes(height, width), about)
