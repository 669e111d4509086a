"""Rendered scenes: a photograph turned into a spectral cube with depth, without any download."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from tmca.data.axes import pixel_axes
from tmca.data.pixels import area_average, centre_crop, nearest
from tmca.data.rendering.lighting import Light, lit
from tmca.data.rendering.photographs import (
    WHITE,
    Photograph,
    generator,
    linear_rgb,
    motorcycle_depth,
    photograph,
    staged_depth,
)
from tmca.data.rendering.pictures import (
    COARSE,
    FINE,
    checked_wavelengths,
    label_spectra,
    lit_bands,
    regions_of,
    spectra_of,
)
from tmca.errors import check_choice

if TYPE_CHECKING:
    import xarray as xr


_VARIETY: dict[Light, float] = {"flat": 1.0, "drawn": 2.0}
"""Of metamers: under drawn light so that no colour tells as much as of real cubes."""


def rendered_scene(
    name: str | Path,
    *,
    wavelengths: Sequence[float] | NDArray[Any] | None = None,
    size: tuple[int, int] | None = None,
    illuminant: str | None = None,
    seed: int = 0,
    light: Light = "flat",
) -> xr.Dataset:
    """Render a photograph as a spectral scene with depth: one of scikit-image's, or one of your own.

    The photograph's colours are kept: they are those of the rendered reflectance under D65. Its spectra are
    mixtures of measured reflectances, chosen region by region, with metameric variation, so that one colour
    has many spectra. Rendering happens at the photograph's own size (halved while a side is above 1000 pixels);
    a smaller ``size`` is a centre crop to its proportions followed by area averaging (depth is sampled instead).
    Each band is the mean over its width, half-way to its neighbours.

    Args:
        name: one of :func:`rendered_names`, or the path of a photograph (PNG, JPEG, BMP, TIFF; 32×32 pixels or more),
            whose illuminant and depth range are drawn by its content and the seed.
        wavelengths: band centres in metres, ascending, within 400–700 nm; default 400–700 nm every 10 nm.
        size: ``(H, W)`` in pixels, at most the photograph's; default the photograph's.
        illuminant: name of a colour-science illuminant ("D65", "A", "LED-B3", …); default the scene's own.
        seed: draws materials and staged depth; another seed is another scene of the same picture.
        light: ``"flat"``, on everything alike, which adds nothing to what the photograph shows; or ``"drawn"``: a lamp
            from the side with shading, shadows, highlights and an exposure that are drawn, and often a dark background,
            as cubes of the laboratory have them.

    Returns:
        A dataset with float32 variables ``radiance`` and ``reflectance`` ``(wavelength, y, x)`` in [0, 1],
        ``illuminant`` ``(wavelength)`` with its brightest band at 1, and ``depth`` ``(y, x)`` in metres
        (``nan`` where it is unknown). Attributes name photograph, split, illuminant, credit, source of
        the depth and seed.

    Raises:
        SettingError: an unknown name, light or illuminant, or an impossible size, seed or list of wavelengths.
        DataError: a file that is no photograph.

    Warns:
        GreyPhotograph: a photograph without colours.
    """
    check_choice("light", light, get_args(Light))
    entry, centres = photograph(name, seed), checked_wavelengths(wavelengths)
    rgb = linear_rgb(entry)
    crop = centre_crop((rgb.shape[0], rgb.shape[1]), size)
    light_name = entry.illuminant if illuminant is None else illuminant
    bands, spectrum = lit_bands(centres, light_name)
    spectral, depth = _render(entry, seed, crop, bands, _VARIETY[light])
    about = {
        "name": entry.name,
        **origin(entry),
        "split": entry.split,
        "illuminant": light_name,
        "depth_source": entry.depth,
        "white_reflectance": WHITE,
        "seed": seed,
    }
    if light == "drawn":
        rng = generator(crc32(f"light {entry.key}".encode()), seed)
        spectral = lit(spectral, spectrum, depth, regions(entry, *COARSE)[crop], rng)
        about["light"] = light
    if size is not None:
        spectral, depth = area_average(spectral, size), nearest(depth, size)
    metres = {"units": "m", "long_name": "depth"}
    scene = label_spectra(spectral, centres, spectrum, about).assign(depth=(("y", "x"), depth, metres))
    return scene.assign_coords(pixel_axes(scene.sizes["y"], scene.sizes["x"]))


def origin(entry: Photograph) -> dict[str, str]:
    """Attributes that say which photograph it is; of a file its name and the checksum of its pixels."""
    if not entry.content:
        return {"photograph": entry.source, "credit": entry.credit}
    return {"photograph": Path(entry.source).name, "content": entry.content}


def _render(
    entry: Photograph, seed: int, crop: tuple[slice, slice], bands: NDArray[np.float64], variety: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Bands ``(C, H, W)`` and depth ``(H, W)`` of the cropped photograph at its own resolution."""
    rgb = linear_rgb(entry)
    rng = generator(crc32(entry.key.encode()), seed)
    spectral = spectra_of(rgb, regions(entry, *FINE), entry.split, rng, bands, crop, variety)
    if entry.depth == "measured":
        depth = motorcycle_depth()
    else:
        depth = staged_depth(rgb, regions(entry, *COARSE), entry.near, entry.far, rng)
    return spectral, depth[crop]


@lru_cache(maxsize=16)
def regions(entry: Photograph, scale: float, smallest: int, step: int) -> NDArray[np.intp]:
    """Regions of the photograph; see `regions_of`."""
    return regions_of(linear_rgb(entry), scale, smallest, step)
