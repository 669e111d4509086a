"""Studies of draws as tables, pictures and files."""

from __future__ import annotations

import csv
import io
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from studies.dbd.draws import DEFAULTS, Row, Study, Value, beyond
from studies.tables import Column, table, write_results
from tmca.data import check_target, write_text
from tmca.plots import RED, blank_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SUFFIXES = (".md", ".json", ".csv", ".png")
_COLUMNS = (
    Column("success", "success", ".0%"),
    Column("right_number", "right numbers", ".0%"),
    Column("exact", "exact fit", ".0%"),
    Column("certified", "certified", ".0%"),
    Column("silent", "nothing found", ".0%"),
    Column("optimum", "truth is the optimum", ".0%"),
    Column("near", "within 1e-3", ".0%"),
    Column("rmse_over_bound", "RMSE / bound", ".3g"),
    Column("rmse_of_successes", "RMSE / bound of successes", ".3g"),
    Column("median_s", "median, s", ".3g"),
    Column("p90_s", "90 %, s", ".3g"),
    Column("max_s", "most, s", ".3g"),
)
_NAMES = {
    "M": "frequencies M", "P": "pulses P", "J": "coefficients of a signal J", "L": "targets L", "Q": "paths Q",
    "separation": "least separation in one coordinate", "snr_db": "signal-to-noise ratio, dB",
    "symbol_ratio": "duration of a message, pulse intervals", "lag": "lag, normalised delay",
    "late_samples": "lag beyond the prefix, samples", "weakest": "weakest path over the strongest",
}  # fmt: skip


def study_table(study: Study, rows: Sequence[Row]) -> str:
    """A Markdown table, a row for every combination."""
    flat = [row.plain() for row in rows]
    measured = [column for column in _COLUMNS if any(column.key in row for row in flat)]
    return table(flat, [*map(Column, study.axes), Column("draws"), *measured], missing="–")


def study_figure(study: Study, rows: Sequence[Row]) -> Figure:
    """Success over the first two varied settings: a map, or lines; where convex methods cannot succeed is drawn in."""
    figure = blank_figure(6.4, 4.4)
    axis = figure.subplots()
    numeric = [all(isinstance(value, int | float) for value in values) for values in study.axes.values()]
    if len(numeric) >= 2 and all(numeric[:2]) and min(map(len, list(study.axes.values())[:2])) > 2:
        _map(axis, study, rows)
    else:
        _lines(axis, study, rows)
    return figure


def _map(axis: Axes, study: Study, rows: Sequence[Row]) -> None:
    (x, xs), (y, ys) = list(study.axes.items())[:2]
    rates = np.array([[_rate(rows, {x: a, y: b}) for a in xs] for b in ys])
    shown = axis.imshow(rates, origin="lower", cmap="gray", vmin=0, vmax=1, aspect="auto", interpolation="nearest")
    axis.set_xticks(range(len(xs)), [str(one) for one in xs])
    axis.set_yticks(range(len(ys)), [str(one) for one in ys])
    axis.set_xlabel(_NAMES.get(x, x))
    axis.set_ylabel(_NAMES.get(y, y))
    outside = np.array([[beyond({**study.fixed, x: a, y: b}) for a in xs] for b in ys])
    _frontier(axis, outside)
    _title(axis, bool(outside.any()), "beyond the red line")
    assert axis.figure is not None
    axis.figure.colorbar(shown, ax=axis).set_label("share of successes")


def _frontier(axis: Axes, outside: NDArray[np.bool_]) -> None:
    """A red line between cells within and beyond the degrees of freedom."""
    for i, j in np.ndindex(outside.shape):
        if j and outside[i, j] != outside[i, j - 1]:
            axis.plot([j - 0.5, j - 0.5], [i - 0.5, i + 0.5], color=RED, linewidth=2.5)
        if i and outside[i, j] != outside[i - 1, j]:
            axis.plot([j - 0.5, j + 0.5], [i - 0.5, i - 0.5], color=RED, linewidth=2.5)


def _title(axis: Axes, any_beyond: bool, what: str) -> None:
    if any_beyond:
        axis.set_title(f"{what}: more lifted unknowns than samples", fontsize=10)


def _lines(axis: Axes, study: Study, rows: Sequence[Row]) -> None:
    x, *others = study.axes
    any_beyond = False
    for values in sorted({tuple(row.settings[name] for name in others) for row in rows}, key=str):
        line = dict(zip(others, values, strict=True))
        rates = [_rate(rows, {x: value, **line}) for value in study.axes[x]]
        label = ", ".join(f"{name} = {value}" for name, value in line.items())
        axis.plot([str(value) for value in study.axes[x]], rates, "o-", label=label or None)
        for value, rate in zip(study.axes[x], rates, strict=True):
            if beyond({**study.fixed, x: value, **line}):
                any_beyond = True
                axis.plot(str(value), rate, "s", color=RED, markersize=12, markerfacecolor="none")
    axis.set_xlabel(_NAMES.get(x, x))
    axis.set_ylabel("share of successes")
    axis.set_ylim(-0.05, 1.05)
    _title(axis, any_beyond, "red squares")
    if others:
        axis.legend(fontsize=8)


def _rate(rows: Sequence[Row], where: Mapping[str, Value]) -> float:
    rates = [row.success for row in rows if all(row.settings[name] == value for name, value in where.items())]
    return float(np.mean(rates)) if rates else np.nan


def check_results(out: Path, overwrite: bool) -> None:
    """Says before the work that results could not be written.

    Raises:
        OutputError: a file exists, or its folder is missing.
    """
    for suffix in _SUFFIXES:
        check_target(out.with_name(out.name + suffix), overwrite)


def save_results(
    study: Study, rows: Sequence[Row], out: Path, command: Sequence[str], *, overwrite: bool = False
) -> None:
    """Writes the rows as Markdown, JSON, CSV and a picture."""
    json, table_file, picture = (out.with_name(out.name + suffix) for suffix in (".json", ".csv", ".png"))
    fixed, flat = {**DEFAULTS, **study.fixed}, [row.plain() for row in rows]
    settled = ", ".join(f"{name} = {value}" for name, value in fixed.items() if name not in study.axes)
    head = f"# Phase transition\n\nCommand: `{shlex.join(command)}`\n\n{study.draws} draws a row; {settled}.\n\n"
    text = head + study_table(study, rows) + f"\n![share of successes]({picture.name})\n"
    described = {"command": shlex.join(command), "fixed": fixed, "draws": study.draws, "rows": flat}
    write_results(described, text, json, overwrite)
    lines = io.StringIO()
    writer = csv.DictWriter(lines, sorted({name for row in flat for name in row} - {"values"}), extrasaction="ignore")
    writer.writeheader()
    writer.writerows(flat)
    write_text(lines.getvalue(), table_file, overwrite=overwrite)
    save_figure(study_figure(study, rows), picture, overwrite=overwrite)
