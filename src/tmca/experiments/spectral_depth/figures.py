"""Pictures of the spectral-depth camera: what its mask does to a point, and what was recovered."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from tmca.cameras import SpectralDepthCamera
from tmca.experiments.composite import rgb_composite, white_level
from tmca.experiments.figures import add_bar, bare, grid, image, mark, plain_axes, spectra, spread_points
from tmca.experiments.spectral_depth.maps import depth_map
from tmca.optics import DepthPlanes

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from tmca.experiments.reconstructions import Reconstruction

_POINTS = 4


def depth_figure(result: Reconstruction, planes: DepthPlanes, truth: xr.Dataset | None = None) -> Figure:
    """Colour composite, depth with a metric bar, confidence or error, and spectra; the truth in a row of its own."""
    cube, waves = result.cube.values, result.cube["wavelength"].values.tolist()
    real = None if truth is None else truth["radiance"].values
    white, points = white_level(cube if real is None else real, waves), spread_points(cube if real is None else real)
    rows = [("truth", real, None if truth is None else truth["depth"].values)] if truth is not None else []
    rows.append((result.decoder, cube, result.depth.values))
    figure, axes = grid(len(rows), 3, width=3.6, aspect=cube.shape[1] / cube.shape[2])
    for row, (name, spectral, depth) in zip(axes, rows, strict=True):
        assert spectral is not None
        row[0].imshow(rgb_composite(spectral, waves, white))
        bare(row[0], name)
        mark(row[0], points)
        depth_map(row[1], np.asarray(depth), title=f"depth, {name}", limits=(planes.near, planes.far))
    image(axes[-1, 2], result.confidence.values, "probability within a bin", top=1.0, bar="probability")
    if real is not None:
        spectra(axes[0, 2], {"truth": real, result.decoder: cube}, waves, points)
    return figure


def psf_figure(camera: SpectralDepthCamera) -> Figure:
    """Point spread functions of every slot over depth, and the equivalent ones of a few pixels (thesis figure 26)."""
    with torch.no_grad():
        psf = camera.psf().sum(2).cpu().numpy()
        planes = range(camera.planes.count)
        places = [(camera.size[0] // 2, camera.size[1] // 2 + step) for step in range(_POINTS)]
        seen = [[camera.equivalent_psf(place, d).sum((0, 1)).cpu().numpy() for d in planes] for place in places]
    rows: list[tuple[str, Any]] = [(f"slot {k}", own) for k, own in enumerate(psf)]
    rows += [(f"pixel {place[0]}, {place[1]}", np.stack(own)) for place, own in zip(places, seen, strict=True)]
    metres = camera.planes.metres.tolist()
    figure, axes = grid(len(rows), len(metres), width=1.3, aspect=0.8 * camera.bench.window[0] / camera.bench.window[1])
    for line, (row, (name, values)) in enumerate(zip(axes, rows, strict=True)):
        for axis, value, z in zip(row, values, metres, strict=True):
            axis.imshow(np.sqrt(value), cmap="inferno", interpolation="nearest")
            bare(axis, "" if line else f"{z:.2f} m")
        row[0].set_ylabel(name, fontsize=8)
    return figure


def phase_codes_figure(camera: SpectralDepthCamera) -> Figure:
    """Height maps and shutter of every slot, filters over the pixels of a tile, and what filters and sensor pass."""
    with torch.no_grad():
        heights, shutter = (part.cpu().numpy() for part in camera.codes())
        cells, filters = camera.filters.cells().cpu().numpy(), camera.filters.filters.cpu().numpy()
    figure, axes = grid(2, camera.slots + 1, width=2.2, aspect=1.0)
    limits, side = (float(heights.min()) * 1e9, float(heights.max()) * 1e9), 3 * cells.shape[0]
    for slot, (height, shown) in enumerate(zip(heights, shutter, strict=True)):
        drawn = axes[0, slot].imshow(height * 1e9, cmap="coolwarm", vmin=limits[0], vmax=limits[1])
        bare(axes[0, slot], f"heights, slot {slot}")
        image(axes[1, slot], shown[:side, :side], f"shutter, slot {slot}", "gray", 1.0)
    add_bar(axes[0, camera.slots - 1], drawn, "nm")
    axes[0, -1].imshow(cells, cmap="tab10", vmin=0, vmax=9)
    bare(axes[0, -1], f"filters of a tile of {cells.shape[0]} pixels")
    nanometres = np.asarray(camera.wavelengths) * 1e9
    for index, values in enumerate(filters):
        axes[1, -1].plot(nanometres, values, color=f"C{index}")
    for values in camera.response.cpu().numpy():
        axes[1, -1].plot(nanometres, values, color="0.4", linestyle=":")
    axes[1, -1].set_ylim(0, 1.05)
    plain_axes(axes[1, -1], "filters; dotted: sensor", "wavelength (nm)", "transmittance")
    return figure
