"""What priors hold: eigen-blocks and spectra of a Gaussian, atoms of a dictionary."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.plots.style import BLUE, SMALL, TITLE, blank_figure, curve_with_band, mosaic, plain_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BLOCKS, _EIGENVALUES = 12, 60
_ATOMS, _COLUMNS = 48, 8
"""Atoms that are shown at most, and of them side by side."""


def gaussian_figure(mean: np.ndarray, covariance: np.ndarray, wavelengths: Sequence[float] | None = None) -> Figure:
    """Leading eigen-blocks (mean over channels), mean spectrum and eigenvalues of a Gaussian prior.

    Args:
        mean: ``(L, h, w)`` of a block, relative irradiance.
        covariance: ``(n, n)``, n = L·h·w.
        wavelengths: (L,) metres, where the channels are bands.
    """
    bands, height, width = mean.shape
    values, vectors = _leading(covariance, _EIGENVALUES)
    figure, rows = blank_figure(11, 6), -(-_BLOCKS // 3)
    figure.suptitle(f"prior of blocks of {bands} bands × {height} × {width} pixels", fontsize=TITLE)
    places = figure.add_gridspec(2 * rows, 5)
    scaled = (vectors * np.sqrt(values.clip(min=0))).T[:_BLOCKS]
    pictures = [vector.reshape(mean.shape).mean(0) for vector in scaled]
    _draw_blocks(figure, [places[2 * (i // 3) : 2 * (i // 3) + 2, i % 3] for i in range(_BLOCKS)], pictures)
    upper, lower = figure.add_subplot(places[:rows, 3:]), figure.add_subplot(places[rows:, 3:])
    total = float(np.diag(covariance).sum())
    shares = values.clip(min=1e-12 * total) / total
    upper.semilogy(np.arange(1, len(shares) + 1), shares, color=BLUE)
    plain_axes(upper, f"largest {len(shares)} eigenvalues", "number", "share of the variance")
    _draw_spectra(lower, mean, np.diag(covariance).reshape(mean.shape), wavelengths)
    return figure


def _draw_blocks(figure: Figure, places: Sequence[Any], pictures: Sequence[np.ndarray]) -> None:
    """Eigen-blocks, one standard deviation strong, each on its own scale."""
    limit = max(float(np.abs(picture).max()) for picture in pictures) or 1.0
    axes = []
    for place, picture in enumerate(pictures):
        axis = figure.add_subplot(places[place])
        axis.set_title(f"eigen-block {place + 1}", fontsize=SMALL)
        top = float(np.abs(picture).max()) or 1.0
        shown = axis.imshow(picture, cmap="RdBu", vmin=-top, vmax=top)
        axis.set_axis_off()
        axes.append(axis)
    bar = figure.colorbar(shown, ax=axes, location="bottom", shrink=0.5, aspect=40, ticks=[-top, 0, top])
    bar.ax.set_xticklabels(["-", "0", "+"])
    bar.set_label(f"mean over bands, each on its own scale (the strongest: ±{limit:.2g})", fontsize=SMALL)


def _leading(covariance: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The largest eigenvalues (count,) and their eigenvectors (n, count); all of them would take minutes."""
    from scipy.sparse.linalg import eigsh

    n = len(covariance)
    values, vectors = np.linalg.eigh(covariance) if n <= 2 * count else eigsh(covariance, k=count, v0=np.ones(n))
    order = np.argsort(values)[::-1]
    return values[order], vectors[:, order]


def _draw_spectra(axis: Axes, mean: np.ndarray, variance: np.ndarray, wavelengths: Sequence[float] | None) -> None:
    """Mean spectrum with one standard deviation either side."""
    spectrum, deviation = mean.mean((1, 2)), np.sqrt(variance.mean((1, 2)))
    x = np.arange(len(mean)) if wavelengths is None else np.array(wavelengths) * 1e9
    curve_with_band(axis, x, spectrum, deviation, BLUE, "mean", "±1 standard deviation")
    axis.legend(fontsize=SMALL)
    name = "channel" if wavelengths is None else "wavelength (nm)"
    plain_axes(axis, "spectrum of a pixel", name, "relative irradiance")


def dictionary_figure(atoms: np.ndarray, scales: np.ndarray, views: tuple[int, int]) -> Figure:
    """The most used atoms, the views of each side by side and on its own scale, and how the use falls off.

    Args:
        atoms: ``(N, V·U, h, w)``.
        scales: (N,) mean absolute coefficient of every atom.
        views: (V, U).
    """
    shown = min(_ATOMS, len(atoms))
    rows = -(-shown // _COLUMNS)
    figure = blank_figure(1.35 * _COLUMNS, 1.4 * rows + 2.4)
    (v, u), (h, w) = views, atoms.shape[-2:]
    figure.suptitle(
        f"{len(atoms)} atoms of {v}×{u} views of {h}×{w} pixels; the {shown} most used, "
        "each on its own scale (blue above 0, red below)",
        fontsize=TITLE,
    )
    places = figure.add_gridspec(rows + 1, _COLUMNS, height_ratios=[1] * rows + [1.4])
    for place, number in enumerate(np.argsort(-scales, kind="stable")[:shown]):
        axis = figure.add_subplot(places[divmod(place, _COLUMNS)])
        _draw_atom(axis, mosaic(atoms[number].reshape(*views, h, w), gap=1), float(scales[number]))
    _draw_use(figure.add_subplot(places[rows, :]), scales)
    return figure


def _draw_atom(axis: Axes, picture: np.ndarray, scale: float) -> None:
    limit = float(np.nanmax(np.abs(picture))) or 1.0
    axis.imshow(picture, cmap="RdBu", vmin=-limit, vmax=limit, interpolation="nearest")
    axis.set_title(f"{scale:.2g}", fontsize=SMALL, pad=2)
    axis.set_axis_off()


def _draw_use(axis: Axes, scales: np.ndarray) -> None:
    """Mean absolute coefficient of every atom, by rank."""
    falling = np.sort(scales)[::-1]
    axis.semilogy(np.arange(1, len(falling) + 1), np.maximum(falling, 1e-6), color=BLUE)
    title = "use of the atoms (the number over each picture)"
    plain_axes(axis, title, "atom, by falling use", "mean absolute coefficient\n(relative irradiance)")
