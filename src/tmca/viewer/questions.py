"""What a page asks without a server, answered from a gallery: the paths and settings are those of the server."""

from __future__ import annotations

from typing import Any

from tmca.data import plain
from tmca.errors import TmcaError
from tmca.viewer.gallery import Gallery, NotShown
from tmca.viewer.items import Rows


def answer(gallery: Gallery, question: Any) -> tuple[dict[str, Any], list[bytes]]:
    """What a gallery answers to ``{"path": …, "given": {…}}``, as JSON and as bytes: see `tmca.viewer.server`."""
    try:
        return _answered(gallery, question["path"], question["given"])
    except TmcaError as error:
        return {"error": str(error)}, []
    except (NotShown, KeyError, TypeError, ValueError):
        return {"error": "there is no such thing"}, []


def _answered(gallery: Gallery, path: str, given: dict[str, Any]) -> tuple[dict[str, Any], list[bytes]]:
    if path == "about":
        return {"said": plain(gallery.about())}, []
    item, layer = int(given["item"]), str(given["layer"])
    rows, columns = _part(given, "y"), _part(given, "x")
    if path == "profile":
        return {"said": gallery.profile(item, layer, rows, columns)}, []
    if path != "plane":
        raise NotShown
    step = max(int(given["step"]), 1)
    return {"said": None}, [gallery.plane(item, layer, int(given["index"]), step, rows, columns).tobytes()]


def _part(given: dict[str, Any], axis: str) -> Rows:
    return int(given[f"{axis}0"]), int(given[f"{axis}1"])
