"""Pictures of designed phase masks: how well each depth is told from the others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.design import MaskCandidate
from tmca.design.spectral_depth import bhattacharyya, kullback_leibler
from tmca.experiments.figures import add_bar, bare, grid, plain_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = ("#00798c", "#d1495b", "#edae49", "#66a182", "#8d6a9f")
_SURE = 20.0
"""Nats from which distances are drawn alike: a chance of confusion below 1e-9."""


def fisher_figure(candidates: Sequence[MaskCandidate]) -> Figure:
    """Fisher information of a window about inverse depth, over depth: a colour for each K, random masks dashed."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 3.8), layout="constrained")
    axis = figure.add_subplot()
    for colour, own in zip(_COLOURS, candidates, strict=False):
        inverse = own.camera.planes.inverse.numpy()
        for values, style, name in ((own.random_information, "--", "random"), (own.information, "-", "designed")):
            label = f"K = {own.slots}, {name}" if own.slots > 1 else f"static, {name}"
            look: Any = {"marker": "o", "markersize": 3, "linewidth": 1.3, "color": colour}
            axis.plot(inverse, values.numpy(), style, label=label, **look)
    axis.set_yscale("log")
    planes = candidates[0].camera.planes
    metres = axis.secondary_xaxis("top")
    metres.set_xticks(planes.inverse.tolist(), [f"{z:.2g}" for z in planes.metres.tolist()], fontsize=7)
    metres.set_xlabel("depth (m)", fontsize=8)
    plain_axes(axis, "", "inverse depth (1/m)", "Fisher information of a window (m²)")
    figure.legend(fontsize=8, loc="outside lower center", ncols=len(candidates))
    return figure


def distances_figure(candidates: Sequence[MaskCandidate]) -> Figure:
    """Kullback–Leibler and Bhattacharyya distances of all pairs of planes: random and designed masks of every K."""
    columns = [
        (f"{'static' if own.slots == 1 else f'K = {own.slots}'}, {name}", covariance)
        for own in candidates
        for name, covariance in (("random", own.random_covariance), ("designed", own.covariance))
    ]
    figure, axes = grid(2, len(columns), width=1.9, aspect=1.0)
    planes = candidates[0].camera.planes
    ticks = [0, planes.count - 1]
    named = (("Kullback–Leibler", kullback_leibler, 10 * _SURE), ("Bhattacharyya", bhattacharyya, _SURE))
    for row, (kind, distance, top) in zip(axes, named, strict=True):
        for axis, (name, covariance) in zip(row, columns, strict=True):
            shown = axis.imshow(np.sqrt(distance(covariance).clamp(0, top).numpy()), vmin=0, vmax=top**0.5)
            bare(axis, name)
            axis.set_xticks(ticks, [f"{planes.metres[t]:.2g} m" for t in ticks], fontsize=7)
        row[0].set_yticks(ticks, [f"{planes.metres[t]:.2g} m" for t in ticks], fontsize=7)
        add_bar(row[-1], shown, f"√ {kind} (nats)")
    return figure
