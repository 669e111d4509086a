"""Export as a multi-page TIFF that ImageJ opens as a stack."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tmca.data.formats.wavelengths import metres_to_nm
from tmca.data.write import atomic_path
from tmca.errors import OutputError, ShapeError

if TYPE_CHECKING:
    import xarray

_LIMIT = 2**32 - 2**20
"""ImageJ's own TIFF holds one contiguous stack below 4 GiB."""


def write_tiff(cube: xarray.DataArray, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write a cube as float32 TIFF, one page per band, each labelled with its wavelength ("450 nm").

    Args:
        cube: dims ``(wavelength, y, x)`` with the coordinate ``wavelength`` in metres.
        path: ending in ``.tif`` or ``.tiff``.
        overwrite: replace an existing file.

    Raises:
        ShapeError: not such a cube.
        OutputError: a wrong suffix, a cube above 4 GiB, or see `atomic_path`.
    """
    import tifffile

    path = Path(path)
    if path.suffix.lower() not in (".tif", ".tiff"):
        raise OutputError(path, f"the suffix {path.suffix!r}", ".tif or .tiff", "rename the output")
    if cube.dims != ("wavelength", "y", "x") or "wavelength" not in cube.coords:
        raise ShapeError("cube", f"dims {cube.dims}", "(wavelength, y, x) with a wavelength coordinate")
    if cube.size * 4 > _LIMIT:
        raise OutputError(path, f"a cube of {cube.size * 4 / 2**30:.1f} GiB", "less than 4 GiB", "write .nc or .zarr")
    labels = [f"{nm:.10g} nm" for nm in metres_to_nm(cube.coords["wavelength"].values)]
    about = {
        "axes": "ZYX",
        "Labels": labels,
        "mode": "grayscale",
        "quantity": str(cube.attrs.get("quantity", "")),
    }
    with atomic_path(path, overwrite=overwrite) as temporary:
        pixels = np.ascontiguousarray(cube.values, dtype=np.float32)
        tifffile.imwrite(temporary, pixels, imagej=True, photometric="minisblack", metadata=about)
    return path
