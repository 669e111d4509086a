"""Pictures of a prior."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch

from tmca.priors.gaussian import GaussianPrior

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_prior(prior: GaussianPrior, blocks: int = 12) -> Figure:
    """The prior's leading eigen-blocks (mean over channels), its mean spectrum and its eigenvalues."""
    from matplotlib.figure import Figure

    values, vectors = torch.linalg.eigh(prior.covariance)
    values, vectors = values.flip(0), vectors.flip(1)
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
    upper.set(xlabel="eigenvalue number", ylabel="variance")
    _draw_spectra(lower, prior)
    return figure


def _draw_spectra(axis: Axes, prior: GaussianPrior) -> None:
    """Mean spectrum with one standard deviation either side."""
    mean = prior.mean.mean((1, 2)).numpy()
    deviation = prior.covariance.diagonal().reshape(prior.block).mean((1, 2)).sqrt().numpy()
    known = prior.wavelengths is not None
    x = np.array(prior.wavelengths) * 1e9 if known else np.arange(len(mean))
    axis.plot(x, mean)
    axis.fill_between(x, mean - deviation, mean + deviation, alpha=0.3)
    axis.set(xlabel="wavelength (nm)" if known else "channel", ylabel="irradiance")
