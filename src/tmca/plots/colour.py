"""The colours of a reconstructed cube as an eye would see the scene."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tmca.plots.style import bright_level

Array = NDArray[np.floating]


def linear_srgb(cube: Array, wavelengths: Sequence[float], lamp: Array | None = None) -> NDArray[np.float64]:
    """(L, H, W) relative irradiance → (3, H, W) linear sRGB; a spectrum like the lamp's is white.

    ``X = Σ_ℓ x_ℓ Δλ_ℓ x̄(λ_ℓ)`` and so on, with the CIE 1931 observer and the bands' own widths.

    Args:
        cube: spectral density, as a response in proportion to the bands' widths leaves it.
        wavelengths: (L,) metres, rising.
        lamp: (L,) spectrum shown as white; an even one without it.
    """
    import colour

    nm = np.asarray(wavelengths) * 1e9
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    matching = np.stack([np.interp(nm, observer.wavelengths, observer.values[:, i]) for i in range(3)])
    matching = matching * np.gradient(nm)
    to_rgb = colour.RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB @ matching
    white = to_rgb @ (np.ones(len(nm)) if lamp is None else lamp)
    return np.tensordot(to_rgb, cube, axes=1) / white[:, None, None]


def srgb_picture(
    cube: Array, wavelengths: Sequence[float], lamp: Array | None = None, level: float | None = None
) -> NDArray[np.float32]:
    """(H, W, 3) picture in [0, 1], with the curve of sRGB.

    Args:
        cube, wavelengths, lamp: as for `linear_srgb`.
        level: linear value shown as full; the 99.8 % quantile without it.
    """
    import colour

    linear = linear_srgb(cube, wavelengths, lamp)
    top = shown_level(linear) if level is None else level
    shown = np.clip(linear / top, 0, 1).astype(np.float32)
    return np.moveaxis(np.asarray(colour.cctf_encoding(shown, function="sRGB"), dtype=np.float32), 0, -1)


def shown_level(linear: Array) -> float:
    """The linear value that a picture shows as full."""
    return bright_level(linear, 0.998)
