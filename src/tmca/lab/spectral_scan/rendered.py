"""Rendered scans: frames of a known reflectance under a tunable source, with dark and white."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tmca.errors import ShapeError

Array = NDArray[np.float64]
_BLACK, _BRIGHT = 0.02, 0.8


@dataclass(frozen=True)
class RenderedScan:
    """Digital numbers: ``scene`` and ``white`` ``(L, H, W)``, ``dark`` ``(n, H, W)``."""

    scene: NDArray[np.uint16]
    white: NDArray[np.uint16]
    dark: NDArray[np.uint16]


def render_scan(
    reflectance: Array,
    *,
    source: Array | None = None,
    read_noise: float = 4.0,
    gain: float = 0.0,
    darks: int = 8,
    bits: int = 12,
    seed: int = 0,
) -> RenderedScan:
    """Frames of a scene under each wavelength of a source whose power falls towards the blue and the picture's edge.

    Args:
        reflectance: ``(L, H, W)``.
        source: ``(L,)`` power per band relative to the brightest; that of a lamp behind a monochromator without it.
        read_noise: standard deviation, digital numbers.
        gain: digital numbers per electron, for shot noise.
        darks: dark frames.
        bits: of the digital numbers.
        seed: of the noise.

    Raises:
        ShapeError: no cube.
    """
    if reflectance.ndim != 3:
        raise ShapeError("reflectance", f"shape {reflectance.shape}", "(L, H, W)")
    bands, height, width = reflectance.shape
    power = 0.35 + 0.65 * np.sin(np.linspace(0.25, 2.2, bands)) if source is None else np.asarray(source)
    y, x = np.linspace(-1, 1, height)[:, None], np.linspace(-1, 1, width)
    light = _BRIGHT * power[:, None, None] * (1 - 0.15 * (y**2 + x**2))
    top, rng = 2**bits - 1, np.random.default_rng(seed)

    def recorded(clean: Array) -> NDArray[np.uint16]:
        spread = np.sqrt(read_noise**2 + gain * clean * top)
        noisy = (clean + _BLACK) * top + spread * rng.standard_normal(clean.shape)
        return np.clip(np.round(noisy), 0, top).astype(np.uint16)

    dark = recorded(np.zeros((darks, height, width)))
    return RenderedScan(recorded(reflectance * light), recorded(light), dark)
