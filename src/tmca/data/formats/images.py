"""Images: CAVE folders (one PNG per band), multi-page TIFF, single pictures."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data.formats import wavelengths
from tmca.data.formats.limits import check_array
from tmca.data.formats.stored import Contents, Index, Stored, from_array, lazy, reads, whole_file
from tmca.errors import DataError

_BAND_FILE = re.compile(r"_ms_(\d+)\.png$", re.IGNORECASE)
_MOST_NAMED = 20
"""Missing bands that a message lists."""
PICTURES = (".png", ".jpg", ".jpeg", ".bmp")
_KINDS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".bmp": "BMP", ".pfm": "PFM"}
_HIGH, _LOW = ";16B", ";16L"
"""Pillow's raw modes that keep the first and the second byte of every 16-bit sample."""
_LABEL_NM = re.compile(r"(\d+(?:\.\d+)?)\s*(nm|µm|μm|um)\b", re.IGNORECASE)


def band_files(folder: Path) -> list[Path]:
    """The ``*_ms_NN.png`` of a CAVE scene in band order, also where they lie one folder deeper; [] without.

    Raises:
        DataError: a band is missing or there twice.
    """
    for place in (folder, *sorted(child for child in folder.iterdir() if child.is_dir())):
        numbered = [(int(m[1]), file) for file in place.iterdir() if (m := _BAND_FILE.search(file.name))]
        if numbered:
            numbers, last = {number for number, _ in numbered}, max(number for number, _ in numbered)
            gone = [f"{n:02d}" for n in islice((n for n in range(1, last) if n not in numbers), _MOST_NAMED)]
            if gone or len(numbered) != last:
                more = " and more" if len(gone) == _MOST_NAMED else ""
                found = f"bands without {', '.join(gone)}{more}" if gone else "one band number twice, or a band 0"
                raise DataError(place, found, f"*_ms_01.png to *_ms_{last:02d}.png, each once")
            return [file for _, file in sorted(numbered)]
    return []


def open_cave(folder: Path) -> Contents:
    """A CAVE scene: 16-bit grey PNG per band ("watercolors" has 8-bit RGBA; its one luminance channel is used).

    Raises:
        DataError: no bands, a band missing, or bands of different size or depth.
    """
    files = band_files(folder)
    if not files:
        raise DataError(
            folder,
            "an empty folder" if not any(folder.iterdir()) else "a folder without band images or views",
            "a CAVE scene (*_ms_01.png … *_ms_31.png), a light field (a picture per view) or a Zarr store",
            _what_else(folder)
            or "say how a light field's views are named with pattern= (--pattern), such as view_{row}_{column}.png",
        )
    name = _BAND_FILE.sub("", files[0].name)
    stored = stack_pictures(name, files, (len(files),), ("band",), _grey)
    return Contents(folder, "CAVE folder", {name: replace(stored, usual_axis=0)})


def _what_else(folder: Path) -> str:
    """What to do with a folder that another command wrote; empty of others."""
    if (folder / "manifest.json").is_file():
        return f"an export is read by `tmca export check {folder}`"
    if (folder / "captures.json").is_file():
        return f"frames of a bench are joined in {folder.name}.nc beside it, or measured by `tmca calibrate`"
    pages = sorted(folder.glob("*.html"))
    return f"open {pages[0]} in a browser, or name one file in it" if pages else ""


def stack_pictures(
    name: str,
    files: Sequence[Path],
    shape: tuple[int, ...],
    dims: tuple[str, ...],
    read: Callable[[Path], NDArray[Any]] | None = None,
) -> Stored:
    """Pictures of one size and kind as one array, each read when it is asked for.

    Args:
        name: of the array.
        files: row after row.
        shape: of the axes over files.
        dims: of those.
        read: gives the pixels of a file; `read_picture` without.
    """
    read = read or read_picture
    first, numbers, axes = read(files[0]), np.arange(len(files)).reshape(shape), len(shape)

    def picture(file: Path) -> NDArray[Any]:
        pixels = read(file)
        if pixels.shape != first.shape or pixels.dtype != first.dtype:
            found, expected = (f"pixels of shape {p.shape} and type {p.dtype}" for p in (pixels, first))
            raise DataError(file, found, f"{expected} as in {files[0].name}", "save all alike, or replace it")
        return pixels

    def load(index: Index) -> NDArray[Any]:
        chosen = numbers[index[:axes]]
        check_array(files[0].parent, name, (chosen.size, *first.shape), first.dtype.itemsize)
        parts = [picture(files[int(number)])[index[axes:]] for number in np.ravel(chosen)]
        return np.stack(parts).reshape(*np.shape(chosen), *parts[0].shape)

    return Stored(name, (*shape, *first.shape), first.dtype, load, (*dims, *("y", "x", "channel")[: first.ndim]))


def _grey(file: Path) -> NDArray[Any]:
    """One band: a grey image as it is; of a colour image with equal channels one of them, else their mean."""
    pixels = read_picture(file)
    if pixels.ndim == 2:
        return pixels
    colours = pixels[..., : 1 if pixels.shape[-1] == 2 else 3]
    if (colours == colours[..., :1]).all():
        return np.ascontiguousarray(colours[..., 0])
    return np.rint(colours.mean(axis=-1)).astype(pixels.dtype)


def read_picture(file: Path) -> NDArray[Any]:
    """The pixels of a PNG, JPEG, BMP or PFM in their own depth, palette resolved.

    Colour PNG of 16 bits a channel, which Pillow on its own reduces to 8, is decoded twice, once for each byte.

    Raises:
        DataError: the picture cannot be read whole.
    """
    from PIL import Image

    with _whole_picture(file), Image.open(file) as image:
        _check_picture(file, image)
        raw = str(image.tile[0].args) if image.format == "PNG" and image.tile else ""
        if raw.endswith(_HIGH) and image.mode in ("RGB", "RGBA", "LA"):
            high, low = (_decoded(file, raw.removesuffix(_HIGH) + byte) for byte in (_HIGH, _LOW))
            return np.asarray((high.astype(np.uint16) << 8) | low, dtype=np.uint16)
        image.load()
        return np.asarray(image.convert() if image.mode == "P" else image)


def _check_picture(file: Path, image: Any) -> None:
    """Refuse a picture that takes more memory than may be loaded."""
    channels = len(image.getbands()) * (2 if image.mode.startswith("I;16") else 4 if image.mode in "IF" else 1)
    check_array(file, "a picture", (image.height, image.width), channels)


def _decoded(file: Path, raw: str) -> NDArray[Any]:
    from PIL import Image

    with Image.open(file) as image:
        image.tile = [image.tile[0]._replace(args=raw)]
        image.load()
        return np.asarray(image)


def picture_size(file: Path) -> tuple[int, int]:
    """Height and width of a picture, from its header alone.

    Raises:
        DataError: it is no picture.
    """
    from PIL import Image

    with _whole_picture(file), Image.open(file) as image:
        return image.height, image.width


@contextmanager
def _whole_picture(file: Path) -> Iterator[None]:
    from PIL import Image

    with whole_file(file, _KINDS.get(file.suffix.lower(), "PNG, JPEG or BMP")):
        try:
            yield
        except Image.DecompressionBombError as error:
            pixels = re.search(r"\d+", str(error))
            found = f"a picture of {pixels[0] if pixels else 'too many'} pixels"
            raise DataError(file, found, "fewer than Pillow reads", "save it as TIFF, or in parts") from error


@reads(".pfm")
def open_picture(path: Path) -> Contents:
    """A single picture as one array, ``(y, x)`` or ``(y, x, channel)``."""
    pixels = read_picture(path)
    dims = ("y", "x", "channel")[: pixels.ndim]
    return Contents(path, "picture", {path.stem: from_array(path.stem, pixels, dims=dims)})


@reads(".tif", ".tiff")
def open_tiff(path: Path) -> Contents:
    """A multi-page TIFF, one band per page; wavelengths from ImageJ labels ("450 nm") or OME channels if there."""
    import tifffile

    with whole_file(path, "TIFF"), _complaints() as complaints, tifffile.TiffFile(path) as tiff:
        waves = _from_ome(tiff.ome_metadata)  # before tifffile itself parses that text
        if len(tiff.series) > 1:
            shapes = ", ".join(str(series.shape) for series in tiff.series[:4])
            raise DataError(path, f"pages of different shapes ({shapes})", "bands of one shape")
        _require_whole(path, tiff, complaints)
        stored = _tiff_array(path, tiff, waves)
        return Contents(path, "TIFF", {stored.name: stored}, attrs=dict(tiff.imagej_metadata or {}))


@contextmanager
def _complaints() -> Iterator[list[str]]:
    """What tifffile logs meanwhile: it goes on reading past broken pages with no more than a message."""
    messages: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: messages.append(record.getMessage())  # type: ignore[method-assign]
    logger = logging.getLogger("tifffile")
    before = logger.propagate
    logger.addHandler(handler)
    logger.propagate = False
    try:
        yield messages
    finally:
        logger.removeHandler(handler)
        logger.propagate = before


def _require_whole(path: Path, tiff: Any, complaints: list[str]) -> None:
    """Refuse a file with broken pages or that ends before its pixels do: the library would fill in zeros."""
    broken = [text for text in complaints if "invalid" in text or "corrupted" in text]
    if broken:
        raise ValueError(broken[0])
    series, size = tiff.series[0], path.stat().st_size
    if series.dataoffset is not None:
        end = series.dataoffset + series.nbytes
    else:
        ends = (zip(page.dataoffsets, page.databytecounts, strict=True) for page in series.pages if page)
        end = max(offset + count for page in ends for offset, count in page)
    if end > size:
        raise ValueError(f"{size} bytes of {end}")


def _tiff_array(path: Path, tiff: Any, waves: NDArray[np.float64] | None) -> Stored:
    import tifffile

    series, about = tiff.series[0], tiff.imagej_metadata or {}
    per_page = len(series.pages) == series.shape[0] and len(series.shape) == 3
    labels = [str(label) for label in about.get("Labels") or ()]
    named = not series.axes.startswith("Q")  # else tifffile only guesses: pages may be rows of a channel-last cube

    def read(index: Index) -> NDArray[Any]:
        if per_page and isinstance(index[0], int):
            return np.asarray(tifffile.imread(path, key=index[0]))[index[1:]]
        return np.asarray(tifffile.imread(path))[index]

    return lazy(
        path,
        "TIFF",
        path.stem,
        tuple(series.shape),
        np.dtype(series.dtype),
        read,
        dims=("band", "y", "x") if per_page and named else (),
        wavelengths=_from_labels(labels) if labels else waves,
        usual_axis=0 if per_page else -1,
        pages=per_page,
        full_scale=1.0 if about.get("quantity") == "relative irradiance" else None,
    )


def _from_labels(labels: list[str]) -> NDArray[np.float64] | None:
    """Metres from page labels that each name a wavelength with its unit."""
    matches = [_LABEL_NM.search(label) for label in labels]
    nm = [float(m[1]) * (1.0 if m[2].lower() == "nm" else 1e3) for m in matches if m]
    return wavelengths.nm_to_metres(nm) if len(nm) == len(labels) else None


def _from_ome(xml: str | None) -> NDArray[np.float64] | None:
    """Metres from OME's ``EmissionWavelength`` (nm unless a unit is given), one per channel."""
    if not xml:
        return None
    from defusedxml.ElementTree import fromstring

    channels = [e for e in fromstring(xml).iter() if e.tag.endswith("}Channel")]
    waves = [e.get("EmissionWavelength") for e in channels]
    if not waves or any(wave is None for wave in waves):
        return None
    unit = channels[0].get("EmissionWavelengthUnit", "nm")
    return wavelengths.from_file(np.array([float(wave) for wave in waves if wave]), unit)
