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


def shown_level(linear: Array) -> float:
    """The linear value that a picture shows as full."""
    return bright_level(linear, 0.998)
