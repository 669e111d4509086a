"""Codes as a file: aperture and shutter patterns of one exposure, and the period in which they repeat."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tmca.errors import DataError, SettingError


@dataclass(frozen=True)
class CodesFile:
    """What a codes file holds.

    Args:
        aperture: (K, h, w) of zeros and ones, one period or the full frame.
        shutter: (K, h, w') likewise.
        period: (rows, columns) in which both repeat; None for full-frame codes.
        path: of the file.
    """

    aperture: Tensor
    shutter: Tensor
    period: tuple[int, int] | None
    path: Path

    def settings(self) -> dict[str, Any]:
        """Arguments of a camera with these codes."""
        tile = None if self.period is None else self.period[0] if len(set(self.period)) == 1 else self.period
        return {"aperture": self.aperture, "shutter": self.shutter, "slots": len(self.aperture), "period": tile}


def write_codes(
    path: str | Path,
    aperture: Tensor,
    shutter: Tensor,
    period: tuple[int, int] | None,
    notes: Mapping[str, Any] | None = None,
    *,
    overwrite: bool = False,
) -> Path:
    """Write patterns (K, h, w) of both planes as NetCDF with labels.

    Raises:
        SettingError: patterns that are not zeros and ones.
        OutputError: the file exists, or cannot be written.
    """
    import xarray as xr

    from tmca.data import write_dataset

    planes = {}
    for name, plane, columns in (("aperture", aperture, "x"), ("shutter", shutter, "x_sensor")):
        if bool(((plane != 0) & (plane != 1)).any()):
            raise SettingError(name, "grey values", "zeros and ones in a file of codes")
        values = plane.detach().cpu().numpy().astype(np.uint8)
        planes[name] = (("slot", "y", columns), values, {"meaning": "1 = open"})
    attributes = {**(notes or {}), "period": list(period or ())}
    return write_dataset(xr.Dataset(planes, attrs=attributes), path, overwrite=overwrite)


def read_codes(path: str | Path) -> CodesFile:
    """Read what ``write_codes`` wrote.

    Raises:
        DataError: no such file, no codes in it, or planes of different numbers of slots.
    """
    from tmca.data import read_dataset

    stored = read_dataset(path, ("aperture", "shutter"))
    aperture, shutter = (torch.from_numpy(stored[name].values.astype(np.float32)) for name in ("aperture", "shutter"))
    if aperture.ndim != 3 or shutter.ndim != 3 or len(aperture) != len(shutter):
        text = f"aperture {tuple(aperture.shape)}, shutter {tuple(shutter.shape)}"
        raise DataError(path, text, "(K, rows, columns) of the same K", "write codes with `tmca design`")
    period = np.atleast_1d(stored.attrs.get("period", []))
    tile = (int(period[0]), int(period[-1])) if period.size and np.issubdtype(period.dtype, np.number) else None
    return CodesFile(aperture, shutter, tile, Path(path))
