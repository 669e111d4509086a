"""Pictures of the spectral-depth table: what masks foretell over depth, and depth maps and spectra of its rows."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.cameras import SpectralDepthCamera
from tmca.data.depth_scenes import middle_of
from tmca.experiments.cells import Measured
from tmca.experiments.composite import rgb_composite, white_level
from tmca.experiments.figures import bare, grid, mark, plain_axes, save_figure, spectra, spread_points
from tmca.experiments.spectral_depth.maps import depth_map
from tmca.experiments.spectral_depth.rows import DECODER_NAMES

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
            written.append(save_figure(scene_figure(shown, name, scene, camera), file, overwrite=overwrite, dpi=80))
    return written


def foretold_figure(cells: Sequence[Measured], camera: SpectralDepthCamera) -> Figure:
    """Fisher information about inverse depth, and the distance of every plane from its nearest rival."""
    from matplotlib.figure import Figure

    figure, metres = Figure(figsize=(10, 4.1), layout="constrained"), camera.planes.metres.numpy()
    axes = figure.subplots(1, 2)
    for index, cell in enumerate(cells):
        for style, part in (("-", "optimised"), (":", "random")):
            own, label = cell["foretold"][part], cell["code"] if part == "optimised" else None
            rivals = np.array(own["kullback_leibler"]) + np.diag(np.full(len(metres), np.inf))
            for axis, values in zip(axes, (own["fisher"], rivals.min(1)), strict=True):
                axis.semilogy(metres, values, style, marker="o", markersize=3, color=f"C{index}", label=label)
    plain_axes(axes[0], "Fisher information (dotted: random masks)", "depth (m)", "information (m²)")
    plain_axes(axes[1], "Kullback–Leibler distance from the nearest rival", "depth (m)", "nats")
    figure.legend(*axes[1].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7)
    return figure


def scene_figure(cells: Sequence[Measured], name: str, scene: xr.Dataset, camera: SpectralDepthCamera) -> Figure:
    """The truth, then a row for every code: colours and depth in metres by every decoder, and their spectra."""
    truth, waves = middle_of(scene, camera.size, name), camera.wavelengths
    real = truth["radiance"].values
    codes, decoders = (list(dict.fromkeys(cell[part] for cell in cells)) for part in ("code", "decoder"))
    figure, axes = grid(1 + len(codes), 2 * len(decoders) + 1, width=2.8, aspect=camera.size[0] / camera.size[1])
    for axis in axes.ravel():
        axis.set_axis_off()
    limits, points = (camera.planes.near, camera.planes.far), spread_points(real)
    look: dict[str, Any] = {"waves": waves, "white": white_level(real, waves), "limits": limits}
    _pair(axes[0], 0, (real, truth["depth"].values), "truth", **look)
    mark(axes[0, 0], points)
    for row, code in zip(axes[1:], codes, strict=True):
        own = {cell["decoder"]: _kept(cell, name) for cell in cells if cell["code"] == code}
        for decoder, parts in own.items():
            _pair(row, 2 * decoders.index(decoder), parts, f"{_wrapped(code)}\n{DECODER_NAMES[decoder]}", **look)
        row[-1].set_axis_on()
        none = (np.full_like(real, np.nan), None)
        cubes = {DECODER_NAMES[decoder]: own.get(decoder, none)[0] for decoder in decoders}
        spectra(row[-1], {"truth": real, **cubes}, waves, points)
        row[-1].get_legend().remove()
    axes[0, -1].legend(*axes[-1, -1].get_legend_handles_labels(), loc="center", fontsize=8)
    return figure


def _wrapped(code: str) -> str:
    """A long name over two lines, which fit over a picture."""
    return textwrap.fill(code, 36)


def _kept(cell: Measured, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Cube and depth that a cell kept."""
    from tmca.data import read_dataset

    found = read_dataset(cell["kept"][name], ("radiance", "depth"))
    return found["radiance"].values, found["depth"].values


def _pair(
    row: np.ndarray,
    first: int,
    parts: tuple[np.ndarray, np.ndarray],
    label: str,
    waves: Sequence[float],
    white: float,
    limits: tuple[float, float],
) -> None:
    """Colours and depth side by side."""
    for axis in row[first : first + 2]:
        axis.set_axis_on()
    row[first].imshow(rgb_composite(parts[0], waves, white))
    bare(row[first], label)
    depth_map(row[first + 1], np.asarray(parts[1]), title="depth", limits=limits)
