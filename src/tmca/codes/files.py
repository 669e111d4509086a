"""Codes in files: the variables of both planes, and files of aperture and shutter patterns alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import torch
from pydantic import AfterValidator, Field, Json
from torch import Tensor

from tmca.attributes import REMEDY, Attributes, attributes_of
from tmca.codes.plane import tile_of
from tmca.errors import DataError, SettingError
from tmca.stored_numbers import finite_numbers

if TYPE_CHECKING:
    import xarray as xr

Axes = Sequence[str]
_SYMBOLS = {"aperture": "T", "shutter": "S"}
TILE = ("y_tile", "x_tile")
"""Axes of one tile of codes that repeat."""
MOST_PIXELS = 2**24
"""Pixels of the frame over which codes of a file repeat: the file itself holds one tile of them."""
_Side = Annotated[int, Field(ge=1, le=2**16)]


def _few_enough(size: tuple[int, int]) -> tuple[int, int]:
    if size[0] * size[1] > MOST_PIXELS:
        raise ValueError(f"at most {MOST_PIXELS} pixels")
    return size


Frame = Annotated[tuple[_Side, _Side], AfterValidator(_few_enough)]
"""Rows and columns of a frame or of a tile, as a file states them."""


def code_variables(planes: Iterable[Tensor], aperture: Axes, shutter: Axes) -> dict[str, Any]:
    """Variables ``aperture`` and ``shutter``, slot by slot on these axes; binary codes as bytes."""
    return {
        name: (slotted(axes), compact(plane), {"long_name": f"{name} codes {_SYMBOLS[name]}", "units": "1 = open"})
        for name, axes, plane in zip(("aperture", "shutter"), (aperture, shutter), planes, strict=True)
    }


def by_bucket(shutter: Tensor, slots: int, axes: Axes) -> tuple[Tensor, Axes]:
    """Shutter patterns and their axes; those of all buckets, (R·K, …), with a dimension of their own."""
    return (shutter, axes) if len(shutter) == slots else (shutter.unflatten(0, (-1, slots)), ("bucket", *axes))


def slotted(axes: Axes) -> Axes:
    """Axes of patterns slot by slot; of a sensor with several buckets, bucket by bucket first."""
    return ("bucket", "slot", *axes[1:]) if axes[0] == "bucket" else ("slot", *axes)


def compact(codes: Tensor) -> np.ndarray:
    """Binary codes as bytes, grey ones as they are."""
    values = codes.numpy(force=True)
    return values.astype(np.uint8) if ((values == 0) | (values == 1)).all() else values


def tensors(dataset: xr.Dataset, where: str, *names: str) -> dict[str, Tensor]:
    """Variables as float32 tensors.

    Raises:
        DataError: one of no real numbers, or with some that are not finite in single precision.
    """
    read = {name: finite_numbers(dataset[name].values, where, f"variable {name}") for name in names}
    return {name: torch.from_numpy(values) for name, values in read.items()}


def differing(one: xr.Dataset, other: xr.Dataset) -> list[str]:
    """Variables of one camera that another does not have, or has otherwise; heights, in metres, to a nanometre."""
    return [str(name) for name in one.data_vars if name not in other or not _alike(one[name], other[name])]


def _alike(one: xr.DataArray, other: xr.DataArray) -> bool:
    return one.shape == other.shape and np.allclose(one.values, other.values, rtol=1e-5, atol=1e-9)


class CodesAttributes(Attributes):
    """Of a codes file: rows and columns of the period, one number for both, or none; buckets of a sensor pixel."""

    buckets: Annotated[int, Field(ge=1, le=256)] = 1

    period: tuple[_Side, _Side] | _Side | Json[tuple[_Side, _Side] | tuple[()] | None] | None = None


@dataclass(frozen=True)
class CodesFile:
    """What a codes file holds.

    Args:
        aperture: (K, h, w) of zeros and ones, one period or the full frame.
        shutter: (K, h, w') likewise; (R, K, h, w') of all R buckets.
        period: (rows, columns) in which both repeat; None for full-frame codes.
        buckets: R of a sensor pixel.
    """

    aperture: Tensor
    shutter: Tensor
    period: tuple[int, int] | None
    buckets: int = 1

    @property
    def burst(self) -> bool:
        """Whether they are frames one after the other: all pixels of several buckets change alike."""
        shutter = self.shutter.flatten(0, -3)
        alike = bool((shutter == shutter[:, :1, :1]).all())
        return self.buckets > 1 and alike and not bool((shutter == shutter[0]).all())

    @property
    def static(self) -> bool:
        """Whether nothing changes within the exposure."""
        return all(bool((plane == plane[:1]).all()) for plane in (self.aperture, self.shutter.flatten(0, -3)))

    def at(self, size: Sequence[int] | None) -> CodesFile:
        """The codes on a frame of (H, W) pixels; those of a whole frame of another size repeat."""
        rows, columns = (int(side) for side in self.aperture.shape[-2:])
        if self.period is not None or size is None or (rows, columns) == tuple(size):
            return self
        return replace(self, shutter=self.shutter[..., :rows, :columns], period=(rows, columns))

    def settings(self) -> dict[str, Any]:
        """Arguments of a camera with these codes."""
        tile = self.period[0] if self.period is not None and len(set(self.period)) == 1 else self.period
        shown = {"aperture": self.aperture, "shutter": self.shutter, "slots": len(self.aperture), "period": tile}
        return shown | ({"buckets": self.buckets} if self.buckets > 1 else {})


def write_codes(
    path: str | Path,
    aperture: Tensor,
    shutter: Tensor,
    period: tuple[int, int] | None,
    notes: Mapping[str, Any] | None = None,
    *,
    buckets: int = 1,
    overwrite: bool = False,
) -> Path:
    """Write patterns (K, h, w) of both planes as NetCDF with labels; those of R buckets as (R·K, h, w').

    Raises:
        SettingError: patterns that are not zeros and ones.
        OutputError: the file exists, or cannot be written.
    """
    import xarray as xr

    from tmca.data import write_dataset

    axes: Axes = ("y", "x_sensor")
    if len(shutter) > len(aperture):
        axes, shutter = ("bucket", *axes), shutter.unflatten(0, (buckets, -1))
    planes = code_variables((aperture, shutter), ("y", "x"), axes)
    for name, (_, values, _) in planes.items():
        if values.dtype != np.uint8:
            raise SettingError(name, "grey values", "zeros and ones in a file of codes")
    attributes = {**(notes or {}), "period": list(period or ()), **({"buckets": buckets} if buckets > 1 else {})}
    return write_dataset(xr.Dataset(planes, attrs=attributes), path, overwrite=overwrite)


def read_codes(path: str | Path) -> CodesFile:
    """Read what ``write_codes`` wrote.

    Raises:
        DataError: no such file, no codes within [0, 1] in it, or planes of different numbers of slots.
    """
    from tmca.data import read_dataset

    stored = read_dataset(path, ("aperture", "shutter"))
    aperture, shutter = tensors(stored, str(path), "aperture", "shutter").values()
    about = attributes_of(CodesAttributes, stored.attrs, path)
    slots = shutter.shape[-3:-2] if shutter.ndim == 3 or tuple(shutter.shape[:1]) == (about.buckets,) else ()
    if aperture.ndim != 3 or shutter.ndim > 4 or slots != aperture.shape[:1] or not len(aperture):
        told = f"buckets = {about.buckets}" if "buckets" in stored.attrs else "no attribute buckets"
        text = f"aperture {tuple(aperture.shape)}, shutter {tuple(shutter.shape)}, {told}"
        expected = "(slot, rows, columns), or a shutter (bucket, slot, rows, columns) with its attribute buckets"
        raise DataError(path, text, expected, "correct what differs, or write codes with `tmca design`")
    for name, plane in (("aperture", aperture), ("shutter", shutter)):
        if not bool(((plane >= 0) & (plane <= 1)).all()):
            raise DataError(path, f"{name} codes outside [0, 1]", "zeros and ones", REMEDY)
    return CodesFile(aperture, shutter, tile_of(about.period or None), about.buckets)


def codes_of_file(path: str | Path) -> CodesFile | None:
    """The codes of a file, None of one that has none that can be read."""
    try:
        return read_codes(path)
    except DataError:
        return None
