"""The spectral-depth camera's main job: a scene with depth → snapshot → both again, with files, metrics, pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from tmca.applications.imaging import NOISE_STREAM
from tmca.applications.spectral_depth import spectral_depth_metrics
from tmca.applications.unknown_depth import check_depth_known, unknown_depth
from tmca.cameras import Hardware, Snapshot, SpectralDepthCamera, imperfect
from tmca.cameras.sensor_tiles import check_holds
from tmca.data.depth_scenes import depth_tensor
from tmca.data.fitting import FITTED, middle_of
from tmca.data.scene_names import READING
from tmca.experiments.camera_figures import phase_codes_figure, psf_figure, snapshot_figure
from tmca.experiments.reconstructions import Reconstruction, decoded
from tmca.optics import DepthPlanes, check_mask
from tmca.plots.depth import depth_figure
from tmca.plots.style import save_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


def reading_range(camera: SpectralDepthCamera) -> dict[str, Any]:
    """Bands and depth range of a camera, as `tmca.data.load_spectral_depth` takes them."""
    return {"wavelengths": camera.wavelengths, "near": camera.planes.near, "far": camera.planes.far}


def take_spectral_depth_snapshot(
    scene: xr.Dataset,
    camera: SpectralDepthCamera,
    seed: int = 0,
    progress: Callable[..., None] | None = None,
    hardware: Hardware | None = None,
) -> Snapshot[SpectralDepthCamera]:
    """Image a scene with depth.

    Args:
        scene: ``radiance`` (wavelength, y, x) and ``depth`` (y, x) of the camera's size.
        camera: that takes it.
        seed: of the sensor's noise, whose stream no code shares.
        progress: called with the share that is done.
        hardware: faults of the bench that takes it; the snapshot's camera is the one that is known.

    Raises:
        SettingError: faults that this camera cannot have, or a frame narrower than the point spread functions.
        DataError: a scene of which no depth is within the camera's range.

    Warns:
        StrayLight, Undersampled: point spread functions that do not fit their window, masks steeper than their pixels.
    """
    faults, unknown = hardware or Hardware(), unknown_depth(scene["depth"], camera.planes)
    check_depth_known(unknown, scene["depth"].size, camera.planes, str(scene.attrs.get("name", "scene")))
    check_holds(camera.size, camera.bench.window)
    check_mask(camera.point_spread)
    cube = torch.from_numpy(np.require(scene["radiance"].values, np.float32, ["C", "W"]))[None]
    depth = depth_tensor(scene)
    with torch.no_grad():
        values = imperfect(camera, faults, seed)(cube, depth, generator=NOISE_STREAM + seed, progress=progress)
    notes: dict[str, Any] = {"scene": str(scene.attrs.get("name", "")), "noise_seed": seed, **unknown}
    notes |= {name: scene.attrs[name] for name in (READING, *FITTED) if name in scene.attrs}
    notes |= {"hardware": faults.described()} if faults.faults() else {}
    return Snapshot(values, camera, notes)


def depth_snapshot_files(path: Path, figures: bool) -> list[Path]:
    """What a snapshot and its pictures will be called."""
    pictures = [path.with_name(f"{path.stem}{what}.png") for what in ("", "_codes", "_psf")]
    return [path, *(pictures if figures else [])]


def depth_snapshot_pictures(
    snapshot: Snapshot[SpectralDepthCamera], path: Path, *, overwrite: bool = False
) -> list[Path]:
    """The snapshot, masks with shutter and filters, and the point spread functions as PNG beside a snapshot file."""
    camera, title = snapshot.camera, f"{path.stem}: K = {snapshot.camera.slots}"
    drawings = [
        snapshot_figure(snapshot.values[0].mean(0).numpy(), camera, title),
        phase_codes_figure(camera),
        psf_figure(camera),
    ]
    files = depth_snapshot_files(path, figures=True)[1:]
    return [save_figure(figure, file, overwrite=overwrite) for figure, file in zip(drawings, files, strict=True)]


def reconstruct_spectral_depth(
    snapshot: Snapshot[SpectralDepthCamera],
    decoder: str = "likelihood",
    *,
    truth: xr.Dataset | None = None,
    progress: Callable[..., None] | None = None,
    **how: Any,
) -> Reconstruction:
    """Recover spectrum and depth of a snapshot.

    Args:
        snapshot: with its camera.
        decoder: one of ``tmca.decoders.decoders_for("spectral-depth")``.
        truth: the scene, for metrics.
        progress: called with the share that is done.
        how: ``prior`` (a stationary Gaussian prior of the camera's bands, its file, or None for the rendered scenes')
            and settings of the decoder.
    """
    found = Reconstruction.of(decoded(snapshot, decoder, progress=progress, **how))
    if truth is not None:
        planes = snapshot.camera.planes
        found.metrics = spectral_depth_metrics(found.cube.values, found.depth.values, truth, planes)
    return found


def middle_of_reconstruction(
    found: Reconstruction, size: tuple[int, int], truth: xr.Dataset, planes: DepthPlanes
) -> Reconstruction:
    """(H, W) pixels in the middle of a reconstruction, measured against the same of the truth."""
    inner, real = (middle_of(scene, size, found.decoder) for scene in (found.data, truth))
    metrics = spectral_depth_metrics(inner["radiance"].values, inner["depth"].values, real, planes)
    return replace(found, data=inner, metrics=metrics)


def reconstruction_picture(result: Reconstruction, planes: DepthPlanes, truth: xr.Dataset | None = None) -> Figure:
    """Colour composite, depth with a metric bar, confidence or error, and spectra; the truth in a row of its own."""
    wavelengths, limits = result.cube["wavelength"].values.tolist(), (planes.near, planes.far)
    real = None if truth is None else (truth["radiance"].values, truth["depth"].values)
    estimate = result.cube.values, result.depth.values
    return depth_figure(result.decoder, estimate, result.confidence.values, wavelengths, limits, real)


def spectral_depth_files(path: Path, figures: bool) -> list[Path]:
    """What a reconstruction and its picture will be called."""
    return [path, path.with_suffix(".png")] if figures else [path]


def spectral_depth_pictures(
    result: Reconstruction,
    path: Path,
    *,
    snapshot: Snapshot[SpectralDepthCamera],
    truth: xr.Dataset | None = None,
    overwrite: bool = False,
) -> list[Path]:
    """Colour composites, depth maps, confidence and spectra beside a reconstruction file."""
    figure = reconstruction_picture(result, snapshot.camera.planes, truth)
    return [save_figure(figure, spectral_depth_files(path, figures=True)[1], overwrite=overwrite)]
