"""The spectral camera's application: cubes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from tmca.applications.base import Application

if TYPE_CHECKING:
    import xarray as xr


class SpectralApplication(Application):
    """Cubes (wavelength, y, x)."""

    kind = "spectral"

    def parts(self, scene: xr.DataArray) -> dict[str, Any]:
        """See ``Application``."""
        return {"bands": scene["wavelength"].values.tolist(), "size": (scene.sizes["y"], scene.sizes["x"])}

    def fitted(self, scene: xr.DataArray, camera: Any, where: str) -> xr.DataArray:
        """See ``Application``; the nearest band for every wavelength."""
        from tmca.data.fitting import fit_cube

        return fit_cube(scene, camera.wavelengths, camera.size, where)

    def tensors(self, scene: xr.DataArray) -> tuple[Tensor, ...]:
        """See ``Application``."""
        return (torch.from_numpy(np.array(scene.values, dtype=np.float32))[None],)

    def metrics(self, estimate: Mapping[str, np.ndarray], truth: xr.DataArray, camera: Any) -> dict[str, float]:
        """See ``Application``: PSNR, SSIM, UIQI, SAM, ERGAS, DD."""
        from tmca.metrics import all_metrics

        return all_metrics(estimate["values"][0], truth.values)
