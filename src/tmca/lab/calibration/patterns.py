"""Patterns to show for calibration: open, dark, and random ones whose place, direction and scale can be told."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tmca.data import atomic_path
from tmca.errors import SettingError
from tmca.lab.calibration.arrays import Array


def calibration_patterns(size: tuple[int, int], count: int = 2, seed: int = 0) -> Array:
    """(2 + count, h, w): all open, all dark, then random blocks of 4, 2, 4, 2, … pixels, half of them open.

    Blocks are large enough to be seen after a rotation or blur, and no two places, turns or flips of them are alike.

    Args:
        size: (h, w) of the mask, pixels.
        count: of random patterns.
        seed: of them.

    Raises:
        SettingError: a mask below 16 pixels, or no random pattern.
    """
    if min(size) < 16 or count < 1:
        raise SettingError("patterns", f"{count} of {size[0]}×{size[1]} pixels", "1 or more of 16×16 pixels or more")
    rng = np.random.default_rng(seed)
    planes: list[Array] = [np.ones(size), np.zeros(size)]
    for index in range(count):
        side = 4 if index % 2 == 0 else 2
        blocks = rng.integers(2, size=tuple(-(-n // side) for n in size)).astype(np.float64)
        shown = np.kron(blocks, np.ones((side, side)))[: size[0], : size[1]]
        planes.append(np.asarray(shown, dtype=np.float64))
    return np.stack(planes)


def write_patterns(
    folder: str | Path, size: tuple[int, int], count: int = 2, seed: int = 0, *, overwrite: bool = False
) -> list[str]:
    """Write ``pattern_0.png`` … into a folder, white where the mask is open, and give back their names.

    Raises:
        SettingError: see ``calibration_patterns``.
        OutputError: see `tmca.data.atomic_path`.
    """
    from PIL import Image

    planes = calibration_patterns(size, count, seed)
    names = [f"pattern_{index}.png" for index in range(len(planes))]
    with atomic_path(folder, overwrite=overwrite) as place:
        place.mkdir()
        for name, plane in zip(names, planes, strict=True):
            Image.fromarray((255 * plane).astype(np.uint8)).save(place / name)
    return names
