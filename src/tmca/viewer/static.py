"""The page as one file without a server: planes in it as whole numbers, thinned out until they are few enough bytes."""

from __future__ import annotations

import base64
import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data import plain, write_text
from tmca.data.atomic import check_target
from tmca.errors import OutputError, SettingError
from tmca.viewer.gallery import Gallery
from tmca.viewer.items import Item, Layer, thinning
from tmca.viewer.page import whole_page

MOST = 10 * 10**6
"""Bytes of a page."""
_FEWEST, _PIXELS = 2**8, 2**20
"""Pixels of a plane: at least, or else it cannot be written; at first."""
_LEAVES = 0.97


def write_page(gallery: Gallery, path: str | Path, *, overwrite: bool = False, most: int = MOST) -> Path:
    """Write one HTML file with all that a gallery shows, and give the path back.

    Values are rounded to 254 levels between a plane's lowest and highest; large planes are thinned out.

    Raises:
        OutputError: the file exists, or cannot be written.
        SettingError: more than fits into such a file.
    """
    path = Path(path)
    if path.suffix.lower() not in (".html", ".htm"):
        raise OutputError(path, f"the suffix {path.suffix!r}", ".html", "rename the output")
    check_target(path, overwrite)
    pixels = _PIXELS
    while len((page := whole_page(embedded=_embedded(gallery, pixels, most))).encode()) > most:
        pixels //= 2
        if pixels < _FEWEST:
            planes = sum(layer.planes for item in gallery.items for layer in item.layers)
            found = f"{planes} planes, more than {most / 1e6:g} MB hold"
            raise SettingError("static", found, "fewer or smaller files", "write a page for each file")
    return write_text(page, path, overwrite=overwrite)


def _embedded(gallery: Gallery, pixels: int, most: int) -> str:
    """JSON of facts and planes; cut short, and too long, where there are too many."""
    planes: dict[str, Any] = {}
    size = 0
    for number, item in enumerate(gallery.items):
        for layer in item.layers:
            step = thinning(layer.size, pixels)
            for index in range(layer.planes):
                held = _plane(item, layer, index, step)
                planes[f"{number}/{layer.name}/{index}"] = held
                size += len(held["data"])
                if size > _LEAVES * most:
                    return " " * most
    about = {"items": [item.about(pixels) for item in gallery.items]}
    return json.dumps(plain({"about": about, "planes": planes}), ensure_ascii=False, separators=(",", ":"))


def _plane(item: Item, layer: Layer, index: int, step: int) -> dict[str, Any]:
    with item.lock:
        item.check()
        values = layer.plane(index, step)
    if layer.colours == "picture":
        return {"data": _packed(values)}
    whole, low, high = _levels(values)
    return {"data": _packed(whole), "low": low, "high": high, "bits": 8}


def _levels(values: NDArray[Any]) -> tuple[NDArray[np.uint8], float, float]:
    """Values as 0 to 254, of a lowest and a highest, and 255 of what is no finite number."""
    good = np.isfinite(values)
    low, high = (float(values[good].min()), float(values[good].max())) if good.any() else (0.0, 1.0)
    share = (np.where(good, values, low) - low) / ((high - low) or 1.0)
    return np.where(good, np.round(254 * share), 255).astype(np.uint8), low, high


def _packed(values: NDArray[Any]) -> str:
    return base64.b64encode(zlib.compress(np.ascontiguousarray(values).tobytes(), 6)).decode()
