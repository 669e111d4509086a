"""The one way into a Zarr store: what it says of codecs, chunks and sizes is checked before anything is decoded, and so
is every chunk of blosc, of which the library believes whatever length it states."""

from __future__ import annotations

from collections.abc import Iterator
from math import prod
from pathlib import Path
from typing import Any

import numcodecs
import zarr
from numcodecs.blosc import Blosc
from pydantic import Field
from zarr.codecs import BloscCodec
from zarr.registry import register_codec

from tmca.attributes import Attributes, read_json
from tmca.data.formats.limits import check_array
from tmca.errors import DataError

CODECS = frozenset(
    {
        *("blosc", "bz2", "gzip", "lz4", "lzma", "zlib", "zstd"),
        *("adler32", "crc32", "crc32c", "fletcher32", "jenkins_lookup3"),
        *("astype", "bitround", "bytes", "delta", "endian", "fixedscaleoffset", "packbits", "quantize", "shuffle"),
        *("sharding_indexed", "transpose", "vlen-array", "vlen-bytes", "vlen-utf8"),
    }
)
"""Codecs that do no more than turn bytes into numbers and texts; others, such as ``pickle``, can run code."""
_MOST_CHUNKS = 10_000_000


class _Grid(Attributes):
    name: str = "regular"
    configuration: dict[str, Any] = Field(default_factory=dict)


class _Array(Attributes):
    """What counts of a ``.zarray`` (version 2) or ``zarr.json`` (version 3)."""

    shape: list[int] = Field(default_factory=list, max_length=32)
    chunks: list[int] | None = None
    chunk_grid: _Grid | None = None
    compressor: Any = None
    filters: Any = None
    codecs: Any = None
    storage_transformers: Any = None


def check_store(path: Path) -> None:
    """Refuse a store whose arrays use codecs that are not on the list, no chunks or too many, or huge coordinates.

    Args:
        path: its folder; its own array and those of its first level are looked at.

    Raises:
        DataError: naming the file at fault.
    """
    for folder in (path, *sorted(child for child in path.iterdir() if child.is_dir())):
        for name in (".zarray", "zarr.json"):
            if (folder / name).is_file():
                _check_array(folder / name, path)


def _check_array(file: Path, store: Path) -> None:
    about = read_json(file, _Array)
    for codec in _codecs([about.compressor, about.filters, about.codecs, about.storage_transformers]):
        if codec.removeprefix("numcodecs.") not in CODECS:
            raise DataError(file, f"the codec {codec!r}", f"one of {', '.join(sorted(CODECS))}", "store it without")
    chunks = about.chunks or (about.chunk_grid.configuration.get("chunk_shape") if about.chunk_grid else None)
    if len(about.shape) == 1:
        check_array(store, file.parent.name, about.shape, 8)
    if chunks is not None:
        _check_chunks(file, about.shape, chunks)


def _check_chunks(file: Path, shape: list[int], chunks: Any) -> None:
    whole = isinstance(chunks, list) and all(isinstance(size, int) and size > 0 for size in chunks)
    if not whole or len(chunks) != len(shape):
        raise DataError(file, f"chunks {str(chunks)[:80]} of shape {shape}", "a size above 0 for every axis")
    count = prod(-(-size // chunk) for size, chunk in zip(shape, chunks, strict=True))
    if count > _MOST_CHUNKS:
        raise DataError(file, f"{count:.1e} chunks", f"at most {_MOST_CHUNKS:.0e}", "store it in larger chunks")


def _codecs(said: Any) -> Iterator[str]:
    """Every codec's name, those inside others too."""
    if isinstance(said, list):
        for part in said:
            yield from _codecs(part)
    elif isinstance(said, dict):
        yield str(said.get("id", said.get("name")))
        inside = said.get("configuration")
        if isinstance(inside, dict):
            yield from _codecs([inside.get("codecs"), inside.get("index_codecs")])


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
