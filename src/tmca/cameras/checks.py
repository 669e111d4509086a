"""Checks of a camera's settings."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from numbers import Integral
from typing import cast

import torch

from tmca.errors import SettingError


def checked_size(size: tuple[int, int]) -> tuple[int, int]:
    if not hasattr(size, "__len__") or len(size) != 2 or min(size) < 1:
        raise SettingError("size", str(size), "(H, W) of at least 1 pixel each")
    return (int(size[0]), int(size[1]))


def band_wavelengths(bands: int | Sequence[float]) -> tuple[float, ...]:
    if isinstance(bands, Integral):
        return evenly_spaced(int(bands))
    values = tuple(float(w) for w in cast(Sequence[float], bands))
    if not values or not all(100e-9 < w < 100e-6 for w in values) or len(set(values)) < len(values):
        raise SettingError(
            "bands", str(list(values)), "different wavelengths in metres, such as 550e-9", "give nm × 1e-9"
        )
    return values


def evenly_spaced(bands: int) -> tuple[float, ...]:
    """Evenly spaced from 400 to 700 nm, in metres."""
    if bands < 1:
        raise SettingError("bands", str(bands), "at least 1")
    return tuple(torch.linspace(400e-9, 700e-9, bands, dtype=torch.float64).tolist()) if bands > 1 else (550e-9,)


def learned_parts(learnable: bool | str | Collection[str], parts: tuple[str, ...]) -> tuple[str, ...]:
    """The parts of a camera that are learned: all, none, or the named ones.

    Raises:
        SettingError: an unknown part.
    """
    if isinstance(learnable, bool):
        return parts if learnable else ()
    names = (learnable,) if isinstance(learnable, str) else tuple(learnable)
    for name in names:
        if name not in parts:
            raise SettingError("learnable", repr(name), f"True, False, or some of {', '.join(parts)}")
    return names


def check_holds(size: tuple[int, int], window: tuple[int, int]) -> None:
    """Raises SettingError where a frame is narrower than its point spread functions."""
    if min(size) < max(window):
        found, expected = (
            f"{size[0]}×{size[1]} pixels",
            f"at least {max(window)}, the width of the point spread functions",
        )
        raise SettingError("size", found, expected, "take a larger crop or patch")


def check_one_hot(slots: int, period: int) -> None:
    """Raises SettingError where a tile has fewer pixels than there are slots, so that some would never be seen."""
    if slots > period**2:
        found, expected = f"{slots} with a one-hot shutter", f"at most {period**2}, the pixels of its period"
        raise SettingError("slots", found, expected, "take a longer period or another shutter")
