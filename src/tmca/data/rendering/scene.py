"""Rendered scenes: a photograph turned into a spectral cube with depth, without any download."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from tmca.data.rendering import measured
from tmca.data.rendering.depth import motorcycle_depth, staged_depth
from tmca.data.rendering.metamers import (
    ColourModel,
    black_amplitudes,
    colour_model,
    project,
    region_materials,
)
from tmca.data.rendering.photographs import WHITE, linear_rgb, photograph
from tmca.data.rendering.resample import area_average, centre_crop, nearest
from tmca.errors import SettingError

if TYPE_CHECKING:
    import xarray as xr

_FINE, COARSE = (100.0, 60, 1), (300.0, 300, 2)


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
    centres = _checked_wavelengths(wavelengths)
    rgb = linear_rgb(name)
    crop = centre_crop((rgb.shape[0], rgb.shape[1]), size)
    light_name = entry.illuminant if illuminant is None else illuminant
    weights, light = band_weights(centres), measured.illuminant(light_name)
    bands = np.concatenate([weights, weights * light / (weights @ light).max()])
    spectral, depth = _render(name, seed, crop, bands)
    if size is not None:
        spectral, depth = area_average(spectral, size), nearest(depth, size)
    # Rounding of the averages may leave [0, 1] by a unit in the last place.
    reflectance, radiance = np.split(spectral.clip(0, 1), 2)
    return _dataset(
        {"radiance": radiance, "reflectance": reflectance, "depth": depth},
        centres,
        (weights @ light / (weights @ light).max()).astype(np.float32),
        {
            "name": name,
            "photograph": f"skimage.data.{entry.source}",
            "credit": entry.credit,
            "split": entry.split,
            "illuminant": light_name,
            "depth_source": entry.depth,
            "white_reflectance": WHITE,
            "seed": seed,
        },
    )


def band_weights(wavelengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(L, 61)`` shares of the 5 nm samples in each band, boxes half-way to neighbours; rows sum to 1."""
    centres = wavelengths * 1e9
    spacing = np.diff(centres) if len(centres) > 1 else np.array([10.0])
    edges = np.concatenate([[spacing[0]], spacing]), np.concatenate([spacing, [spacing[-1]]])
    low, high = centres - edges[0] / 2, centres + edges[1] / 2
    grid, step = measured.GRID_NM, measured.GRID_NM[1] - measured.GRID_NM[0]
    # Bands narrower than a sample take the interpolated value: triangles shared between two samples.
    fine = low[:, None] + (np.arange(16) + 0.5) / 16 * (high - low)[:, None]
    shares = np.maximum(1 - np.abs(fine.clip(grid[0], grid[-1])[:, :, None] - grid) / step, 0)
    return shares.mean(axis=1)


def _render(
    name: str, seed: int, crop: tuple[slice, slice], bands: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Bands ``(C, H, W)`` and depth ``(H, W)`` of the cropped photograph at its own resolution."""
    entry, rgb = photograph(name), linear_rgb(name)
    rng = _generator(name, seed)
    labels, model = regions(name, *_FINE), _model(entry.split)
    materials = region_materials(model, rgb.astype(np.float64), labels, rng)
    amplitudes = black_amplitudes(labels, rng)
    spectral = project(model, rgb[crop], labels[crop], materials, amplitudes[crop], bands)
    if entry.depth == "measured":
        depth = motorcycle_depth()
    else:
        depth = staged_depth(rgb, regions(name, *COARSE), entry, rng)
    return spectral, depth[crop]


def _generator(name: str, seed: int) -> np.random.Generator:
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise SettingError("seed", repr(seed), "an integer, 0 or more")
    return np.random.default_rng([crc32(name.encode()), int(seed)])


@lru_cache(maxsize=2)
def _model(split: Any) -> ColourModel:
    return colour_model(measured.reflectances(split))


@lru_cache(maxsize=4)
def regions(name: str, scale: float, smallest: int, step: int) -> NDArray[np.intp]:
    """Regions of the photograph, numbered from 0, found on every ``step``-th pixel.

    Source: Felzenszwalb & Huttenlocher's graph-based segmentation, IJCV 59(2), 2004.
    """
    from skimage.segmentation import felzenszwalb

    rgb = linear_rgb(name)
    encoded = (rgb[::step, ::step] / WHITE) ** (1 / 2.2)
    labels = felzenszwalb(encoded, scale=scale, sigma=0.8, min_size=smallest)
    whole: NDArray[np.intp] = labels.repeat(step, 0).repeat(step, 1)[: rgb.shape[0], : rgb.shape[1]]
    return whole


def _checked_wavelengths(wavelengths: Sequence[float] | NDArray[Any] | None) -> NDArray[np.float64]:
    if wavelengths is None:
        return np.arange(400.0, 701.0, 10.0) * 1e-9
    centres = np.asarray(wavelengths, dtype=np.float64)
    inside = centres.ndim == 1 and centres.size > 0 and bool(np.all((centres > 399.9e-9) & (centres < 700.1e-9)))
    if not inside or np.any(np.diff(centres) <= 0):
        raise SettingError(
            "wavelengths",
            f"{np.array2string(centres.ravel(), threshold=6)}",
            "ascending band centres between 400e-9 and 700e-9 metres",
            "multiply nanometres by 1e-9",
        )
    return centres


def _dataset(
    variables: dict[str, NDArray[np.float32]],
    wavelengths: NDArray[np.float64],
    light: NDArray[np.float32],
    attributes: dict[str, Any],
) -> xr.Dataset:
    import xarray as xr

    dims = ("wavelength", "y", "x")
    height, width = variables["depth"].shape
    notes = {"radiance": "1", "reflectance": "1", "depth": "m"}
    data: dict[str, Any] = {key: (dims[-v.ndim :], v, {"units": notes[key]}) for key, v in variables.items()}
    data["illuminant"] = ("wavelength", light, {"units": "1"})
    coordinates = {
        "wavelength": ("wavelength", wavelengths, {"units": "m"}),
        "y": ("y", np.arange(height), {"units": "pixel"}),
        "x": ("x", np.arange(width), {"units": "pixel"}),
    }
    return xr.Dataset(data, coordinates, attributes)
