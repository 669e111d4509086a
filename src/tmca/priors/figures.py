"""Pictures of a prior."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from tmca.priors.gaussian import GaussianPrior

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TITLE, _SMALL = 9, 8


def draw_prior(prior: GaussianPrior, blocks: int = 12) -> Figure:
    """The prior's leading eigen-blocks (mean over channels), its mean spectrum and its eigenvalues."""
    from matplotlib.figure import Figure

    values, vectors = _leading(prior, max(blocks, 60))
    figure = Figure(figsize=(11, 6), layout="constrained")
    bands, height, width = prior.block
    total = float(prior.variance.sum())
    figure.suptitle(f"prior of blocks of {bands} bands × {height} × {width} pixels", fontsize=_TITLE)
    rows = -(-blocks // 3)
    grid = figure.add_gridspec(2 * rows, 5)
    _draw_blocks(figure, [grid[2 * (i // 3) : 2 * (i // 3) + 2, i % 3] for i in range(blocks)], prior, values, vectors)
    upper, lower = figure.add_subplot(grid[:rows, 3:]), figure.add_subplot(grid[rows:, 3:])
    shares = values.clamp(min=1e-12 * total).numpy() / total
    upper.semilogy(np.arange(1, len(shares) + 1), shares, color="#00798c")
    _label(upper, f"largest {len(shares)} eigenvalues", "number", "share of the variance")
    _draw_spectra(lower, prior)
    return figure


def _draw_blocks(figure: Figure, places: list[object], prior: GaussianPrior, values: Tensor, vectors: Tensor) -> None:
    """Eigen-blocks, one standard deviation strong, on one scale."""
    scaled = (vectors * values.clamp(min=0).sqrt()).mT[: len(places)]
    pictures = [vector.reshape(prior.block).mean(0).numpy() for vector in scaled]
    limit = max(float(np.abs(picture).max()) for picture in pictures) or 1.0
    axes = []
    for place, picture in enumerate(pictures):
        axis = figure.add_subplot(places[place])  # type: ignore[call-overload]
        axis.set_title(f"eigen-block {place + 1}", fontsize=_SMALL)
        own = float(np.abs(picture).max()) or 1.0
        shown = axis.imshow(picture, cmap="RdBu", vmin=-own, vmax=own)
        axis.set_axis_off()
        axes.append(axis)
    bar = figure.colorbar(shown, ax=axes, location="bottom", shrink=0.5, aspect=40, ticks=[-own, 0, own])
    bar.ax.set_xticklabels(["-", "0", "+"])
    bar.set_label(f"mean over bands, each on its own scale (the strongest: ±{limit:.2g})", fontsize=_SMALL)


def _leading(prior: GaussianPrior, count: int) -> tuple[Tensor, Tensor]:
    """The largest eigenvalues (count,) and their eigenvectors (n, count); all of them would take minutes."""
    from scipy.sparse.linalg import eigsh

    n = prior.mean.numel()
    if n <= 2 * count:
        values, vectors = np.linalg.eigh(prior.covariance.numpy())
    else:
        values, vectors = eigsh(prior.covariance.numpy(), k=count, v0=np.ones(n))
    order = np.argsort(values)[::-1].copy()
    return torch.from_numpy(values[order]), torch.from_numpy(vectors[:, order])


def _draw_spectra(axis: Axes, prior: GaussianPrior) -> None:
    """Mean spectrum with one standard deviation either side."""
    mean = prior.mean.mean((1, 2)).numpy()
    deviation = prior.variance.reshape(prior.block).mean((1, 2)).sqrt().numpy()
    known = prior.wavelengths is not None
    x = np.array(prior.wavelengths) * 1e9 if known else np.arange(len(mean))
    axis.plot(x, mean, color="#00798c", label="mean")
    axis.fill_between(x, mean - deviation, mean + deviation, color="#00798c", alpha=0.3, label="±1 standard deviation")
    axis.legend(fontsize=_SMALL)
    _label(axis, "spectrum of a pixel", "wavelength (nm)" if known else "channel", "relative irradiance")


def _label(axis: Axes, title: str, x: str, y: str) -> None:
    axis.set_title(title, fontsize=_TITLE)
    axis.set_xlabel(x, fontsize=_SMALL)
    axis.set_ylabel(y, fontsize=_SMALL)
    axis.tick_params(labelsize=_SMALL)
