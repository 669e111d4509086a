"""Reflectances of a photograph's pixels: its colours kept, its spectra those of measured materials.

A colour does not tell its spectrum. Each region of the photograph is therefore given a mixture of measured
reflectances of about its colour; shading scales it; what colour remains is made up by the most likely
spectrum of that colour; and metameric blacks (spectra that no eye sees) vary between and within regions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tmca.data.rendering.measured import primaries, rgb_observer

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
