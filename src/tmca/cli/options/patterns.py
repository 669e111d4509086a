"""Patterns of codes that the command line names: families and files, brought to the camera's size."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from tmca.errors import SettingError


def fitted(patterns: Any, size: tuple[int, ...], settings: dict[str, Any], plane: str) -> Any:
    """Patterns larger than the plane they are for: their middle, with a line that says so."""
    from tmca.optics import Dispersion

    if not hasattr(patterns, "shape") or settings.get("period"):
        return patterns
    wide = plane == ("shutter" if settings.get("disperser", "single") == "single" else "aperture")
    spread = Dispersion.of(settings.get("dispersion", 1.0), len(settings["bands"])).spread if wide else 0
    rows, columns = size[0], size[1] + spread
    height, width = patterns.shape[-2:]
    if (height, width) == (rows, columns) or height < rows or width < columns:
        return patterns
    top, left = (height - rows) // 2, (width - columns) // 2
    print(f"tmca: {plane}: the middle {rows}×{columns} of {height}×{width} pixels", file=sys.stderr)
    return patterns[..., top : top + rows, left : left + columns].contiguous()


def codes_argument(value: str, option: str = "--aperture") -> Any:
    """A family's name, or the patterns in a file: (K, H, W), or MATLAB's (H, W, K)."""
    from tmca.codes import FAMILIES

    if value in FAMILIES:
        return value
    if not Path(value).suffix:
        raise SettingError(option, repr(value), f"one of {', '.join(FAMILIES)}, or a file of patterns")
    import numpy as np
    import torch

    from tmca.data import read_array

    stored = read_array(value)
    patterns = torch.from_numpy(stored.astype("float32"))
    if stored.dtype.kind in "ui" and patterns.max() > 1:
        patterns = patterns / float(np.iinfo(stored.dtype).max)
    _check_shares(patterns, value, option)
    if patterns.ndim == 3 and patterns.shape[2] < min(patterns.shape[:2]):
        patterns = patterns.movedim(2, 0).contiguous()
    return patterns


def _check_shares(patterns: Any, file: str, option: str) -> None:
    """Raises SettingError, naming option, file and its variable, unless patterns are shares of light."""
    low, high = float(patterns.min()), float(patterns.max())
    if 0 <= low <= high <= 1:
        return
    from tmca.data.formats.opening import open_contents

    with open_contents(file) as contents:
        name = ", ".join(stored.name for stored in contents.arrays.values() if stored.numeric and stored.size)
    remedy = "divide them by the largest, or store whole numbers as such"
    raise SettingError(f"{option} {file}: {name}", f"values from {low:g} to {high:g}", "0 = closed to 1 = open", remedy)


def coloured_argument(file: Path) -> Any:
    """The code cube (L, H, W) in a file, integers as shares of their type's maximum."""
    import numpy as np
    import torch

    from tmca.data import read_array

    stored = np.squeeze(read_array(file))
    scale = float(np.iinfo(stored.dtype).max) if stored.dtype.kind in "ui" and stored.max() > 1 else 1.0
    return torch.from_numpy(stored.astype("float32") / scale)
