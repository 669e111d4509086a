"""Bands that weights were trained for, against those of a scene or a camera."""

from __future__ import annotations

from collections.abc import Sequence

from tmca.errors import SettingError


def check_bands(learned: Sequence[float], wavelengths: Sequence[float], whose: str) -> None:
    """Refuse other bands than those that weights were trained for.

    Args:
        learned: wavelengths of the weights, metres; empty where they have no bands.
        wavelengths: that are asked for.
        whose: ``"the camera's"`` or the like.

    Raises:
        SettingError: others.
    """
    if learned and not same_bands(learned, wavelengths):
        found, wanted = _unlike_bands(learned, wavelengths)
        raise SettingError("weights", found, f"{whose} {wanted}", f"train a network at {whose} bands")


def same_bands(one: Sequence[float], other: Sequence[float]) -> bool:
    """Whether two lists of wavelengths in metres agree to a nanometre."""
    return len(one) == len(other) and all(abs(a - b) <= 1e-9 for a, b in zip(one, other, strict=True))


def _unlike_bands(one: Sequence[float], other: Sequence[float]) -> tuple[str, str]:
    """What tells two lists of wavelengths apart: numbers and ends, or the first band that differs."""
    if (texts := (_bands(one), _bands(other)))[0] != texts[1]:
        return texts
    pairs = enumerate(zip(one, other, strict=True), start=1)
    place, (a, b) = next((place, pair) for place, pair in pairs if abs(pair[0] - pair[1]) > 1e-9)
    return f"{texts[0]}, number {place} at {a * 1e9:.4g} nm", f"number {place} at {b * 1e9:.4g} nm"


def _bands(wavelengths: Sequence[float]) -> str:
    return f"{len(wavelengths)} bands of {min(wavelengths) * 1e9:.4g} to {max(wavelengths) * 1e9:.4g} nm"
