"""Blosc of Zarr stores, with a look at every chunk first: the library believes whatever length a chunk states."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import zarr
from numcodecs.blosc import Blosc
from numcodecs.registry import codec_registry
from zarr.codecs import BloscCodec
from zarr.registry import register_codec

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


_NAME = f"{__name__}.{CheckedBloscCodec.__name__}"


@contextmanager
def checked_codecs() -> Iterator[None]:
    """Stores that are opened meanwhile have these codecs."""
    before = codec_registry["blosc"]
    register_codec("blosc", CheckedBloscCodec, qualname=_NAME)
    codec_registry["blosc"] = CheckedBlosc
    try:
        with zarr.config.set({"codecs.blosc": _NAME}):
            yield
    finally:
        codec_registry["blosc"] = before
