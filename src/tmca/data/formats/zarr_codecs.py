"""The one way into a Zarr store: what it says of itself is checked first, and so is every chunk of blosc, of which the
library believes whatever length it states."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numcodecs
import zarr
from numcodecs.blosc import Blosc
from zarr.codecs import BloscCodec
from zarr.registry import register_codec

from tmca.data.formats.zarr_metadata import check_store

_HEAD = 16
"""Bytes of a chunk's head, whose last four are its length."""


class CheckedBlosc(Blosc):  # type: ignore[misc]
    """Blosc of Zarr's version 2."""

    def decode(self, buf: Any, out: Any = None) -> Any:
        """See `numcodecs.blosc.Blosc`."""
        _check_length(memoryview(buf).cast("B"))
        return super().decode(buf, out)


class CheckedBloscCodec(BloscCodec):
    """Blosc of Zarr's version 3."""

    async def _decode_single(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
        _check_length(memoryview(chunk_bytes.as_numpy_array()).cast("B"))
        return await super()._decode_single(chunk_bytes, chunk_spec)


def _check_length(chunk: memoryview) -> None:
    if len(chunk) < _HEAD or int.from_bytes(chunk[_HEAD - 4 : _HEAD], "little") != len(chunk):
        raise RuntimeError(f"a chunk of {len(chunk)} bytes states another length")


def open_store(path: Path) -> zarr.Array[Any] | zarr.Group:
    """An array or a group for reading, as its own files describe it: consolidated metadata count for nothing.

    Raises:
        DataError: see `check_store`.
    """
    check_store(path)
    _check_blosc()
    return zarr.open(path, mode="r", use_consolidated=False)


def _check_blosc() -> None:
    """Give the stores of this process these codecs from now on, whatever was done to Zarr's settings before."""
    name = f"{__name__}.{CheckedBloscCodec.__name__}"
    register_codec("blosc", CheckedBloscCodec, qualname=name)
    zarr.config.set({"codecs.blosc": name})
    numcodecs.register_codec(CheckedBlosc)
