"""ENVI cubes: a text header and a flat binary file, read through the ``spectral`` library."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from tmca.attributes import Attributes, attributes_of
from tmca.data.formats import wavelengths
from tmca.data.formats.stored import Contents, from_array, reads, whole_file
from tmca.errors import DataError

DATA_SUFFIXES = ("", ".img", ".dat", ".raw", ".bin", ".bsq", ".bil", ".bip", ".envi", ".hyspex", ".cube")
"""Suffixes that the data file beside a header may have; upper case is tried as well."""


_Size = Annotated[int, Field(strict=False, ge=1, le=10**9)]


class _Header(Attributes):
    """What places the values in the data file, and scales them."""

    samples: _Size
    lines: _Size
    bands: _Size
    offset: int = Field(default=0, alias="header offset", strict=False, ge=0, le=2**62)
    scale: float | None = Field(default=None, alias="reflectance scale factor", strict=False, ge=1e-9, le=1e12)


def header_of(path: Path) -> Path | None:
    """The ENVI header of ``path``: itself, or the ``.hdr`` beside a data file; None if there is none."""
    if path.suffix.lower() == ".hdr":
        return path
    beside = (path.with_name(path.name + ".hdr"), path.with_suffix(".hdr"))
    return next((header for header in beside if header.is_file()), None)


def _data_of(header: Path, asked: Path) -> Path:
    if asked != header:
        return asked
    stem = header.with_suffix("")
    names = [stem.with_name(stem.name + s) for suffix in DATA_SUFFIXES for s in (suffix, suffix.upper())]
    data = next((name for name in names if name.is_file()), None)
    if data is None:
        expected = f"{stem.name} with one of {' '.join(DATA_SUFFIXES[1:])}"
        raise DataError(header, "no data file beside the header", expected, "add it")
    return data


@reads(".hdr", *DATA_SUFFIXES[1:])
def open_envi(path: Path) -> Contents:
    """An ENVI cube from its header or its data file, memory-mapped, axes ``(y, x, band)`` for any interleave.

    Raises:
        DataError: no header, no data file, a header that is not ENVI's, or data shorter than the header says.
    """
    from spectral.io import envi

    header = header_of(path)
    if header is None:
        raise DataError(path, "no .hdr beside it", "an ENVI header", f"add {path.stem}.hdr")
    data = _data_of(header, path)
    with whole_file(header, "ENVI header"):
        metadata = envi.read_envi_header(str(header))
    stated = attributes_of(_Header, metadata, header, "entry")
    with whole_file(header, "ENVI header"):
        image = envi.open(str(header), str(data))
        size = image.sample_size
    needed = stated.offset + stated.lines * stated.samples * stated.bands * size
    if data.stat().st_size < needed:
        raise DataError(data, f"{data.stat().st_size} bytes", f"{needed} bytes by {header.name}", "fetch it again")
    with whole_file(data, "ENVI data file"):
        values, dims = image.open_memmap(interleave="bip"), ("y", "x", "band")
    metres = wavelengths.from_file(image.bands.centers or [], metadata.get("wavelength units"))
    cube = from_array(data.stem, values, dims=dims, wavelengths=metres, full_scale=stated.scale)
    short = {key: value for key, value in metadata.items() if isinstance(value, str | int | float)}
    return Contents(path, "ENVI", {data.stem: cube}, attrs=short)
