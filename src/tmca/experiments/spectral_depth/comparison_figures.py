"""Pictures of the spectral-depth table: what masks foretell over depth, and depth maps and spectra of its rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tmca.cameras import SpectralDepthCamera
from tmca.experiments.cells import Measured
from tmca.experiments.composite import rgb_composite, white_level
from tmca.experiments.figures import bare, grid, mark, plain_axes, save_figure, spectra, spread_points
from tmca.experiments.spectral_depth.maps import depth_map
from tmca.experiments.spectral_depth.rows import DECODER_NAMES
from tmca.experiments.spectral_depth.scenes import middle_of

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
    written = [save_figure(foretold_figure(searched, camera), files[0], overwrite=overwrite)] if searched else []
    for (name, scene), file in zip(scenes.items(), files[1:], strict=True):
        shown = [cell for cell in cells if name in cell.get("kept", {})]
        if shown:
            written.append(save_figure(scene_figure(shown, name, scene, camera), file, overwrite=overwrite))
    return written


def foretold_figure(cells: Sequence[Measured], camera: SpectralDepthCamera) -> Figure:
    """Fisher information about inverse depth, and the distance of every plane from its nearest rival."""
    from matplotlib.figure import Figure

    figure, metres = Figure(figsize=(10, 3.6), layout="constrained"), camera.planes.metres.numpy()
    axes = figure.subplots(1, 2)
    for index, cell in enumerate(cells):
        for style, part in (("-", "optimised"), (":", "random")):
            own, label = cell["foretold"][part], cell["code"] if part == "optimised" else None
            rivals = np.array(own["kullback_leibler"]) + np.diag(np.full(len(metres), np.inf))
            for axis, values in zip(axes, (own["fisher"], rivals.min(1)), strict=True):
                axis.semilogy(metres, values, style, marker="o", markersize=3, color=f"C{index}", label=label)
    plain_axes(axes[0], "Fisher information (dotted: random masks)", "depth (m)", "information (m²)")
    plain_axes(axes[1], "Kullback–Leibler distance from the nearest rival", "depth (m)", "nats")
    axes[1].legend(fontsize=7)
    return figure


def scene_figure(cells: Sequence[Measured], name: str, scene: xr.Dataset, camera: SpectralDepthCamera) -> Figure:
    """Colours, depth map in metres and spectra of every row, the truth first."""
    from tmca.data import read_dataset

    truth, waves = middle_of(scene, camera.size, name), camera.wavelengths
    parts = {"truth": (truth["radiance"].values, truth["depth"].values)}
    for cell in cells:
        found = read_dataset(cell["kept"][name], ("radiance", "depth"))
        parts[f"{cell['code']}\n{DECODER_NAMES[cell['decoder']]}"] = (found["radiance"].values, found["depth"].values)
    real = parts["truth"][0]
    white, points = white_level(real, waves), spread_points(real)
    figure, axes = grid(len(parts), 3, width=3.2, aspect=camera.size[0] / camera.size[1])
    for row, (label, (cube, depth)) in zip(np.atleast_2d(axes), parts.items(), strict=True):
        row[0].imshow(rgb_composite(cube, waves, white))
        bare(row[0], label)
        mark(row[0], points)
        depth_map(row[1], np.asarray(depth), title="depth", limits=(camera.planes.near, camera.planes.far))
        spectra(row[2], {"truth": real} if label == "truth" else {"truth": real, "estimate": cube}, waves, points)
    return figure
