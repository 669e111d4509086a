"""The thesis' figures 20 to 22 for the scenes of the spectral table: composites, spectra and bands of some rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tmca.data.scenes import load_scene
from tmca.experiments.cells import Measured
from tmca.experiments.composite import rgb_composite, white_level
from tmca.experiments.figures import evenly, grid, image, mark, plain_axes, save_figure, spread_points
from tmca.experiments.spectral.rows import DECODER_NAMES, SHOWN, SHOWN_NOISE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLUMNS, _BANDS, _POINTS, _LINES = 4, 6, 3, 5


def comparison_pictures(measured: Sequence[Measured], out: Path, *, overwrite: bool = False) -> list[Path]:
    """Write ``spectral_SCENE_composites|spectra|bands.png`` for every scene whose estimates were kept.

    Args:
        measured: cells of the table; those with ``kept`` have an estimate on disk.
        out: folder.
        overwrite: replace earlier pictures.
    """
    files = []
    for scene in dict.fromkeys(cell["scene"] for cell in measured if cell.get("kept")):
        cells = [cell for cell in measured if cell.get("kept") and cell["scene"] == scene]
        truth = load_scene(cells[0]["path"], bands=cells[0]["bands"])
        found = {(c["code"], c["decoder"]): np.load(c["kept"]).astype(np.float32) for c in cells}
        names = [row for row in SHOWN if row in found]
        estimates = {f"{code}\n{DECODER_NAMES[decoder]}": found[code, decoder] for code, decoder in names}
        wavelengths = truth["wavelength"].values.tolist()
        for draw, file in zip((composites, signatures, bands), picture_files(scene, out), strict=True):
            figure = draw(truth.values, estimates, wavelengths)
            files.append(save_figure(figure, file, overwrite=overwrite, dpi=80))
    return files


def picture_files(scene: str, out: Path) -> list[Path]:
    """The pictures of a scene: composites, spectra, bands."""
    return [out / f"spectral_{scene}_{kind}.png" for kind in ("composites", "spectra", "bands")]


def composites(truth: np.ndarray, estimates: Mapping[str, np.ndarray], wavelengths: Sequence[float]) -> Figure:
    """Colour composites (650, 550, 480 nm) with their PSNR beside the truth (figure 20)."""
    from tmca.metrics import psnr

    rows = -(-(1 + len(estimates)) // _COLUMNS)
    figure, axes = grid(rows, _COLUMNS, width=3.2, aspect=truth.shape[1] / truth.shape[2] + 0.06)
    white = white_level(truth, wavelengths)
    titles = {f"truth\n{SHOWN_NOISE}": truth, **estimates}
    for axis in axes.flat:
        axis.set_axis_off()
    for axis, (name, cube) in zip(axes.flat, titles.items(), strict=False):
        axis.set_axis_on()
        quality = "" if cube is truth else f": {psnr(cube, truth):.2f} dB"
        image(axis, rgb_composite(cube, wavelengths, white), name + quality)
    return figure


def signatures(truth: np.ndarray, estimates: Mapping[str, np.ndarray], wavelengths: Sequence[float]) -> Figure:
    """Spectra of the truth and of some rows at a few points (figure 21)."""
    points = spread_points(truth, _POINTS)
    figure, axes = grid(1, 1 + _POINTS, width=3.6, aspect=0.85)
    image(axes[0, 0], rgb_composite(truth, wavelengths), "truth")
    mark(axes[0, 0], points)
    nanometres = np.asarray(wavelengths) * 1e9
    for axis, (row, column) in zip(axes[0, 1:], points, strict=True):
        axis.plot(nanometres, truth[:, row, column], "k-", linewidth=2, label="truth")
        for name in _some(list(estimates), _LINES):
            axis.plot(nanometres, estimates[name][:, row, column], linewidth=1, label=name.replace("\n", " + "))
        plain_axes(axis, f"row {row}, column {column}", "wavelength (nm)", "relative irradiance")
    axes[0, -1].legend(fontsize=6)
    return figure


def bands(truth: np.ndarray, estimates: Mapping[str, np.ndarray], wavelengths: Sequence[float]) -> Figure:
    """Six bands of the truth and of some rows (figure 22)."""
    chosen, names = evenly(len(truth), _BANDS), _some(list(estimates), _LINES - 1)
    figure, axes = grid(1 + len(names), len(chosen), width=2.2, aspect=truth.shape[1] / truth.shape[2])
    for row, (name, cube) in zip(axes, {"truth": truth, **{n: estimates[n] for n in names}}.items(), strict=True):
        for axis, band in zip(row, chosen, strict=True):
            top = float(np.quantile(truth[band], 0.995)) or 1.0
            title = f"{wavelengths[band] * 1e9:.0f} nm" if cube is truth else ""
            image(axis, cube[band].clip(0), title, colours="gray", top=top)
        row[0].set_ylabel(name, fontsize=7)
    return figure


def _some(names: list[str], count: int) -> list[str]:
    """The first, the last and names evenly between."""
    return [names[i] for i in evenly(len(names), count)]
