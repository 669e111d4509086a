"""Phase masks: what a height does to light of every wavelength (thesis eqs 22 to 25)."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, pi

import torch
from torch import Tensor

from tmca.errors import SettingError, check_range
from tmca.optics.materials import Material


def radians_per_metre(wavelengths: Sequence[float], material: Material | None) -> Tensor:
    """(L,) phase of a metre of height, float64: ``2π Δn/λ`` through a material in air (eq. 24), ``2π 2/λ`` on a mirror.

    Args:
        wavelengths: metres.
        material: None for a mirror in reflection.

    Raises:
        SettingError: a wavelength that is not positive, or outside the material's data.
    """
    values = torch.as_tensor(list(wavelengths), dtype=torch.float64)
    if not bool((values > 0).all()):
        raise SettingError("wavelengths", str(list(wavelengths)), "metres, above 0")
    path = torch.full_like(values, 2.0) if material is None else torch.from_numpy(material.index(wavelengths)) - 1
    return 2 * pi * path / values


def mask_field(heights: Tensor, per_metre: Tensor) -> Tensor:
    """``b = exp(iφ)`` of heights (..., H, W) at every wavelength (..., L, H, W), complex (eq. 23).

    Args:
        heights: metres.
        per_metre: (L,) of ``radians_per_metre``.
    """
    phase = heights[..., None, :, :] * per_metre.to(heights)[:, None, None]
    return torch.polar(torch.ones_like(phase), phase)


def pixel_places(size: tuple[int, int], pitch: float) -> tuple[Tensor, Tensor]:
    """(y (H, 1), x (1, W)) of pixels around the middle, metres, float64.

    Raises:
        SettingError: a pitch that is not positive.
    """
    check_range("pitch", pitch, above=0, unit="m")
    y, x = (pitch * (torch.arange(n, dtype=torch.float64) - (n - 1) / 2) for n in size)
    return y[:, None], x[None]


def circular_aperture(size: tuple[int, int], diameter: float | None = None) -> Tensor:
    """(H, W) share of every pixel inside a centred circle, float64; the rim is smooth over about a pixel.

    Args:
        size: (H, W) pixels.
        diameter: pixels; the smaller side without.

    Raises:
        SettingError: a diameter that is not positive.
    """
    wide = min(size) if diameter is None else diameter
    check_range("diameter", wide, above=0, unit="pixels")
    y, x = pixel_places(size, 1.0)
    return (wide / 2 - torch.hypot(y, x) + 0.5).clamp(0, 1)


def spherical_wave(
    size: tuple[int, int], pitch: float, wavelengths: Sequence[float], distance: float, focus: float | None = None
) -> Tensor:
    """Field of a point source on the axis (L, H, W), complex128 (eq. 22), without the phase of its middle.

    Args:
        size: (H, W) pixels.
        pitch: of the pixels, metres.
        wavelengths: (L,) metres.
        distance: z of the source before the mask, metres; ``inf`` for a plane wave.
        focus: distance z that a lens in the mask's plane brings to a focus: its phase is taken away; none if None.

    Raises:
        SettingError: distances that are not positive.
    """
    y, x = pixel_places(size, pitch)
    path = _sag(y**2 + x**2, "distance", distance)
    if focus is not None:
        path = path - _sag(y**2 + x**2, "focus", focus)
    waves = 2 * pi / torch.as_tensor(list(wavelengths), dtype=torch.float64)
    phase = waves[:, None, None] * path
    return torch.polar(torch.ones_like(phase), phase)


def _sag(square: Tensor, where: str, distance: float) -> Tensor:
    """``√(r² + z²) - z`` without cancellation."""
    check_range(where, distance, above=0, high=inf, unit="m")
    if distance == inf:
        return torch.zeros_like(square)
    return square / (torch.sqrt(square + distance**2) + distance)
