"""The weights that come with the package, by name."""

from __future__ import annotations

from pathlib import Path

import tmca
from tmca.errors import SettingError

SHIPPED = {
    "spectral": ("static", "multiplexed"),
    "light-field": ("light-field",),
    "spectral-depth": ("spectral-depth",),
}
"""Cameras with their codes that come with the package, by kind: files without suffix, those of fewer slots first."""
UNNAMED = frozenset({"spectral", "light-field"})
"""Kinds of cameras whose network that comes with the package decodes behind its codes where no decoder is named; that
of the spectral-depth camera gains nothing on measured cubes."""
DEFAULT = "default"
"""Name of the weights of a camera that comes with the package, where its kind is known."""
KIND_OF_NAME = {f"{DEFAULT}-{kind}": kind for kind in SHIPPED}
"""Names that say the kind of camera themselves, ``default-light-field`` and the like, and that kind."""
CAMERA_NAMES = (DEFAULT, *KIND_OF_NAME)
"""Names of the cameras that come with the package."""
UNIVERSAL = "universal"
"""Name of the weights that come with the package for spectral cameras of any bands, codes and buckets."""
FOLDER = Path(tmca.__file__).parent / "weights"


def shipped_file(slots: int, kind: str = "spectral") -> Path:
    """The weights that come with the package for a kind of camera of as many slots: one, or several.

    Raises:
        SettingError: a kind of camera for which there are none.
    """
    if kind not in SHIPPED:
        found = f"'{DEFAULT}', of which none come with tmca for a {kind} camera"
        raise SettingError("weights", found, f"a file or run of `tmca train {kind}`")
    files = SHIPPED[kind]
    return FOLDER / f"{files[-1] if slots > 1 else files[0]}.safetensors"
