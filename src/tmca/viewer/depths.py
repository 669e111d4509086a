"""Scenes with depth as items: colours or bands, the depth of every pixel, and how sure it is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data import Contents, read_rgbd
from tmca.data.fitting import said_mapped, unmapped_depth
from tmca.data.pixels import encoded
from tmca.data.point_cloud import FOCAL
from tmca.viewer.cubes import ONE, stored_maps
from tmca.viewer.items import Item, Layer, in_memory


def with_depth(item: Item, contents: Contents) -> Item:
    """A cube's item with the depth and the confidence that lie beside it in its file; the same without any.

    Depth that was mapped onto the range of a camera is mapped back to the metres of the scene."""
    maps = stored_maps(contents, item.layers[0].size)
    if "depth" not in maps:
        return item
    stored = maps["depth"].whole()
    depth = unmapped_depth(stored, contents.attrs).astype(np.float32)
    layers = [*item.layers, depth_layer(depth, bool(contents.attrs.get("metric", True)))]
    if "confidence" in maps:
        confidence = in_memory(maps["confidence"].whole().astype(np.float32)[None])
        label = "probability of the depth"
        layers.append(Layer("confidence", label, item.layers[0].size, ONE, confidence, span=(0.0, 1.0)))
    facts = {**item.facts, **_facts(depth), **_mapped(stored, contents.attrs)}
    view = {"focal": _focal(contents.attrs, depth.shape[1])}
    return Item("depth", item.title, tuple(layers), facts, item.role, view=view, check=item.check)


def _mapped(stored: NDArray[Any], attrs: Mapping[str, Any]) -> dict[str, str]:
    """That the depth that is shown is the scene's, and that of the file another."""
    known = stored[np.isfinite(stored) & (stored > 0)]
    said = said_mapped(attrs, known.min(), known.max()) if known.size else ""
    return {"metres": f"the scene's; figures of merit are those of the mapped scene: {said}"} if said else {}


def _focal(attrs: Mapping[str, Any], width: int) -> float:
    """Focal length of saved points, in widths of the picture: the camera's, or 1 where it is not known."""
    known = attrs.get(FOCAL)
    return float(known) / width if isinstance(known, int | float | np.number) and known > 0 else 1.0


def depth_layer(depth: NDArray[np.float32], metric: bool = True) -> Layer:
    """A map of depths; what is unknown is no number."""
    known = np.where(np.isfinite(depth) & (depth > 0), depth, np.nan).astype(np.float32)
    size = known.shape[0], known.shape[1]
    return Layer("depth", "depth", size, ONE, in_memory(known[None]), "m" if metric else "", "depth")


def rgbd_item(path: Any, title: str, **about: Any) -> Item:
    """A picture with its depth.

    Raises:
        DataError: see `tmca.data.read_rgbd`.
    """
    scene = read_rgbd(path)
    picture = np.round(255 * np.moveaxis(encoded(scene["rgb"].values), 0, -1)).astype(np.uint8)
    depth = depth_layer(scene["depth"].values.astype(np.float32), bool(scene.attrs["metric"]))
    colour = Layer("colour", "colours", depth.size, ONE, in_memory(picture[None]), colours="picture")
    facts = {"size": f"{depth.size[0]} × {depth.size[1]} pixels", "format": str(scene.attrs["format"])}
    view = {"focal": _focal(scene.attrs, depth.size[1])}
    return Item("depth", title, (depth, colour), {**facts, **_facts(scene["depth"].values)}, view=view, **about)


def _facts(depth: NDArray[Any]) -> dict[str, Any]:
    good = depth[np.isfinite(depth) & (depth > 0)]
    if not good.size:
        return {"depth": "unknown everywhere"}
    return {
        "depth": f"{good.min():.4g} to {good.max():.4g} m",
        "depth known": f"{good.size / depth.size:.1%} of the pixels",
    }
