"""Weights by name: those that come with the package, or a run's."""

from __future__ import annotations

from pathlib import Path

import tmca
from tmca.decoders.networks.neural import Weights

SHIPPED = ("static", "multiplexed")
FOLDER = Path(tmca.__file__).parent / "weights"


def find_weights(name: str | Path, slots: int = 8) -> Weights:
    """Weights by their file or the folder of their run, or those that come with the package.

    Args:
        name: file, folder, or ``"default"``: ``static.safetensors`` of the package for a camera of one slot, else
            ``multiplexed.safetensors``; ``weights/README.md`` beside them says what they are.
        slots: K of the camera that they are for.

    Raises:
        DataError: no such file, or no weights of a camera in it.
    """
    if str(name) == "default":
        return Weights.load(shipped_file(slots))
    return Weights.load(name)


def shipped_file(slots: int) -> Path:
    """The weights that come with the package for a camera of as many slots: one, or several."""
    return FOLDER / f"{SHIPPED[slots > 1]}.safetensors"
