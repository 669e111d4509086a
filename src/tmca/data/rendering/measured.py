"""Measured reflectances and illuminants of colour-science, every 5 nm from 400 to 700 nm.

That is the range in which every one of the reflectances was measured.
"""

from __future__ import annotations

from difflib import get_close_matches
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tmca.errors import SettingError

Array = NDArray[np.float64]

GRID_NM = np.arange(400.0, 701.0, 5.0)


def reflectances(part: Literal["train", "test"]) -> Array:
    """Half of the measured reflectances, ``(N, 61)``: no material is in both parts."""
    return _all_reflectances()[0 if part == "train" else 1 :: 2]


@lru_cache(maxsize=1)
def _all_reflectances() -> Array:
    """190 patches, ColorChecker, preferred memory colours, and the test samples of CRI and CQS.

    Patches that reflect more than everything (fluorescent ones) or nearly nothing are left out.
    """
    import colour

    charts = [colour.SDS_COLOURCHECKERS[chart] for chart in ("ColorChecker N Ohta", "PMC")]
    samples = [colour.quality.SDS_TCS["CIE 1995"], colour.quality.SDS_VS["NIST CQS 9.0"]]
    patches = colour.characterisation.read_training_data_rawtoaces_v1()
    measured = [_on_grid(sd) for chart in charts + samples for sd in chart.values()]
    table = np.vstack([*(np.asarray(measured)), *_on_grid(patches).T])
    return table[(table.max(axis=1) <= 1) & (table.max(axis=1) > 0.02)].clip(0, 1)


@lru_cache
def illuminant(name: str) -> Array:
    """Spectral power ``(61,)`` of an illuminant of colour-science, in its own relative units.

    Raises:
        SettingError: there is no such illuminant.
    """
    import colour

    if name not in colour.SDS_ILLUMINANTS:
        near = get_close_matches(name, list(colour.SDS_ILLUMINANTS), 4, 0.3) or ["D65", "A", "LED-B2"]
        remedy = f"try {', '.join(near)}; colour.SDS_ILLUMINANTS has all {len(colour.SDS_ILLUMINANTS)}"
        raise SettingError("illuminant", repr(name), "one that colour-science knows", remedy)
    return _on_grid(colour.SDS_ILLUMINANTS[name])


@lru_cache(maxsize=1)
def rgb_observer() -> Array:
    """``(3, 61)``: linear sRGB of a reflectance under D65, for the CIE 1931 2° observer.

    What the eye sees beyond 400–700 nm is counted with the reflectance at those ends.
    """
    import colour

    whole = np.arange(380.0, 781.0, 5.0)
    matching = _sampled(colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"], whole)
    weights = matching * _sampled(colour.SDS_ILLUMINANTS["D65"], whole)[:, None]
    nearest = np.abs(whole[:, None] - GRID_NM).argmin(axis=1)
    folded = np.zeros((len(GRID_NM), 3))
    np.add.at(folded, nearest, weights / weights[:, 1].sum())
    return np.linalg.inv(colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ) @ folded.T


@lru_cache(maxsize=1)
def primaries() -> Array:
    """``(3, 61)``: a partition of white into three reflectances that show the primaries of sRGB.

    Any linear sRGB in [0, 1] times these is a reflectance in [0, 1] of that colour. Source: Mallett & Yuksel,
    EGSR 2019.
    """
    import colour

    basis = _on_grid(colour.recovery.MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019).T
    # Published for 380–780 nm: on our range its colours are off by a thousandth, which this takes back.
    return np.asarray(np.linalg.solve(basis @ rgb_observer().T, basis), dtype=np.float64)


def _on_grid(spectra: Any) -> Array:
    return _sampled(spectra, GRID_NM)


def _sampled(spectra: Any, wavelengths_nm: Array) -> Array:
    """Linear interpolation; beyond a spectrum's ends its last value holds."""
    values = np.asarray(spectra.values, dtype=np.float64)
    columns = values.reshape(len(values), -1)
    sampled = [np.interp(wavelengths_nm, spectra.wavelengths, column) for column in columns.T]
    return sampled[0] if values.ndim == 1 else np.stack(sampled, axis=1)
