"""The spectral-depth camera's main job: a scene with depth → snapshot → both again, with files, metrics, pictures."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from tmca.applications.unknown_depth import check_depth_known, unknown_depth
from tmca.cameras import Hardware, Snapshot, SpectralDepthCamera, imperfect
from tmca.cameras.checks import check_holds
from tmca.data.depth_scenes import depth_tensor, middle_of
from tmca.data.scene_names import READING
from tmca.decoders.decoding import OtherCodes
from tmca.decoders.networks.depth_weights import DepthWeights, TwoHeadedDecoder, check_fits
from tmca.decoders.networks.neural import same_bands
from tmca.decoders.patch_based.depth_likelihood import DepthDecoded, PatchLikelihood, check_window, usual_window
from tmca.errors import SettingError
from tmca.experiments.camera_figures import phase_codes_figure, psf_figure, snapshot_figure
from tmca.experiments.reconstructions import Reconstruction
from tmca.experiments.snapshots import NOISE_STREAM
from tmca.optics import DepthPlanes, check_mask
from tmca.plots.depth import depth_figure
from tmca.plots.style import save_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from tmca.priors import GaussianPrior

FITTED = ("inverse_depth_scale", "inverse_depth_shift")
"""Attributes of a scene, a snapshot and a reconstruction whose inverse depth was mapped: 1/Z' = scale / Z + shift."""
PLANES = "depth_planes"
"""Attribute of a reconstruction, JSON: nearest and farthest plane in metres, and their number."""
DEPTH_DECODERS = ("likelihood", "network")


@dataclass
class SpectralDepthReconstruction(Reconstruction):
    """A reconstructed cube and depth map with their coordinates.

    Args:
        cube: (wavelength, y, x) estimate.
        depth: (y, x) metres.
        confidence: (y, x) probability that the depth is right within one bin.
    """

    cube: xr.DataArray
    depth: xr.DataArray
    confidence: xr.DataArray

    def parts(self) -> Mapping[str, xr.DataArray | None]:
        """``radiance``, ``depth`` and ``confidence``."""
        return {"radiance": self.cube, "depth": self.depth, "confidence": self.confidence}


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
        progress: told the share that is done.
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
    check_mask(camera.spread)
    cube = torch.from_numpy(np.require(scene["radiance"].values, np.float32, ["C", "W"]))[None]
    depth = depth_tensor(scene)
    with torch.no_grad():
        values = imperfect(camera, faults, seed)(cube, depth, generator=NOISE_STREAM + seed, progress=progress)
    notes: dict[str, Any] = {"scene": str(scene.attrs.get("name", "")), "noise_seed": seed, **unknown}
    notes |= {name: scene.attrs[name] for name in (READING, *FITTED) if name in scene.attrs}
    notes |= {"hardware": faults.said()} if faults.faults() else {}
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
    prior: str | Path | GaussianPrior | None = None,
    weights: str | Path | DepthWeights | None = None,
    window: int | None = None,
    truth: xr.Dataset | None = None,
    progress: Callable[..., None] | None = None,
) -> SpectralDepthReconstruction:
    """Recover spectrum and depth of a snapshot.

    Args:
        snapshot: with its camera.
        decoder: one of ``DEPTH_DECODERS``.
        prior: a stationary Gaussian prior of the camera's bands, its file, or None for the rendered scenes' one; a
            network brings its own.
        weights: of a network: a run or file of `tmca train spectral-depth`.
        window: of the patch likelihood, pixels; `usual_window` if None. A network brings its own.
        truth: the scene, for metrics.
        progress: told the share that is done.

    Raises:
        SettingError: another decoder, or a prior, window or network that does not fit.
        DataError: a prior of another kind.

    Warns:
        OtherCodes: a network that was trained for other codes.
    """
    from time import perf_counter

    from tmca.priors import block_of, find_prior

    if decoder not in DEPTH_DECODERS:
        raise SettingError("decoder", repr(decoder), f"one of {', '.join(DEPTH_DECODERS)}")
    if (decoder == "network") != (weights is not None):
        given = "none" if weights is None else f"given for {decoder}"
        raise SettingError("weights", given, "those of a network, for the network alone", "pass --weights RUN")
    start = perf_counter()
    if weights is not None:
        _refuse_beside_weights(prior=prior, window=window)
        found = _network(weights, snapshot.camera)(snapshot.values, progress)
    else:
        window = usual_window(snapshot.camera) if window is None else window
        check_window(window, snapshot.camera)
        known = find_prior(snapshot.camera, prior, block=block_of(snapshot.camera, window=window))
        found = PatchLikelihood(known, snapshot.camera, window)(snapshot.values, progress, planes=False)
    found.seconds = perf_counter() - start
    return _labelled(found, decoder, snapshot, truth)


def _refuse_beside_weights(**given: Any) -> None:
    for name, value in given.items():
        if value is not None:
            raise SettingError(name, str(value), "none beside weights, which bring their own", "leave it out")


def _network(weights: str | Path | DepthWeights, camera: SpectralDepthCamera) -> TwoHeadedDecoder:
    """The decoder of some weights for a camera."""
    from warnings import warn

    own = weights if isinstance(weights, DepthWeights) else DepthWeights.load(weights)
    check_fits(own.network, camera)
    if not same_bands(own.camera.wavelengths, camera.wavelengths):
        found, wanted = (_bands(one.wavelengths) for one in (own.camera, camera))
        raise SettingError("weights", f"a network for {found}", f"the snapshot's {wanted}", "train one at these bands")
    if other := own.differences(camera):
        known = f"the network was trained for a camera with other {', '.join(other)} than the snapshot's"
        warn(known.replace("_", " "), OtherCodes, stacklevel=3)
    return own.decoder(camera)


def _bands(wavelengths: Sequence[float]) -> str:
    return f"{len(wavelengths)} bands of {min(wavelengths) * 1e9:.4g} to {max(wavelengths) * 1e9:.4g} nm"


def middle_of_reconstruction(
    found: SpectralDepthReconstruction, size: tuple[int, int], truth: xr.Dataset, planes: DepthPlanes
) -> SpectralDepthReconstruction:
    """(H, W) pixels in the middle of a reconstruction, measured against the same of the truth."""
    import xarray as xr

    parts = xr.Dataset({"radiance": found.cube, "depth": found.depth, "confidence": found.confidence})
    inner, real = (middle_of(scene, size, found.decoder) for scene in (parts, truth))
    return replace(
        found, cube=inner["radiance"], depth=inner["depth"], confidence=inner["confidence"],
        metrics=spectral_depth_metrics(inner["radiance"].values, inner["depth"].values, real, planes),
    )  # fmt: skip


def spectral_depth_metrics(
    cube: np.ndarray, depth: np.ndarray, truth: xr.Dataset, planes: DepthPlanes
) -> dict[str, float]:
    """PSNR, SSIM, UIQI, SAM, … of the cube; MAE, RMSE and share within a bin of the depth where it is known.

    ``known_depth`` is the share of pixels where it is, within the range of the planes. One plane has no bins.
    """
    from tmca.metrics import all_metrics, depth_mae, depth_rmse, within_bin

    known = planes.within(torch.from_numpy(np.array(truth["depth"].values)))
    real = np.where(known.numpy(), truth["depth"].values, np.nan)
    found = {"depth_mae": depth_mae(depth, real), "depth_rmse": depth_rmse(depth, real)}
    if planes.count > 1:
        found["within_bin"] = within_bin(depth, real, planes.metres)
    return {**all_metrics(cube, truth["radiance"].values), **found, "known_depth": float(known.double().mean())}


def reconstruction_picture(
    result: SpectralDepthReconstruction, planes: DepthPlanes, truth: xr.Dataset | None = None
) -> Figure:
    """Colour composite, depth with a metric bar, confidence or error, and spectra; the truth in a row of its own."""
    wavelengths, limits = result.cube["wavelength"].values.tolist(), (planes.near, planes.far)
    real = None if truth is None else (truth["radiance"].values, truth["depth"].values)
    estimate = result.cube.values, result.depth.values
    return depth_figure(result.decoder, estimate, result.confidence.values, wavelengths, limits, real)


def spectral_depth_files(path: Path, figures: bool) -> list[Path]:
    """What a reconstruction and its picture will be called."""
    return [path, path.with_suffix(".png")] if figures else [path]


def spectral_depth_pictures(
    result: SpectralDepthReconstruction,
    path: Path,
    *,
    snapshot: Snapshot[SpectralDepthCamera],
    truth: xr.Dataset | None = None,
    overwrite: bool = False,
) -> list[Path]:
    """Colour composites, depth maps, confidence and spectra beside a reconstruction file."""
    figure = reconstruction_picture(result, snapshot.camera.planes, truth)
    return [save_figure(figure, spectral_depth_files(path, figures=True)[1], overwrite=overwrite)]


def _labelled(
    found: DepthDecoded, decoder: str, snapshot: Snapshot[SpectralDepthCamera], truth: xr.Dataset | None
) -> SpectralDepthReconstruction:
    import xarray as xr

    waves = ("wavelength", np.array(snapshot.camera.wavelengths), {"units": "m"})
    cube, depth, confidence = found.estimate[0].numpy(), found.depth[0, 0].numpy(), found.confidence[0, 0].numpy()
    named, planes = {"long_name": f"estimated by {decoder}"}, snapshot.camera.planes
    return SpectralDepthReconstruction(
        cube=xr.DataArray(cube, dims=("wavelength", "y", "x"), coords={"wavelength": waves}, attrs=named),
        depth=xr.DataArray(depth, dims=("y", "x"), attrs={**named, "units": "m"}),
        confidence=xr.DataArray(confidence, dims=("y", "x"), attrs={**named, "units": "1"}),
        decoder=decoder,
        seconds=found.seconds,
        metrics={} if truth is None else spectral_depth_metrics(cube, depth, truth, planes),
        notes={**snapshot.notes, **found.notes, PLANES: json.dumps(asdict(planes))},
    )
