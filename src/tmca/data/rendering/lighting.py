"""Light on a rendered scene: shading, shadows, highlights, a dark background and an exposure, all drawn."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]
Light = Literal["flat", "drawn"]

_REACH = 80
"""Pixels over which a shadow is looked for."""


def lit(spectral: Array, light: Array, depth: Array, labels: NDArray[np.intp], rng: np.random.Generator) -> Array:
    """Reflectance and radiance ``(2L, H, W)``, the radiance under light from one side.

    Radiance is multiplied by shading and shadows and gets highlights of the lamp's own spectrum; then the exposure is
    drawn. The reflectance stays.

    Args:
        spectral: ``(2L, H, W)``, reflectance in front.
        light: ``(L,)``, its brightest band at 1.
        depth: ``(H, W)`` metres.
        labels: ``(H, W)`` coarse regions.
        rng: draws all.
    """
    known = np.nan_to_num(depth, nan=float(np.nanmax(depth)))
    angle, height = rng.uniform(0, 2 * np.pi), rng.uniform(0.4, 0.9)
    lamp = np.array([np.sin(angle), np.cos(angle)]) * np.sqrt(1 - height**2)
    normals = _normals(labels, rng)
    facing = np.maximum(normals[0] * lamp[0] + normals[1] * lamp[1] + normals[2] * height, 0)
    ambient = rng.uniform(0.15, 0.45)
    shade = ambient + (1 - ambient) * facing * (1 - _shadow(known, lamp / height, rng))
    cloth, covered = rng.uniform(0.02, 0.06) * _cloth(labels.shape, rng), _backdrop(labels, known, rng)
    gloss = _highlights(normals, lamp, height, labels, rng) * (1 - covered) * (shade > ambient)
    grey = (shade * covered * cloth + gloss).astype(np.float32)
    bands = len(light)
    radiance = spectral[bands:] * (shade * (1 - covered)).astype(np.float32) + light[:, None, None] * grey
    return np.concatenate([spectral[:bands], _exposed(radiance, rng)])


def _normals(labels: NDArray[np.intp], rng: np.random.Generator) -> Array:
    """Unit normals ``(3, H, W)``, y, x and towards the camera: every region bulges, and the whole is gently uneven."""
    from scipy.ndimage import distance_transform_edt, gaussian_filter

    inside = np.ones(labels.shape, dtype=bool)
    inside[1:] &= labels[1:] == labels[:-1]
    inside[:, 1:] &= labels[:, 1:] == labels[:, :-1]
    away = distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1]
    round_ = min(labels.shape) / rng.uniform(8, 20)
    bulge = round_ * np.tanh(away / round_)
    rough = gaussian_filter(rng.standard_normal(labels.shape), round_ / 2)
    rough *= rng.uniform(0.1, 0.4) * round_ / rough.std()
    slopes = np.gradient(gaussian_filter(rng.uniform(0.5, 1.2) * bulge + rough, max(1.0, round_ / 6)))
    normals = np.stack([-slopes[0], -slopes[1], np.ones(labels.shape)])
    return (normals / np.sqrt((normals**2).sum(axis=0))).astype(np.float32)


def _shadow(depth: Array, towards: Array, rng: np.random.Generator) -> Array:
    """Share of the lamp's light that nearer things keep away, ``(H, W)``."""
    from scipy.ndimage import gaussian_filter, shift

    height = (depth.max() - depth) / max(float(np.ptp(depth)), 1e-6) * min(depth.shape) / rng.uniform(3, 8)
    slope = float(np.hypot(*towards))
    step = towards / slope
    hidden = np.zeros(depth.shape, dtype=np.float32)
    for pixels in np.linspace(3, _REACH, 12):
        above = shift(height, -step * pixels, order=0, mode="nearest") - pixels / slope
        hidden = np.maximum(hidden, above > height + 2)
    return rng.uniform(0.6, 1.0) * gaussian_filter(hidden, rng.uniform(0.7, 3))


def _backdrop(labels: NDArray[np.intp], depth: Array, rng: np.random.Generator) -> Array:
    """Share of every pixel that is a dark cloth ``(H, W)``: in most scenes, the farther regions."""
    from scipy.ndimage import gaussian_filter

    count = int(labels.max()) + 1
    area = np.bincount(labels.ravel(), minlength=count)
    mean = np.bincount(labels.ravel(), depth.ravel(), count) / np.maximum(area, 1)
    share = rng.uniform(0.2, 0.8) if rng.random() < 0.75 else 0.0
    order = np.argsort(-mean)
    before = np.cumsum(area[order]) - area[order]
    dark = np.zeros(count, dtype=bool)
    dark[order] = before < share * labels.size - area[order] / 2
    return gaussian_filter(dark[labels].astype(np.float32), 0.7)


def _cloth(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float64]:
    """The dark cloth ``(H, W)``, about 1: folds, and a fine weave."""
    from scipy.ndimage import gaussian_filter

    folds = gaussian_filter(rng.standard_normal(shape), min(shape) / 20)
    return 1 + 0.2 * (folds / folds.std()).clip(-2, 2) + 0.05 * rng.standard_normal(shape).clip(-2, 2)


def _highlights(
    normals: Array, lamp: Array, height: float, labels: NDArray[np.intp], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Mirrored light ``(H, W)`` of glossy regions. Source: Blinn, SIGGRAPH 1977."""
    half = np.array([lamp[0], lamp[1], height + 1])
    half /= np.sqrt((half**2).sum())
    count = int(labels.max()) + 1
    gloss = np.where(rng.random(count) < 0.4, rng.uniform(0.05, 0.8, count), 0)
    sharp = 10 ** rng.uniform(1.3, 2.5, count)
    cosine = np.maximum(np.tensordot(half, normals, 1), 0)
    mirrored: NDArray[np.float64] = gloss[labels] * cosine ** sharp[labels]
    return mirrored


def _exposed(radiance: Array, rng: np.random.Generator) -> Array:
    """Radiance whose bright pixels reach a level that is drawn; few are cut at 1."""
    bright = float(np.quantile(radiance.max(axis=0)[::2, ::2], 0.995))
    return np.minimum(radiance * np.float32(10 ** rng.uniform(-0.2, 0.0) / max(bright, 1e-6)), 1)
