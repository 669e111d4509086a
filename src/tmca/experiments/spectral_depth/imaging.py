"""What comparisons of the spectral-depth camera have of snapshots and estimates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from tmca.applications import simulate
from tmca.applications.spectral_depth import reading_range, spectral_depth_metrics
from tmca.cameras import Hardware, Snapshot, SpectralDepthCamera
from tmca.data.fitting import middle_of
from tmca.experiments.reconstructions import Reconstruction
from tmca.experiments.reconstructions import reconstruct as reconstruct_spectral_depth
from tmca.optics import DepthPlanes

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["middle_of_reconstruction", "reading_range", "reconstruct_spectral_depth", "take_spectral_depth_snapshot"]


def take_spectral_depth_snapshot(
    scene: xr.Dataset,
    camera: SpectralDepthCamera,
    seed: int = 0,
    progress: Callable[..., None] | None = None,
    hardware: Hardware | None = None,
) -> Snapshot[SpectralDepthCamera]:
    """`simulate`."""
    return simulate(scene, camera, seed=seed, progress=progress, hardware=hardware)


def middle_of_reconstruction(
    found: Reconstruction, size: tuple[int, int], truth: xr.Dataset, planes: DepthPlanes
) -> Reconstruction:
    """(H, W) pixels in the middle of a reconstruction, measured against the same of the truth."""
    inner, real = (middle_of(scene, size, found.decoder) for scene in (found.data, truth))
    metrics = spectral_depth_metrics(inner["radiance"].values, inner["depth"].values, real, planes)
    return replace(found, data=inner, metrics=metrics)
