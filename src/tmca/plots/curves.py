"""Results as curves: trainings, sweeps, designs of codes and of masks."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.data.pixels import decoded
from tmca.plots.style import COLOURS, SMALL, TITLE, add_bar, bare, blank_figure, grid, panels, plain_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def training_figure(rows: Sequence[Mapping[str, str]], loss: str = "mean loss") -> Figure:
    """Validation PSNR (each sensor), loss in words, and light throughput over the steps.

    Args:
        rows: of a training's log.
        loss: what was minimised.
    """
    steps = [int(row["step"]) for row in rows]
    sensors = [name for name in (rows[0] if rows else {}) if name.startswith("psnr_")]
    shown = [
        (["psnr", *sensors], "validation", "PSNR (dB)"),
        (["loss"], "training", loss),
        (["throughput", "transmittance", "duty"], "codes", "share"),
    ]
    if any(row.get("depth_mae") for row in rows):
        shown.insert(1, (["depth_mae"], "validation", "depth, mean absolute error (m)"))
    figure, axes = panels(len(shown), 3.7, 3.2)
    for axis, (names, title, unit) in zip(axes, shown, strict=True):
        for name in names:
            points = [(step, float(row[name])) for step, row in zip(steps, rows, strict=True) if row.get(name)]
            if points:
                axis.plot(*zip(*points, strict=True), "o-", markersize=3, label=_label(name))
        plain_axes(axis, title, "step", unit)
        axis.xaxis.get_major_locator().set_params(integer=True)
        if axis.lines and len(names) > 1:
            axis.legend(fontsize=8)
    return figure


def _label(name: str) -> str:
    if name == "psnr":
        return "mean over sensors"
    return f"sensor {int(name[5:]) + 1}" if name.startswith("psnr_") else name


def sweep_figure(
    rows: Sequence[Mapping[str, Any]],
    axes: Sequence[str],
    decoders: Mapping[str, str],
    unit: str,
    metrics: Sequence[tuple[str, str]] = (("psnr", "PSNR (dB)"),),
) -> Figure:
    """Figures of merit along the first varied setting, a line for each value of the others.

    Args:
        rows: of the sweep's table.
        axes: the varied settings.
        decoders: their names for people.
        unit: of the first setting.
        metrics: (name, heading) of what is drawn, a panel for each.
    """
    figure, places = panels(len(metrics), 6, 4)
    names = {decoders[row["decoder"]] for row in rows}
    title = "mean over test scenes" + (f", {names.pop()}" if len(names) == 1 else "")
    for axis, (metric, label) in zip(places, metrics, strict=True):
        _lines(axis, rows, axes, metric)
        plain_axes(axis, title, unit, label)
    return figure


def _lines(axis: Axes, rows: Sequence[Mapping[str, Any]], axes: Sequence[str], metric: str) -> None:
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault(", ".join(f"{name} = {row[name]}" for name in axes[1:]), []).append(row)
    for label, group in groups.items():
        places = [row[axes[0]] for row in group]
        numeric = all(isinstance(p, int | float) for p in places)
        axis.plot(
            places if numeric else list(map(str, places)), [row[metric] for row in group], "o-", label=label or None
        )
        if numeric and min(places) > 0 and max(places) >= 8 * min(places):
            axis.set_xscale("log")
            axis.set_xticks(places, [f"{place:g}" for place in places])
            axis.minorticks_off()
    if len(groups) > 1:
        axis.legend(fontsize=8)


_LETTERS, _LETTERS_AN_INCH = 12, 11
"""Of a line of a column's name, and of titles."""
_DARK = 0.179
"""Relative luminance below which white has more contrast than black."""
Gain = tuple[int, float, float]
"""Slots K, gain over the static code in dB, and its standard deviation over the scenes."""


def gains_figure(surveyed: Mapping[str, Sequence[Gain]], title: str, chosen: tuple[str, Gain] | None = None) -> Figure:
    """Gain over the static code against the number of slots, a line for each kind; bars are the scenes' spread.

    Args:
        surveyed: kind of codes → gains, by rising K.
        title: what they are judged on.
        chosen: label and gain of the code that was searched longer.
    """
    figure = blank_figure(6, 3.6)
    axis = figure.add_subplot()
    axis.axhline(0, color="#999999", linewidth=0.8)
    for place, (kind, gains) in enumerate(surveyed.items()):
        slots, heights, bars = zip(*gains, strict=True)
        x = [k * 1.03 ** (place - (len(surveyed) - 1) / 2) for k in slots]
        look: dict[str, Any] = {"color": COLOURS[place % len(COLOURS)], "linewidth": 1.2, "markersize": 4}
        axis.errorbar(x, heights, bars, fmt="o-", capsize=3, label=kind, **look)
    if chosen is not None:
        label, (k, height, bar) = chosen
        axis.errorbar(k, height, bar, fmt="k*", capsize=3, markersize=11, label=label)
    ticks = sorted({gain[0] for gains in surveyed.values() for gain in gains}) or [1]
    axis.set_xscale("log", base=2)
    axis.set_xlim(ticks[0] / 1.5, ticks[-1] * 1.5)
    axis.set_xticks(ticks, [str(k) for k in ticks])
    axis.minorticks_off()
    if surveyed:
        figure.legend(fontsize=8, loc="outside lower center", ncols=min(len(surveyed) + 1, 3))
    plain_axes(axis, title, "slots K", "gain over the static code (dB)")
    return figure


def coloured_table(
    rows: Sequence[str],
    columns: Sequence[str],
    values: np.ndarray,
    shades: np.ndarray,
    spec: str,
    title: str,
    unit: str,
) -> Figure:
    """Numbers in fields that are blue where the shade is above 0 and red below it, with a colour bar.

    Args:
        rows, columns: their names.
        values: (R, C) numbers, NaN where none is known.
        shades: (R, C) of the colours.
        spec: format of the numbers.
        title: above them.
        unit: of the colours, beside their bar.
    """
    width, height = 0.6 + 0.085 * max(map(len, rows)) + 0.95 * len(columns) + 0.7, 0.9 + 0.27 * len(rows)
    figure = blank_figure(width, height)
    axis = figure.subplots()
    most = max(float(np.nanmax(np.abs(shades), initial=0.0)), 1e-9)
    look: dict[str, Any] = {"cmap": "RdBu", "vmin": -1.3 * most, "vmax": 1.3 * most}
    shown = axis.imshow(np.ma.masked_invalid(shades), aspect="auto", **look)
    dark = _luminance(shown.to_rgba(np.ma.masked_invalid(shades))) < _DARK
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value):
            colour = "white" if dark[row, column] else "black"
            axis.text(column, row, format(value, spec), ha="center", va="center", fontsize=SMALL, color=colour)
    wrapped = [textwrap.fill(name.replace(" e⁻", "\N{NO-BREAK SPACE}e⁻"), _LETTERS) for name in columns]
    axis.set_yticks(range(len(rows)), rows)
    axis.set_xticks(range(len(columns)), wrapped)
    axis.xaxis.tick_top()
    plain_axes(axis, "", "", "")
    axis.tick_params(length=0)
    add_bar(axis, shown, unit)
    figure.suptitle(textwrap.fill(title, int(_LETTERS_AN_INCH * width)), fontsize=TITLE)
    return figure


def _luminance(colours: np.ndarray) -> np.ndarray:
    """(…) relative luminance of sRGB (…, 4), clear ones on white."""
    curved = 1 - colours[..., 3:] * (1 - colours[..., :3])
    return np.asarray(decoded(curved) @ (0.2126, 0.7152, 0.0722))


def fisher_figure(information: Mapping[str, tuple[np.ndarray, np.ndarray]], metres: np.ndarray) -> Figure:
    """Fisher information of a window about inverse depth, over depth: a colour for each K, random masks dashed.

    Args:
        information: name of the design → (D,) of random and of designed masks, m².
        metres: (D,) depths of the planes.
    """
    figure, inverse = blank_figure(6.4, 3.8), 1 / metres
    axis = figure.add_subplot()
    for colour, (design, both) in zip(cycle(COLOURS), information.items(), strict=False):
        for values, style, name in zip(both, ("--", "-"), ("random", "designed"), strict=True):
            look: dict[str, Any] = {"marker": "o", "markersize": 3, "linewidth": 1.3, "color": colour}
            axis.plot(inverse, values, style, label=f"{design}, {name}", **look)
    axis.set_yscale("log")
    top = axis.secondary_xaxis("top")
    top.set_xticks(inverse.tolist(), [f"{z:.2g}" for z in metres], fontsize=7)
    top.set_xlabel("depth (m)", fontsize=8)
    plain_axes(axis, "", "inverse depth (1/m)", "Fisher information of a window (m²)")
    figure.legend(fontsize=8, loc="outside lower center", ncols=min(3, len(information)))
    return figure


def distances_figure(distances: Mapping[str, tuple[float, Mapping[str, np.ndarray]]], metres: np.ndarray) -> Figure:
    """Distances of all pairs of planes, a row for each kind of distance, a column for each design.

    Args:
        distances: kind of distance → nats from which all are drawn alike, and design → ``(D, D)`` nats.
        metres: (D,) depths of the planes.
    """
    columns = len(next(iter(distances.values()))[1])
    figure, axes = grid(len(distances), columns, width=1.9, aspect=1.0)
    ticks = [0, len(metres) - 1]
    names = [f"{metres[t]:.2g} m" for t in ticks]
    for row, (kind, (top, designs)) in zip(axes, distances.items(), strict=True):
        for axis, (name, values) in zip(row, designs.items(), strict=True):
            shown = axis.imshow(np.sqrt(values.clip(0, top)), vmin=0, vmax=top**0.5)
            bare(axis, name)
            axis.set_xticks(ticks, names, fontsize=7)
        row[0].set_yticks(ticks, names, fontsize=7)
        add_bar(row[-1], shown, f"√ {kind} (nats)")
    return figure
