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


def draw_prior(prior: GaussianPrior, blocks: int = 12) -> Figure:
    """The prior's leading eigen-blocks (mean over channels), its mean spectrum and its eigenvalues."""
    from matplotlib.figure import Figure

    values, vectors = _leading(prior, max(blocks, 60))
    figure = Figure(figsize=(11, 6), layout="constrained")
    rows = -(-blocks // 3)
    grid = figure.add_gridspec(2 * rows, 5)
    for place, vector in enumerate(vectors.mT[:blocks]):
        row, column = divmod(place, 3)
        axis = figure.add_subplot(grid[2 * row : 2 * row + 2, column])
        axis.set_title(f"eigen-block {place + 1}", fontsize="small")
        picture = vector.reshape(prior.block).mean(0).numpy()
        limit = float(np.abs(picture).max()) or 1.0
        axis.imshow(picture, cmap="RdBu", vmin=-limit, vmax=limit)
        axis.set_axis_off()
    upper, lower = figure.add_subplot(grid[:rows, 3:]), figure.add_subplot(grid[rows:, 3:])
    upper.semilogy(values.clamp(min=1e-12).numpy())
    upper.set(xlabel="number of the eigenvalue", ylabel="variance")
    _draw_spectra(lower, prior)
    return figure


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
    deviation = prior.covariance.diagonal().reshape(prior.block).mean((1, 2)).sqrt().numpy()
    known = prior.wavelengths is not None
    x = np.array(prior.wavelengths) * 1e9 if known else np.arange(len(mean))
    axis.plot(x, mean)
    axis.fill_between(x, mean - deviation, mean + deviation, alpha=0.3)
    axis.set(xlabel="wavelength (nm)" if known else "channel", ylabel="irradiance")
