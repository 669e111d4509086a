"""Rendered scenes: a photograph turned into a spectral cube with depth, without any download."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from tmca.data.axes import pixel_axes
from tmca.data.pixels import area_average, centre_crop, nearest
from tmca.data.rendering.photographs import WHITE, linear_rgb, motorcycle_depth, photograph, staged_depth
from tmca.data.rendering.pictures import (
    COARSE,
    FINE,
    checked_wavelengths,
    generator,
    label_spectra,
    lit_bands,
    regions_of,
    spectra_of,
)

if TYPE_CHECKING:
    import xarray as xr


def rendered_scene(
    name: str,
    *,
    wavelengths: Sequence[float] | NDArray[Any] | None = None,
    size: tuple[int, int] | None = None,
    illuminant: str | None = None,
    seed: int = 0,
) -> xr.Dataset:
    """Render one of scikit-image's photographs as a spectral scene with depth.

    The photograph's colours are kept: they are those of the rendered reflectance under D65. Its spectra are
    mixtures of measured reflectances, chosen region by region, with metameric variation, so that one colour
    has many spectra. Rendering happens at the photograph's own size; a smaller ``size`` is a centre crop to
    its proportions followed by area averaging (depth is sampled instead). Each band is the mean over its
    width, half-way to its neighbours.

    Args:
        name: one of :func:`rendered_names`.
        wavelengths: band centres in metres, ascending, within 400–700 nm; default 400–700 nm every 10 nm.
        size: ``(H, W)`` in pixels, at most the photograph's; default the photograph's.
        illuminant: name of a colour-science illuminant ("D65", "A", "LED-B3", …); default the scene's own.
        seed: draws materials and staged depth; another seed is another scene of the same picture.

    Returns:
        A dataset with float32 variables ``radiance`` and ``reflectance`` ``(wavelength, y, x)`` in [0, 1],
        ``illuminant`` ``(wavelength)`` with its brightest band at 1, and ``depth`` ``(y, x)`` in metres
        (``nan`` where it is unknown). Attributes name photograph, split, illuminant, credit, source of
        the depth and seed.

    Raises:
        SettingError: an unknown name or illuminant, or an impossible size, seed or list of wavelengths.
    """
    entry = photograph(name)
    centres = checked_wavelengths(wavelengths)
    rgb = linear_rgb(name)
    crop = centre_crop((rgb.shape[0], rgb.shape[1]), size)
    light_name = entry.illuminant if illuminant is None else illuminant
    bands, light = lit_bands(centres, light_name)
    spectral, depth = _render(name, seed, crop, bands)
    if size is not None:
        spectral, depth = area_average(spectral, size), nearest(depth, size)
    about = {
        "name": name,
        "photograph": f"skimage.data.{entry.source}",
        "credit": entry.credit,
        "split": entry.split,
        "illuminant": light_name,
        "depth_source": entry.depth,
        "white_reflectance": WHITE,
        "seed": seed,
    }
    metres = {"units": "m", "long_name": "depth"}
    scene = label_spectra(spectral, centres, light, about).assign(depth=(("y", "x"), depth, metres))
    return scene.assign_coords(pixel_axes(scene.sizes["y"], scene.sizes["x"]))


def _render(
    name: str, seed: int, crop: tuple[slice, slice], bands: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Bands ``(C, H, W)`` and depth ``(H, W)`` of the cropped photograph at its own resolution."""
    entry, rgb = photograph(name), linear_rgb(name)
    rng = generator(crc32(name.encode()), seed)
    spectral = spectra_of(rgb, regions(name, *FINE), entry.split, rng, bands, crop)
    if entry.depth == "measured":
        depth = motorcycle_depth()
    else:
        depth = staged_depth(rgb, regions(name, *COARSE), entry.near, entry.far, rng)
    return spectral, depth[crop]


@lru_cache(maxsize=32)
def regions(name: str, scale: float, smallest: int, step: int) -> NDArray[np.intp]:
    """Regions of the photograph; see `regions_of`."""
    return regions_of(linear_rgb(name), scale, smallest, step)
