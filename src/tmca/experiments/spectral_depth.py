"""The spectral-depth camera's main job: a scene with depth → snapshot → both again, with files, metrics, pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from tmca.cameras import Snapshot, SpectralDepthCamera
from tmca.decoders.depth_likelihood import WINDOW, DepthDecoded, PatchLikelihood
from tmca.errors import DataError, SettingError
from tmca.experiments.figures import save_figure
from tmca.experiments.snapshots import NOISE_STREAM
from tmca.experiments.spectral_depth_figures import depth_figure

if TYPE_CHECKING:
    import xarray as xr

    from tmca.priors import GaussianPrior

DEPTH_DECODERS = ("likelihood",)


@dataclass
class SpectralDepthReconstruction:
    """A reconstructed cube and depth map with their coordinates.

    Args:
        cube: (wavelength, y, x) estimate.
        depth: (y, x) metres.
        confidence: (y, x) probability that the depth is right within one bin.
        decoder: which one.
        seconds: wall time.
        metrics: against the truth, if it is known.
        notes: settings and provenance, kept as attributes.
    """

    cube: xr.DataArray
    depth: xr.DataArray
    confidence: xr.DataArray
    decoder: str
    seconds: float
    metrics: dict[str, float] = field(default_factory=dict)
    notes: dict[str, Any] = field(default_factory=dict)

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write ``radiance``, ``depth`` and ``confidence`` to a NetCDF file, notes and metrics as its attributes.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        import xarray as xr

        from tmca.data import write_dataset

        measured = {f"metric_{name}": value for name, value in self.metrics.items()}
        parts = {"radiance": self.cube, "depth": self.depth, "confidence": self.confidence}
        attrs = {**self.notes, "decoder": self.decoder, "seconds": self.seconds, **measured}
        return write_dataset(xr.Dataset(parts, attrs=attrs), path, overwrite=overwrite)


def load_spectral_depth(
    source: str,
    wavelengths: Sequence[float],
    *,
    near: float,
    far: float,
    size: tuple[int, int] | None = None,
    reduce: int = 1,
    placed: str | None = None,
    from_rgb: bool = False,
    seed: int = 0,
) -> xr.Dataset:
    """A spectral scene with depth, brought to bands, size and depth range of a camera.

    Inverse depth of scenes from files and photographs is mapped affinely onto the range (``tmca.data.fitted_depth``).

    Args:
        source: a rendered scene, a file or folder of ``tmca.data.read_spectral_depth``, an RGB-D scene with
            ``from_rgb``, or a spectral cube with ``placed``.
        wavelengths: (L,) of the camera, metres.
        near, far: its depth range, metres.
        size: (H, W) centre crop.
        reduce: pixels per axis that are averaged into one.
        placed: how a cube without depth is put at drawn depths: a kind of ``tmca.data.place_cube``.
        from_rgb: make up spectra for an RGB-D scene.
        seed: of what is drawn.

    Returns:
        ``radiance`` (wavelength, y, x) and ``depth`` (y, x), metres, NaN where unknown or outside.

    Raises:
        DataError, SettingError: no such scene, or one that cannot be used so.
    """
    from tmca.data import fitted_depth, place_cube, read, read_spectral_depth, rendered_names, rendered_scene

    if not Path(source).exists() and source in rendered_names():
        scene = rendered_scene(source, wavelengths=wavelengths, seed=seed)[["radiance", "depth"]]
    elif placed is not None:
        scene = place_cube(_at_bands(read(source), wavelengths), near, far, seed, placed)  # type: ignore[arg-type]
    else:
        how: dict[str, Any] = {"wavelengths": wavelengths, "seed": seed} if from_rgb else {}
        scene = read_spectral_depth(source, from_rgb=from_rgb, reduce=reduce, **how)
        reduce = 1
    scene = _reduced(scene, reduce)
    scene["radiance"] = _at_bands(scene["radiance"], wavelengths)
    scene = scene if size is None else _cropped(scene, size, source)
    if placed is None:
        scene["depth"], about = fitted_depth(scene["depth"], near, far)
        scene.attrs.update(about)
    scene.attrs["name"] = Path(source).stem
    return scene


def _at_bands(cube: xr.DataArray, wavelengths: Sequence[float]) -> xr.DataArray:
    """The cube's nearest band for every wavelength.

    Raises:
        DataError: a wavelength farther from every band than half their spacing.
    """
    own = cube["wavelength"].values
    wanted = np.asarray(wavelengths)
    if len(own) == len(wanted) and np.allclose(own, wanted, rtol=1e-6):
        return cube
    chosen = np.abs(own[:, None] - wanted).argmin(0)
    spacing = np.diff(own).max() if len(own) > 1 else 20e-9
    worst = int(np.abs(own[chosen] - wanted).argmax())
    if abs(own[chosen][worst] - wanted[worst]) > spacing / 2 * (1 + 1e-6) or len(set(chosen)) < len(wanted):
        found = f"bands from {own[0] * 1e9:.0f} to {own[-1] * 1e9:.0f} nm"
        raise DataError(cube.attrs.get("source", "cube"), found, f"one near {wanted[worst] * 1e9:.0f} nm")
    return cube.isel(wavelength=chosen).assign_coords(wavelength=("wavelength", wanted, {"units": "m"}))


def _reduced(scene: xr.Dataset, by: int) -> xr.Dataset:
    if by == 1:
        return scene
    from tmca.data.rendering.resample import area_average, nearest

    height, width = (scene.sizes[axis] // by for axis in ("y", "x"))
    kept = scene.isel(y=slice(0, height * by), x=slice(0, width * by))
    cube = kept["radiance"].isel(y=slice(0, height), x=slice(0, width))
    cube = cube.copy(data=area_average(kept["radiance"].values, (height, width)))
    depth = kept["depth"].isel(y=slice(0, height), x=slice(0, width))
    return scene.isel(y=slice(0, height), x=slice(0, width)).assign(
        radiance=cube, depth=depth.copy(data=nearest(kept["depth"].values, (height, width)))
    )


def _cropped(scene: xr.Dataset, size: tuple[int, int], source: str) -> xr.Dataset:
    from tmca.data.light_fields import centre_window

    rows, columns = centre_window((scene.sizes["y"], scene.sizes["x"]), size, None, source)
    return scene.isel(y=rows, x=columns)


def depth_tensor(scene: xr.Dataset) -> Tensor:
    """(1, 1, H, W) metres."""
    return torch.from_numpy(np.array(scene["depth"].values, dtype=np.float32))[None, None]


def take_spectral_depth_snapshot(
    scene: xr.Dataset, camera: SpectralDepthCamera, seed: int = 0
) -> Snapshot[SpectralDepthCamera]:
    """Image a scene with depth.

    Args:
        scene: ``radiance`` (wavelength, y, x) and ``depth`` (y, x) of the camera's size.
        camera: that takes it.
        seed: of the sensor's noise, whose stream no code shares.
    """
    cube, depth = torch.from_numpy(np.array(scene["radiance"].values, dtype=np.float32))[None], depth_tensor(scene)
    with torch.no_grad():
        values = camera(cube, depth, NOISE_STREAM + seed)
    unknown = int((~camera.planes.known(depth)).sum())
    notes = {"scene": str(scene.attrs.get("name", "")), "noise_seed": seed, "unknown_depth_pixels": unknown}
    return Snapshot(values, camera, notes)


def reconstruct_spectral_depth(
    snapshot: Snapshot[SpectralDepthCamera],
    decoder: str = "likelihood",
    *,
    prior: str | Path | GaussianPrior | None = None,
    window: int = WINDOW,
    truth: xr.Dataset | None = None,
    progress: Callable[..., None] | None = None,
) -> SpectralDepthReconstruction:
    """Recover spectrum and depth of a snapshot.

    Args:
        snapshot: with its camera.
        decoder: one of ``DEPTH_DECODERS``.
        prior: a stationary Gaussian prior of the camera's bands, its file, or None for the rendered scenes' one.
        window: of the patch likelihood, pixels.
        truth: the scene, for metrics.
        progress: told the share that is done.

    Raises:
        SettingError: another decoder, or a prior that does not fit.
    """
    from time import perf_counter

    if decoder not in DEPTH_DECODERS:
        raise SettingError("decoder", repr(decoder), f"one of {', '.join(DEPTH_DECODERS)}")
    known = find_depth_prior(prior, snapshot.camera, window)
    start = perf_counter()
    found = PatchLikelihood(known, snapshot.camera, window)(snapshot.values, progress)
    found.seconds = perf_counter() - start
    return _labelled(found, decoder, snapshot, truth)


def find_depth_prior(prior: str | Path | GaussianPrior | None, camera: SpectralDepthCamera, window: int) -> Any:
    """The prior that a decoder shall use: given, from a file, or of the rendered scenes."""
    from tmca.priors import load_prior, rendered_prior
    from tmca.priors.spectral_depth import needed_block

    if prior is not None:
        return load_prior(prior) if isinstance(prior, (str, Path)) else prior
    return rendered_prior(camera.wavelengths, 0, block=needed_block(window, camera.bench.window))


def spectral_depth_metrics(
    cube: np.ndarray, depth: np.ndarray, truth: xr.Dataset, camera: SpectralDepthCamera
) -> dict[str, float]:
    """PSNR, SSIM, UIQI, SAM, … of the cube; MAE, RMSE and share within a bin of the depth where it is known."""
    from tmca.metrics import all_metrics, depth_mae, depth_rmse, within_bin

    known = camera.planes.known(torch.from_numpy(np.array(truth["depth"].values)))
    real = np.where(known.numpy(), truth["depth"].values, np.nan)
    found = dict(all_metrics(cube, truth["radiance"].values))
    return found | {
        "depth_mae": depth_mae(depth, real),
        "depth_rmse": depth_rmse(depth, real),
        "within_bin": within_bin(depth, real, camera.planes.metres),
    }


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
    figure = depth_figure(result, snapshot.camera, None if truth is None else truth)
    return [save_figure(figure, spectral_depth_files(path, figures=True)[1], overwrite=overwrite)]


def _labelled(
    found: DepthDecoded, decoder: str, snapshot: Snapshot[SpectralDepthCamera], truth: xr.Dataset | None
) -> SpectralDepthReconstruction:
    import xarray as xr

    waves = ("wavelength", np.array(snapshot.camera.wavelengths), {"units": "m"})
    cube, depth, confidence = found.estimate[0].numpy(), found.depth[0, 0].numpy(), found.confidence[0, 0].numpy()
    named = {"long_name": f"estimated by {decoder}"}
    return SpectralDepthReconstruction(
        cube=xr.DataArray(cube, dims=("wavelength", "y", "x"), coords={"wavelength": waves}, attrs=named),
        depth=xr.DataArray(depth, dims=("y", "x"), attrs={**named, "units": "m"}),
        confidence=xr.DataArray(confidence, dims=("y", "x"), attrs={**named, "units": "1"}),
        decoder=decoder,
        seconds=found.seconds,
        metrics={} if truth is None else spectral_depth_metrics(cube, depth, truth, snapshot.camera),
        notes={**snapshot.notes, **found.notes},
    )
