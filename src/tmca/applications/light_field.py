"""The light-field camera's application: views."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from torch import Tensor

from tmca.applications.base import Application

if TYPE_CHECKING:
    import xarray as xr


class LightFieldApplication(Application):
    """Light fields (view_v, view_u, y, x), or with colours first, each a snapshot of its own."""

    kind = "light-field"

    def parts(self, scene: xr.DataArray) -> dict[str, Any]:
        """See ``Application``."""
        views = (scene.sizes["view_v"], scene.sizes["view_u"])
        return {"views": views, "size": (scene.sizes["y"], scene.sizes["x"])}

    def fitted(self, scene: xr.DataArray, camera: Any, where: str) -> xr.DataArray:
        """See ``Application``; the views in the middle of the grid."""
        from tmca.data.fitting import fit_views

        return fit_views(scene, camera.views, camera.size, where)

    def tensors(self, scene: xr.DataArray) -> tuple[Tensor, ...]:
        """See ``Application``."""
        from tmca.data.light_field_scenes import as_batch

        return (as_batch(scene),)

    def check(self, scene: xr.DataArray, camera: Any) -> dict[str, Any]:
        """See ``Application``: how the scene was read."""
        from tmca.data.scene_names import READING

        return {READING: scene.attrs[READING]} if READING in scene.attrs else {}

    def metrics(self, estimate: Mapping[str, np.ndarray], truth: xr.DataArray, camera: Any) -> dict[str, float]:
        """See ``Application``: PSNR and SSIM of all views and of the worst."""
        from tmca.metrics import light_field_metrics

        values = estimate["values"]
        return light_field_metrics(values if len(values) > 1 else values[0], truth.values)
