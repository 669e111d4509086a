"""Spectra for any linear RGB picture: its regions, and what measured materials they are given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from tmca.data.axes import WAVELENGTH
from tmca.data.pixels import encoded
from tmca.data.rendering import measured
from tmca.data.rendering.measured import primaries, rgb_observer
from tmca.data.rendering.photographs import WHITE, generator
from tmca.errors import DataError, SettingError, ShapeError, check_choice

if TYPE_CHECKING:
    import xarray as xr

Materials = Literal["train", "test"]
FINE, COARSE = (100.0, 60, 1), (300.0, 300, 2)
"""How coarse the regions are: of one material, and of one distance."""


def spectral_from_rgb(
    rgb: xr.DataArray | NDArray[np.float32],
    wavelengths: Sequence[float] | NDArray[Any] | None = None,
    seed: int = 0,
    *,
    illuminant: str = "D65",
    materials: Materials = "train",
) -> xr.Dataset:
    """Make up spectra for a linear RGB picture: those of measured reflectances, with metameric variation.

    As in `tmca.data.rendered_scene`: every region of the picture is given a mixture of measured reflectances of about
    its colour, which differs from region to region and from seed to seed, and metameric blacks vary within it. The
    spectra are therefore no function of RGB, and a camera that sees RGB does not get them for nothing. The colours
    stay: under D65 the reflectance shows ``0.9 · rgb`` (the brightest real surfaces reflect about 0.9).

    Args:
        rgb: ``(colour, y, x)`` or ``(3, H, W)``, linear sRGB in [0, 1].
        wavelengths: band centres in metres, ascending, within 400–700 nm; default 400–700 nm every 10 nm.
        seed: draws the materials; together with the picture itself, so that two pictures never share draws.
        illuminant: name of a colour-science illuminant ("D65", "A", "LED-B3", …).
        materials: the half of the measured reflectances to draw from; no material is in both.

    Returns:
        A dataset with float32 ``radiance`` and ``reflectance`` ``(wavelength, y, x)`` in [0, 1] and ``illuminant``
        ``(wavelength)`` with its brightest band at 1. Attributes name the illuminant, the seed and the materials.

    Raises:
        ShapeError: not a picture of three colours.
        DataError: NaN, or values outside [0, 1].
        SettingError: an unknown illuminant or half, or an impossible seed or list of wavelengths.
    """
    picture, centres = _checked_picture(rgb), checked_wavelengths(wavelengths)
    check_choice("materials", materials, ("train", "test"))
    content = crc32(np.rint(255 * encoded(picture)).astype(np.uint8).tobytes())
    bands, light = lit_bands(centres, illuminant)
    picture = np.float32(WHITE) * picture
    labels = regions_of(picture, *FINE)
    spectral = spectra_of(picture, labels, materials, generator(content, seed), bands)
    about = {"illuminant": illuminant, "white_reflectance": WHITE, "spectra_seed": seed, "materials": materials}
    about["spectra"] = "made up from RGB: measured reflectances with metameric variation"
    return label_spectra(spectral, centres, light, about)


def label_spectra(
    spectral: NDArray[np.float32], wavelengths: NDArray[np.float64], light: NDArray[np.float32], attrs: dict[str, Any]
) -> xr.Dataset:
    """Reflectance and radiance ``(2L, H, W)``, wavelengths in metres and light ``(L,)`` as one dataset."""
    import xarray as xr

    # Rounding of averages may leave [0, 1] by a unit in the last place.
    reflectance, radiance = np.split(spectral.clip(0, 1), 2)
    dims = ("wavelength", "y", "x")
    variables = {
        "radiance": (dims, radiance, {"units": "1", "long_name": "relative irradiance"}),
        "reflectance": (dims, reflectance, {"units": "1", "long_name": "reflectance"}),
        "illuminant": ("wavelength", light, {"units": "1", "long_name": "light, relative to its brightest band"}),
    }
    coords = {"wavelength": ("wavelength", wavelengths, WAVELENGTH)}
    return xr.Dataset(variables, coords, attrs)


def _checked_picture(rgb: xr.DataArray | NDArray[np.float32]) -> NDArray[np.float32]:
    """``(H, W, 3)`` float32."""
    values = np.asarray(rgb, dtype=np.float32)
    if values.ndim != 3 or len(values) != 3 or not values.size:
        raise ShapeError("rgb", f"shape {values.shape}", "(3, H, W): linear red, green and blue")
    low, high = float(values.min()), float(values.max())
    if not (low >= 0 and high <= 1):
        raise DataError("rgb", f"values from {low:g} to {high:g}", "linear sRGB in [0, 1]", "divide it by its white")
    return np.ascontiguousarray(np.moveaxis(values, 0, -1))


def regions_of(rgb: NDArray[np.float32], scale: float, smallest: int, step: int) -> NDArray[np.intp]:
    """Regions of a linear picture ``(H, W, 3)`` with white at `WHITE`, from 0, found on every ``step``-th pixel.

    Source: Felzenszwalb & Huttenlocher's graph-based segmentation, IJCV 59(2), 2004.
    """
    from skimage.segmentation import felzenszwalb

    curved = (rgb[::step, ::step] / WHITE) ** (1 / 2.2)
    labels = felzenszwalb(curved, scale=scale, sigma=0.8, min_size=smallest)
    whole: NDArray[np.intp] = labels.repeat(step, 0).repeat(step, 1)[: rgb.shape[0], : rgb.shape[1]]
    return whole


def spectra_of(
    rgb: NDArray[np.float32],
    labels: NDArray[np.intp],
    materials: Materials,
    rng: np.random.Generator,
    bands: NDArray[np.float64],
    crop: tuple[slice, slice] = (slice(None), slice(None)),
    variety: float = 1.0,
) -> NDArray[np.float32]:
    """Bands ``(C, H, W)`` of the cropped picture, its regions filled with materials.

    Args:
        rgb: ``(H, W, 3)``, linear, in [0, 1].
        labels: ``(H, W)`` regions numbered from 0.
        materials: the half of the measured reflectances to draw from.
        rng: draws materials and metamers.
        bands: ``(C, 61)`` weights that turn a reflectance into band values.
        crop: the part that is wanted.
        variety: of the metamers; 1 is that of the measured reflectances, had each its region.
    """
    model = _model(materials)
    mixtures = region_materials(model, rgb.astype(np.float64), labels, rng)
    amplitudes = np.float32(variety) * black_amplitudes(labels, rng)
    return project(model, rgb[crop], labels[crop], mixtures, amplitudes[crop], bands)


@lru_cache(maxsize=2)
def _model(materials: Materials) -> ColourModel:
    return colour_model(measured.reflectances(materials))


def lit_bands(wavelengths: NDArray[np.float64], illuminant: str) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Weights ``(2L, 61)`` of reflectance and of radiance in the bands; the light ``(L,)``, its brightest band at 1."""
    weights, light = band_weights(wavelengths), measured.illuminant(illuminant)
    seen = weights @ light
    return np.concatenate([weights, weights * light / seen.max()]), (seen / seen.max()).astype(np.float32)


def band_weights(wavelengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(L, 61)`` shares of the 5 nm samples in each band, boxes half-way to neighbours, 10 nm alone; rows sum to 1."""
    centres = wavelengths * 1e9
    gaps = np.pad(np.diff(centres), 1, mode="edge") if len(centres) > 1 else np.full(2, 10.0)
    low, high = centres - gaps[:-1] / 2, centres + gaps[1:] / 2
    grid, step = measured.GRID_NM, measured.GRID_NM[1] - measured.GRID_NM[0]
    # Bands narrower than a sample take the interpolated value: triangles shared between two samples.
    fine = low[:, None] + (np.arange(16) + 0.5) / 16 * (high - low)[:, None]
    shares = np.maximum(1 - np.abs(fine.clip(grid[0], grid[-1])[:, :, None] - grid) / step, 0)
    return shares.mean(axis=1)


def checked_wavelengths(wavelengths: Sequence[float] | NDArray[Any] | None) -> NDArray[np.float64]:
    """Band centres in metres, 400–700 nm every 10 nm for None.

    Raises:
        SettingError: none, not ascending, or outside 400–700 nm.
    """
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


Array = NDArray[np.float64]

MIXED = 3
BLACKS = 6
_CHROMA_SPREAD = 0.025
_BETWEEN_REGIONS, _WITHIN_REGIONS = 0.3, 0.1
_LOWEST_SHARE = 0.1
_ROWS = 16


@dataclass(frozen=True)
class ColourModel:
    """What measured reflectances tell about a spectrum of known colour.

    Args:
        library: ``(N, 61)`` reflectances scaled to an RGB sum of 1.
        likely: ``(61, 3)``, the most likely spectrum of an RGB difference: ``observer @ likely = identity``.
        blacks: ``(61, BLACKS)``, how spectra of one colour differ, one standard deviation each:
            ``observer @ blacks = 0``.
    """

    library: Array
    likely: Array
    blacks: Array


def colour_model(reflectances: Array) -> ColourModel:
    """Learn a Gaussian of the reflectances ``(N, 61)`` and condition it on the colour."""
    observer = rgb_observer()
    library = reflectances / (reflectances @ observer.sum(axis=0))[:, None]
    # About zero, not about the mean: brightness scales spectrum and colour alike, so prediction is linear.
    covariance = library.T @ library / len(library)
    likely = np.linalg.solve(observer @ covariance @ observer.T, observer @ covariance).T
    conditional = covariance - likely @ observer @ covariance
    variances, directions = np.linalg.eigh((conditional + conditional.T) / 2)
    blacks = directions[:, -BLACKS:] * np.sqrt(variances[-BLACKS:])
    return ColourModel(library, likely, blacks - likely @ (observer @ blacks))


def region_materials(model: ColourModel, rgb: Array, labels: NDArray[np.intp], rng: np.random.Generator) -> Array:
    """A mixture of measured reflectances for each region, ``(regions, 61)``, of RGB sum 1.

    Args:
        model: from :func:`colour_model`.
        rgb: ``(H, W, 3)``.
        labels: ``(H, W)``, regions numbered from 0.
        rng: draws the materials, the likelier the closer their chromaticity.
    """
    observer, count = rgb_observer(), int(labels.max()) + 1
    sums = np.stack([np.bincount(labels.ravel(), rgb[..., c].ravel(), count) for c in range(3)], axis=1)
    chroma = (sums + 1e-9) / (sums + 1e-9).sum(axis=1, keepdims=True)
    available = model.library @ observer.T
    distance = ((chroma[:, None] - available[None]) ** 2).sum(axis=2)
    # Relative to the closest, so that colours beyond the library still have a choice.
    distance = np.sqrt(distance) - np.sqrt(distance.min(axis=1, keepdims=True))
    score = -0.5 * (distance / _CHROMA_SPREAD) ** 2 + rng.gumbel(size=distance.shape)
    chosen = np.argsort(-score, axis=1)[:, :MIXED]
    shares = rng.dirichlet(np.full(MIXED, 0.7), size=count)
    return np.einsum("rm,rmw->rw", shares, model.library[chosen])


def black_amplitudes(labels: NDArray[np.intp], rng: np.random.Generator) -> NDArray[np.float32]:
    """Amplitudes of the metameric blacks, ``(H, W, BLACKS)``: a level per region and a smooth variation."""
    count = int(labels.max()) + 1
    levels = _BETWEEN_REGIONS * rng.standard_normal((count, BLACKS)).clip(-2, 2).astype(np.float32)
    amplitudes = levels[labels]
    for index in range(BLACKS):
        amplitudes[..., index] += _WITHIN_REGIONS * smooth_field(labels.shape, rng)
    return amplitudes


def smooth_field(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
    """A random field of unit variance whose features span about a tenth of the picture."""
    from scipy.ndimage import gaussian_filter, zoom

    coarse = gaussian_filter(rng.standard_normal([max(2, n * 50 // max(shape)) for n in shape]), 2)
    coarse = (coarse / coarse.std()).clip(-2, 2).astype(np.float32)
    return zoom(coarse, [n / m for n, m in zip(shape, coarse.shape, strict=True)], order=1)


def project(
    model: ColourModel,
    rgb: NDArray[np.float32],
    labels: NDArray[np.intp],
    materials: Array,
    amplitudes: NDArray[np.float32],
    bands: Array,
) -> NDArray[np.float32]:
    """Each pixel's reflectance, seen through linear bands; a few rows at a time.

    Args:
        model: from :func:`colour_model`.
        rgb: ``(H, W, 3)``, linear, in [0, 1].
        labels: ``(H, W)`` regions; materials: ``(regions, 61)``; amplitudes: ``(H, W, BLACKS)``.
        bands: ``(C, 61)`` weights that turn a reflectance into band values.

    Returns:
        ``(C, H, W)``.
    """
    height, width = labels.shape
    out = np.empty((len(bands), height, width), dtype=np.float32)
    weights = bands.T.astype(np.float32)
    for top in range(0, height, _ROWS):
        rows = slice(top, top + _ROWS)
        spectra = pixel_reflectances(model, rgb[rows], labels[rows], materials, amplitudes[rows])
        out[:, rows] = np.moveaxis(spectra @ weights, -1, 0)
    return out


def pixel_reflectances(
    model: ColourModel,
    rgb: NDArray[np.float32],
    labels: NDArray[np.intp],
    materials: Array,
    amplitudes: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Reflectances ``(H, W, 61)`` in [0, 1] whose colour is ``rgb``; arguments as :func:`project`."""
    observer, basis = rgb_observer(), primaries().astype(np.float32)
    seen = (materials @ observer.T).astype(np.float32)[labels]
    # Shading: the multiple of the region's material that comes closest to the pixel's colour.
    shade = ((rgb * seen).sum(-1) / (seen * seen).sum(-1))[..., None]
    spectra = shade * materials.astype(np.float32)[labels]
    spectra += (rgb - shade * seen) @ model.likely.T.astype(np.float32)
    spectra += (shade * amplitudes) @ model.blacks.T.astype(np.float32)
    return _moved_inside(spectra, rgb @ basis)


def _moved_inside(spectra: NDArray[np.float32], safe: NDArray[np.float32]) -> NDArray[np.float32]:
    """Move spectra towards safe ones of the same colour until they lie between a share of those and 1."""
    step = spectra - safe
    room = np.where(step < 0, (1 - _LOWEST_SHARE) * safe, 1 - safe)
    ratio = np.min(room / np.maximum(np.abs(step), 1e-9), axis=-1, keepdims=True)
    return np.clip(safe + np.minimum(ratio, 1) * step, 0, 1)
