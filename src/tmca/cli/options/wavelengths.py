"""Wavelengths given on the command line, in nanometres."""

from __future__ import annotations

from tmca.errors import SettingError


def metres(text: str, option: str = "--wavelengths") -> list[float]:
    """``400:700:31`` (first, last, number of bands) or ``400,410,…`` in nm → metres.

    Raises:
        SettingError: neither of the two.
    """
    try:
        if ":" in text:
            first, last, count = text.split(":")
            step = (float(last) - float(first)) / max(int(count) - 1, 1)
            return [(float(first) + step * band) * 1e-9 for band in range(int(count))]
        return [float(part) * 1e-9 for part in text.split(",")]
    except ValueError:
        raise SettingError(option, repr(text), "FIRST:LAST:COUNT or one wavelength per band, in nm") from None
