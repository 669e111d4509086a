"""Wavelengths given on the command line, in nanometres."""

from __future__ import annotations

from tmca.errors import SettingError


def metres(nanometres: float | list[float], scene: str) -> list[float]:
    """Wavelengths in metres from a list in nm; LOW,HIGH is spread evenly over the bands of the file.

    Raises:
        SettingError: one number only.
    """
    from tmca.data import band_count

    if isinstance(nanometres, float):
        raise SettingError("--wavelengths", str(nanometres), "LOW,HIGH or one wavelength per band, in nm")
    if len(nanometres) == 2:
        low, high = nanometres
        count = band_count(scene)
        nanometres = [low + (high - low) * i / max(count - 1, 1) for i in range(count)]
    return [value * 1e-9 for value in nanometres]
