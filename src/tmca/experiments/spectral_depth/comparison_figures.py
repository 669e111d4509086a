"""Pictures of the spectral-depth table: what masks foretell over depth, and depth maps and spectra of its rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tmca.cameras import SpectralDepthCamera
from tmca.data.fitting import middle_of
from tmca.experiments.cells import Measured
from tmca.experiments.spectral_depth.rows import DECODER_NAMES
from tmca.plots.depth import Pair, predicted_depth_figure, rows_figure
from tmca.plots.style import save_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


def picture_files(scenes: Sequence[str], out: Path) -> list[Path]:
    """What the pictures will be called."""
    return [out / "spectral-depth_fisher.png", *(out / f"spectral-depth_{name}.png" for name in scenes)]


def comparison_pictures(
    cells: Sequence[Measured],
    scenes: Mapping[str, xr.Dataset],
    camera: SpectralDepthCamera,
    out: Path,
    *,
    overwrite: bool = False,
) -> list[Path]:
    """Write the pictures of one seed's cells."""
    files = picture_files(list(scenes), out)
    searched = [cell for cell in cells if "foretold" in cell]
    written = []
    if searched:
        predicted = {cell["code"]: cell["foretold"] for cell in searched}
        drawn = predicted_depth_figure(predicted, camera.planes.metres.numpy())
        written.append(save_figure(drawn, files[0], overwrite=overwrite))
    for (name, scene), file in zip(scenes.items(), files[1:], strict=True):
        shown = [cell for cell in cells if name in cell.get("kept", {})]
        if shown:
            written.append(save_figure(_scene_figure(shown, name, scene, camera), file, overwrite=overwrite, dpi=80))
    return written


def _kept(cell: Measured, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Cube and depth that a cell kept."""
    from tmca.data import read_dataset

    found = read_dataset(cell["kept"][name], ("radiance", "depth"))
    return found["radiance"].values, found["depth"].values


def _scene_figure(cells: Sequence[Measured], name: str, scene: xr.Dataset, camera: SpectralDepthCamera) -> Figure:
    truth, limits = middle_of(scene, camera.size, name), (camera.planes.near, camera.planes.far)
    rows: dict[str, dict[str, Pair]] = {}
    for cell in cells:
        rows.setdefault(cell["code"], {})[DECODER_NAMES[cell["decoder"]]] = _kept(cell, name)
    decoders = list(dict.fromkeys(DECODER_NAMES[cell["decoder"]] for cell in cells))
    real = truth["radiance"].values, truth["depth"].values
    return rows_figure(rows, decoders, real, camera.wavelengths, limits)
