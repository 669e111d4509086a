"""The spectral-depth camera's application: cubes with a depth for every pixel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from tmca.applications.base import Application
from tmca.applications.unknown_depth import check_depth_known, unknown_depth

if TYPE_CHECKING:
    import xarray as xr

    from tmca.optics import DepthPlanes


class SpectralDepthApplication(Application):
    """Data sets of ``radiance`` (wavelength, y, x) and ``depth`` (y, x) in metres."""

    kind = "spectral-depth"

    def parts(self, scene: xr.Dataset) -> dict[str, Any]:
        """See ``Application``."""
        waves = scene["wavelength"].values.tolist()
        return {"bands": waves, "size": (scene.sizes["y"], scene.sizes["x"])}

    def fitted(self, scene: xr.Dataset, camera: Any, where: str) -> xr.Dataset:
        """See ``Application``; depth that reaches beyond the camera's range is mapped onto it, evenly in inverse depth,
        unless the scene says that it was mapped already."""
        from tmca.data.fitting import fit_depth_scene

        planes = camera.planes
        return fit_depth_scene(scene, camera.wavelengths, camera.size, planes.near, planes.far, where)

    def tensors(self, scene: xr.Dataset) -> tuple[Tensor, ...]:
        """See ``Application``."""
        from tmca.data.depth_scenes import depth_tensor

        cube = torch.from_numpy(np.array(scene["radiance"].values, dtype=np.float32))
        return cube[None], depth_tensor(scene)

    def check(self, scene: xr.Dataset, camera: Any) -> dict[str, Any]:
        """See ``Application``: pixels whose depth the camera does not know, how the scene was read and mapped.

        Warns:
            StrayLight, Undersampled: point spread functions that do not fit their window, masks steeper than their
                pixels.
        """
        from tmca.cameras.sensor_tiles import check_holds
        from tmca.data.fitting import FITTED
        from tmca.data.scene_names import READING
        from tmca.optics import check_mask

        unknown = unknown_depth(scene["depth"], camera.planes)
        check_depth_known(unknown, scene["depth"].size, camera.planes, str(scene.attrs.get("name", "scene")))
        check_holds(camera.size, camera.bench.window)
        check_mask(camera.point_spread)
        return {**unknown, **{name: scene.attrs[name] for name in (READING, *FITTED) if name in scene.attrs}}

    def metrics(self, estimate: Mapping[str, np.ndarray], truth: xr.Dataset, camera: Any) -> dict[str, float]:
        """See ``Application``: those of the cube, and of the depth where it is known."""
        return spectral_depth_metrics(estimate["values"][0], estimate["depth"], truth, camera.planes)


def spectral_depth_metrics(
    cube: np.ndarray, depth: np.ndarray, truth: xr.Dataset, planes: DepthPlanes
) -> dict[str, float]:
    """PSNR, SSIM, UIQI, SAM, … of the cube; MAE, RMSE and share within a bin of the depth where it is known.

    ``known_depth`` is the share of pixels where it is, within the range of the planes. One plane has no bins.
    """
    from tmca.metrics import all_metrics, depth_mae, depth_rmse, within_bin

    within = planes.within(torch.from_numpy(np.array(truth["depth"].values)))
    real = np.where(within.numpy(), truth["depth"].values, np.nan)
    figures = {"depth_mae": depth_mae(depth, real), "depth_rmse": depth_rmse(depth, real)}
    if planes.count > 1:
        figures["within_bin"] = within_bin(depth, real, planes.metres)
    return {**all_metrics(cube, truth["radiance"].values), **figures, "known_depth": float(within.double().mean())}
