"""What ``tmca inspect`` says about depth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.data.depth_maps import label_depth, stored_metres
from tmca.data.formats.stored import Contents
from tmca.data.rgbd import read_rgbd
from tmca.errors import TmcaError

if TYPE_CHECKING:
    import xarray as xr


def depth_facts(depth: xr.DataArray, metric: bool) -> dict[str, Any]:
    """Range in metres where they are metric, pixels, how many are unknown and why, and whether they are metric."""
    counts = {key: int(depth.attrs[key]) for key in depth.attrs if key.startswith("unknown_")}
    facts: dict[str, Any] = {"pixels": depth.size, **counts, "metric": metric}
    if not metric:
        return facts
    known = depth.values[np.isfinite(depth.values)]
    near, median, far = (float(v) for v in np.percentile(known, [0, 50, 100]))
    return {"near": near, "median": median, "far": far, **facts}


def depth_in(contents: Contents) -> dict[str, Any] | None:
    """Facts of the depth map in a file beside its cube; None without, a ``note`` where it cannot be used."""
    if "depth" not in contents.arrays:
        return None
    try:
        depth = label_depth(stored_metres(contents.path)[0], contents.path)
    except TmcaError as error:
        return {"note": str(error)}
    return depth_facts(depth, bool(contents.attrs.get("metric", True)))


def light_field_depth(folder: Path) -> dict[str, Any] | None:
    """Facts of the depth that a light field's true disparity gives; None where it is no RGB-D scene."""
    try:
        scene = read_rgbd(folder) if folder.is_dir() else None
    except TmcaError:
        return None
    return None if scene is None else depth_facts(scene["depth"], bool(scene.attrs["metric"]))
