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
    if patterns.ndim == 3 and patterns.shape[2] < min(patterns.shape[:2]):
        patterns = patterns.movedim(2, 0).contiguous()
    return patterns


def coloured_argument(file: Path) -> Any:
    """The code cube (L, H, W) in a file, integers as shares of their type's maximum."""
    import numpy as np
    import torch

    from tmca.data import read_array

    stored = np.squeeze(read_array(file))
    scale = float(np.iinfo(stored.dtype).max) if stored.dtype.kind in "ui" and stored.max() > 1 else 1.0
    return torch.from_numpy(stored.astype("float32") / scale)
