"""Figures of merit of spectra: SAM, ERGAS, and the degree of distortion."""

from __future__ import annotations

from typing import Any

import numpy as np

from tmca.errors import SettingError
from tmca.metrics._pairs import Array, Reduction, cube_pair, reduced


def sam(estimate: Any, truth: Any, *, reduction: Reduction = "mean", return_excluded: bool = False) -> Any:
    """Spectral angle mapper in degrees: mean over pixels of the angle between estimated and true spectrum.

    Pixels whose true spectrum is zero have no angle: they are left out, and counted. A zero estimate of a
    spectrum that is not zero counts 90°. Angles come from ``2 atan2(‖u - v‖, ‖u + v‖)``, precise near 0 too.

    Args:
        estimate, truth: ``(B, L, H, W)`` or ``(L, H, W)``.
        reduction: ``"mean"`` over the batch (a float) or ``"none"`` (an array ``(B,)``).
        return_excluded: return ``(angle, count)`` with the number of pixels left out, reduced by summing.

    Returns:
        The angle per image, then averaged. An image without a single true spectrum has ``nan``.

    Raises:
        ShapeError: the shapes differ or are not those of cubes.
    """
    x, y = cube_pair(estimate, truth)
    excluded = ~np.any(y != 0, axis=1)
    angles = np.where(excluded, 0.0, _angles(x, y))
    counted = np.sum(~excluded, axis=(1, 2)).astype(np.float64)
    with np.errstate(invalid="ignore"):
        angle = reduced(np.degrees(angles.sum(axis=(1, 2)) / counted), reduction)
    if not return_excluded:
        return angle
    left_out = excluded.sum(axis=(1, 2))
    return angle, (left_out if reduction == "none" else int(left_out.sum()))


def _angles(x: Array, y: Array) -> Array:
    """Angles in radians along axis 1; a zero spectrum is at a right angle to everything."""
    u, v = _unit(x), _unit(y)
    angles = 2 * np.arctan2(np.linalg.norm(u - v, axis=1), np.linalg.norm(u + v, axis=1))
    zero = ~(np.any(x != 0, axis=1) & np.any(y != 0, axis=1))
    return np.where(zero, np.pi / 2, angles)


def _unit(spectra: Array) -> Array:
    # Scaling by the largest entry first keeps tiny spectra from underflowing when squared.
    largest = np.max(np.abs(spectra), axis=1, keepdims=True)
    scaled = spectra / np.where(largest == 0, 1.0, largest)
    norm = np.linalg.norm(scaled, axis=1, keepdims=True)
    return scaled / np.where(norm == 0, 1.0, norm)


def ergas(estimate: Any, truth: Any, *, ratio: float = 1.0, reduction: Reduction = "mean") -> Any:
    """Relative global error in synthesis, ``100/ratio · sqrt(mean_ℓ (RMSE_ℓ / mean_ℓ)²)``, the truth's means.

    A band whose true mean is zero adds nothing if it is estimated exactly and makes the error infinite
    otherwise. Source: Wald, 2000.

    Args:
        estimate, truth: ``(B, L, H, W)`` or ``(L, H, W)``.
        ratio: of the resolutions, as in pan-sharpening; 1 when both have the same.
        reduction: ``"mean"`` over the batch (a float) or ``"none"`` (an array ``(B,)``).

    Raises:
        ShapeError: the shapes differ or are not those of cubes.
        SettingError: ``ratio`` is not positive.
    """
    if not ratio > 0:
        raise SettingError("ratio", repr(ratio), "a positive number")
    x, y = cube_pair(estimate, truth)
    mse = np.mean((x - y) ** 2, axis=(2, 3))
    squared_mean = np.mean(y, axis=(2, 3)) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(mse == 0, 0.0, mse / squared_mean)
    return reduced(100 / ratio * np.sqrt(relative.mean(axis=1)), reduction)


def dd(estimate: Any, truth: Any, *, reduction: Reduction = "mean") -> Any:
    """Degree of distortion: the mean absolute difference, ``‖x - x̂‖₁ / number of entries``.

    Args:
        estimate, truth: ``(B, L, H, W)`` or ``(L, H, W)``.
        reduction: ``"mean"`` over the batch (a float) or ``"none"`` (an array ``(B,)``).

    Raises:
        ShapeError: the shapes differ or are not those of cubes.
    """
    x, y = cube_pair(estimate, truth)
    return reduced(np.mean(np.abs(x - y), axis=(1, 2, 3)), reduction)
