"""An estimate of spectrum and depth beside the truth, which is read as the snapshot's scene was."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.applications.spectral_depth import spectral_depth_metrics
from tmca.data.depth_scenes import load_spectral_depth
from tmca.data.scene_names import READING, compare_source
from tmca.decoders.estimate import PLANES
from tmca.errors import DataError, SettingError
from tmca.experiments.reconstructions import Reconstruction
from tmca.experiments.spectral_depth.imaging import (
    reading_range,
    reconstruction_picture,
)
from tmca.optics import DepthPlanes
from tmca.plots.style import save_figure

if TYPE_CHECKING:
    import xarray as xr

    from tmca.cameras import Snapshot, SpectralDepthCamera

_PARTS = ("radiance", "depth", "confidence")


def evaluate_spectral_depth(
    estimate: str | Path, truth: str, *, figure: Path | None = None, overwrite: bool = False
) -> dict[str, float]:
    """Metrics of a file of `tmca reconstruct` against a scene with depth.

    Args:
        estimate: ``radiance``, ``depth`` and ``confidence``; its attributes say how the snapshot's scene was read.
        truth: the scene: a file, a folder, or a rendered one.
        figure: write a picture of both (PNG).
        overwrite: replace the picture if it exists.

    Raises:
        DataError: an estimate without its depth planes, or a truth that cannot be read like its scene.
        SettingError: a picture in the place of the estimate.
    """
    if figure is not None and Path(estimate).resolve() == figure.resolve():
        raise SettingError("--figure", str(figure), "another file than the estimate")
    own, planes = stored_reconstruction(estimate)
    size = (own.cube.sizes["y"], own.cube.sizes["x"])
    how = _reading(own.notes, estimate)
    compare_source(how.pop("source", truth), truth)
    wavelengths = own.cube["wavelength"].values.tolist()
    scene = load_spectral_depth(truth, wavelengths, near=planes.near, far=planes.far, size=size, **how)
    found = spectral_depth_metrics(own.cube.values, own.depth.values, scene, planes)
    if figure is not None:
        save_figure(reconstruction_picture(own, planes, scene), figure, overwrite=overwrite)
    return found


def stored_reconstruction(path: str | Path) -> tuple[Reconstruction, DepthPlanes]:
    """A reconstruction as it is stored, and the depth planes of its camera.

    Raises:
        DataError: a part is missing.
    """
    from tmca.data import read_dataset

    stored: xr.Dataset = read_dataset(path, _PARTS)
    try:
        planes = DepthPlanes(**json.loads(stored.attrs[PLANES]))
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(path, f"no {PLANES} ({error})", "a file of `tmca reconstruct`", "reconstruct anew") from error
    decoder, seconds = str(stored.attrs.get("decoder", "estimate")), float(stored.attrs.get("seconds", 0.0))
    return Reconstruction(stored, decoder, seconds, notes=dict(stored.attrs)), planes


def _reading(notes: dict[str, Any], where: str | Path) -> dict[str, Any]:
    try:
        return dict(json.loads(str(notes.get(READING, "{}"))))
    except (TypeError, ValueError) as error:
        found = repr(notes[READING])
        raise DataError(where, f"attribute {READING} {found}", "JSON as `tmca simulate` writes it") from error


def true_spectral_depth(truth: str, taken: Snapshot[SpectralDepthCamera]) -> xr.Dataset:
    """The true scene of a snapshot, read as it was for the snapshot."""
    camera, how = taken.camera, json.loads(str(taken.notes.get(READING, "{}")))
    compare_source(how.pop("source", truth), truth)
    return load_spectral_depth(truth, **reading_range(camera), size=camera.size, **how)
