"""What a capture cannot be: dark, below black, or in other numbers than those of its prototype's levels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tmca.errors import DataError, SettingError
from tmca.lab.real_captures.noise import dark_noise
from tmca.lab.real_captures.prototype import PixelShutter, SingleDisperser

_BRIGHT, _CLEAR, _FAINT = 0.99, 3.0, 0.25
"""A capture is dark if its brightest hundredth is less than the second number of standard deviations of its noise above
the black level (noise alone comes to 2.3, something small and bright in front of black to more), and its mean less than
the third (0 without light). Codes in front of a scene that is bright all over are taken for noise, but not for dark."""
_BELOW = 5.0
"""Standard deviations of the noise by which half the pixels may lie below the black level."""
_WHITER = 4.0
"""Times the white level (or the saturation, where it is higher) that all but a hundredth of the pixels stay below.
White is the mean behind the codes: an open pixel gets about twice as much, of a bright scene twice that. Numbers of
another converter are 16 to 65535 times as large."""


def noise_of(values: NDArray[np.float64], given: float | None, where: Path) -> float:
    """The noise that is given, or that of the capture (H, W'), in its numbers.

    Raises:
        SettingError: one that is no noise.
        DataError: none is given, and the capture has none.
    """
    if given is not None and not (np.isfinite(given) and given >= 0):
        raise SettingError("--noise", f"{given:g}", "a standard deviation, finite and 0 or above")
    found = dark_noise(values) if given is None else given
    if np.ptp(values) == 0:
        raise DataError(where, f"the value {values.flat[0]:g} in every pixel", "a picture")
    if given is None and not found:
        raise DataError(where, "no noise in the darkest fifth of its pixels", "some", "tell it with --noise")
    return found


def check_capture(
    values: NDArray[np.float64], noise: float, prototype: SingleDisperser | PixelShutter, where: Path
) -> None:
    """Refuse a capture (H, W') without light, or in other numbers than its prototype's.

    Raises:
        DataError: naming which.
    """
    bright = float(np.quantile(values, _BRIGHT))
    top = max(prototype.white, prototype.saturation or 0.0) - prototype.black
    if bright - prototype.black > _WHITER * top:
        found = f"values around {bright:g} where it is bright"
        expected = f"{_WHITER:g} times the white level of {prototype.white:g} at most"
        raise DataError(where, found, expected, "give black, white and saturation in the capture's numbers")
    median = float(np.median(values))
    if median < prototype.black - _BELOW * noise:
        found = f"a median of {median:g}, {(prototype.black - median) / noise:.0f} σ below the black level"
        raise DataError(where, found, f"the black level of {prototype.black:g} or more", "mend black")
    if bright - prototype.black < _CLEAR * noise and values.mean() - prototype.black < _FAINT * noise:
        found = f"hardly any light above the black level of {prototype.black:g} ({bright:g} where it is bright)"
        raise DataError(where, found, f"more than its noise of {noise:.2g}", "give more light, or mend black")
