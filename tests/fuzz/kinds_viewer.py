"""What the viewer opens: facts, planes and curves of every layer, as its page asks for them."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

from tests.fuzz.kinds import KINDS, kind
from tmca.viewer.gallery import Gallery

_OPENED = {
    "scene.nc": "cube.nc", "matlab5.mat": "cube.mat", "bands.bsq": "cube.bsq", "imagej.tif": "cube.tif",
    "picture.png": "picture.png", "array.npy": "array.npy", "views.nc": "light_field.nc", "views_hci": "light_field",
    "depth_scene.nc": "depth.nc", "rgbd_2014": "depth", "buckets-snapshot.nc": "snapshot.nc",
    "spectral-estimate.nc": "estimate.nc", "export": "export",
}  # fmt: skip
"""Kinds of other rooms, which are loaded before, and what their names are here."""


def _viewed(path: Path) -> list[Any]:
    """The first and the last plane of every layer, and its curve at a pixel."""
    with closing(Gallery([path])) as gallery:
        found: list[Any] = [gallery.about()["items"]]
        for number, item in enumerate(gallery.items):
            for layer in item.layers:
                rows, columns = (0, layer.size[0]), (0, layer.size[1])
                found += [gallery.plane(number, layer.name, at, 1, rows, columns) for at in {0, layer.planes - 1}]
                found.append(gallery.profile(number, layer.name, (0, 1), (0, 1))["mean"])
        return found


for _theirs, _ours in _OPENED.items():
    kind(f"viewed-{_ours}", KINDS[_theirs].make, _viewed, infinite=True)
