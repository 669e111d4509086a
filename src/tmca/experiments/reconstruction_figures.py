"""Pictures of reconstructions beside the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from tmca.experiments.composite import rgb_composite, white_level
from tmca.experiments.figures import grid, image, mark, spectra, spread_points

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_UNIT = "relative irradiance"
_TOGETHER = 2
"""Estimates whose spectra still read well in one panel."""


def reconstruction_figure(
    estimates: Mapping[str, np.ndarray],
    wavelengths: Sequence[float],
    truth: np.ndarray | None = None,
    deviations: Mapping[str, np.ndarray] | None = None,
) -> Figure:
    """Colour composites, error and uncertainty maps of one or more reconstructions, and spectral signatures at points:
    one panel for all of them, or one for each where they are more than two.

    Args:
        estimates: name → (L, H, W).
        wavelengths: (L,) metres.
        truth: (L, H, W), if it is known.
        deviations: name → (L, H, W) predicted standard deviation.
    """
    deviations = deviations or {}
    reference = truth if truth is not None else next(iter(estimates.values()))
    white, points = white_level(reference, wavelengths), spread_points(reference)
    many = len(estimates) > _TOGETHER
    rows = 1 + (truth is not None) + bool(deviations) + many
    columns = len(estimates) + 1 + (rows == 1)
    figure, axes = grid(rows, columns, width=3.6, aspect=reference.shape[1] / reference.shape[2])
    image(axes[0, 0], rgb_composite(reference, wavelengths, white), "truth" if truth is not None else "points")
    mark(axes[0, 0], points)
    errors = {} if truth is None else {name: _rms(cube - truth) for name, cube in estimates.items()}
    spreads = {name: _rms(deviations[name]) for name in estimates if name in deviations}
    maps = [values.ravel() for values in (*errors.values(), *spreads.values())]
    top = float(np.quantile(np.concatenate(maps or [np.ones(1)]), 0.99))
    for column, (name, cube) in enumerate(estimates.items(), start=1):
        image(axes[0, column], rgb_composite(cube, wavelengths, white), _caption(name, cube, truth))
        if name in errors:
            image(axes[1, column], errors[name], "error (rms over bands)", colours="magma", top=top, bar=_UNIT)
        if name in spreads:
            place = axes[rows - 1 - many, column]
            image(place, spreads[name], "predicted error (1 σ)", colours="magma", top=top, bar=_UNIT)
        elif spreads:
            _say(axes[rows - 1 - many, column], "no error predicted")
    known = {"truth": truth} if truth is not None else {}
    if many:
        for axis in axes[1:, 0]:
            axis.set_axis_off()
        for axis, (name, cube) in zip(axes[-1, 1:], estimates.items(), strict=False):
            spectra(axis, {**known, name: cube}, wavelengths, points)
    else:
        spectra(_tall(figure, axes[1:, 0]) if rows > 1 else axes[0, -1], {**known, **estimates}, wavelengths, points)
    return figure


def _say(axis: Axes, text: str) -> None:
    axis.set_axis_off()
    axis.text(0.5, 0.5, text, ha="center", va="center", transform=axis.transAxes, color="#777777")


def _tall(figure: Figure, axes: np.ndarray) -> Axes:
    """One axis in the place of several that stand above each other."""
    place = axes[0].get_gridspec()[1 : 1 + len(axes), 0]
    for axis in axes:
        axis.remove()
    return figure.add_subplot(place)


def _caption(name: str, cube: np.ndarray, truth: np.ndarray | None) -> str:
    if truth is None:
        return name
    from tmca.metrics import psnr

    return f"{name}\n{psnr(cube, truth):.2f} dB"


def _rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt((values**2).mean(0))
