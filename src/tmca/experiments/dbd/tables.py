"""The study as a table and as pictures."""

from __future__ import annotations

import csv
import io
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.data import check_target, write_json, write_text
from tmca.dbd.model import Mask
from tmca.experiments.cells import Measured
from tmca.experiments.dbd.study import DEFAULTS, Study, beyond
from tmca.plots.style import blank_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tmca.dbd import Recovery

_SUFFIXES = (".md", ".json", ".csv", ".png")
_HEADINGS = {
    "success": "success",
    "right_number": "right numbers",
    "exact": "exact fit",
    "certified": "certified",
    "silent": "nothing found",
    "optimum": "truth is the optimum",
    "near": "within 1e-3",
    "rmse_over_bound": "RMSE / bound",
    "rmse_of_successes": "RMSE / bound of successes",
    "median_s": "median, s",
    "p90_s": "90 %, s",
    "max_s": "most, s",
}
_RED = "#d1495b"
_NAMES = {
    "M": "frequencies M", "P": "pulses P", "J": "coefficients of a signal J", "L": "targets L", "Q": "paths Q",
    "separation": "least separation in one coordinate", "snr_db": "signal-to-noise ratio, dB",
    "symbol_ratio": "duration of a message, pulse intervals", "lag": "lag, normalised delay",
    "late_samples": "lag beyond the prefix, samples", "weakest": "weakest path over the strongest",
}  # fmt: skip
_SHARES = ("success", "right_number", "exact", "certified", "silent", "optimum", "near")


def study_table(study: Study, rows: Sequence[Measured]) -> str:
    """A Markdown table, a row for every combination."""
    kinds = [kind for kind in _HEADINGS if any(kind in row for row in rows)]
    headings = [*study.axes, "draws", *(_HEADINGS[kind] for kind in kinds)]
    lines = ["| " + " | ".join(headings) + " |", "|" + " --- |" * len(headings)]
    for row in rows:
        values = [str(row[name]) for name in study.axes] + [str(row["draws"])]
        lines.append("| " + " | ".join(values + [_text(kind, row.get(kind)) for kind in kinds]) + " |")
    return "\n".join(lines) + "\n"


def _text(kind: str, value: float | None) -> str:
    if value is None:
        return "–"
    return f"{value:.0%}" if kind in _SHARES else f"{value:.3g}"


def study_figure(study: Study, rows: Sequence[Measured]) -> Figure:
    """Success over the first two varied settings: a map, or lines; where convex methods cannot succeed is drawn in."""
    figure = blank_figure(6.4, 4.4)
    axis = figure.subplots()
    names = list(study.axes)
    numeric = [all(isinstance(value, int | float) for value in study.axes[name]) for name in names]
    if len(names) >= 2 and all(numeric[:2]) and min(len(study.axes[name]) for name in names[:2]) > 2:
        _map(axis, study, rows, names)
    else:
        _lines(axis, study, rows, names)
    return figure


def _map(axis: Axes, study: Study, rows: Sequence[Measured], names: list[str]) -> None:
    x, y = names[:2]
    xs, ys = list(study.axes[x]), list(study.axes[y])
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


def _frontier(axis: Axes, outside: Mask) -> None:
    """A red line between cells within and beyond the degrees of freedom."""
    for i, j in np.ndindex(outside.shape):
        if j and outside[i, j] != outside[i, j - 1]:
            axis.plot([j - 0.5, j - 0.5], [i - 0.5, i + 0.5], color=_RED, linewidth=2.5)
        if i and outside[i, j] != outside[i - 1, j]:
            axis.plot([j - 0.5, j + 0.5], [i - 0.5, i - 0.5], color=_RED, linewidth=2.5)


def _title(axis: Axes, any_beyond: bool, what: str) -> None:
    if any_beyond:
        axis.set_title(f"{what}: more lifted unknowns than samples", fontsize=10)


def _lines(axis: Axes, study: Study, rows: Sequence[Measured], names: list[str]) -> None:
    x, others = names[0], names[1:]
    combinations = {tuple(row[name] for name in others) for row in rows}
    any_beyond = False
    for values in sorted(combinations, key=str):
        kept = dict(zip(others, values, strict=True))
        rates = [_rate(rows, {x: value, **kept}) for value in study.axes[x]]
        label = ", ".join(f"{name} = {value}" for name, value in kept.items())
        axis.plot([str(value) for value in study.axes[x]], rates, "o-", label=label or None)
        for value, rate in zip(study.axes[x], rates, strict=True):
            if beyond({**study.fixed, x: value, **kept}):
                any_beyond = True
                axis.plot(str(value), rate, "s", color=_RED, markersize=12, markerfacecolor="none")
    axis.set_xlabel(_NAMES.get(x, x))
    axis.set_ylabel("share of successes")
    axis.set_ylim(-0.05, 1.05)
    _title(axis, any_beyond, "red squares")
    if others:
        axis.legend(fontsize=8)


def _rate(rows: Sequence[Measured], where: dict[str, Any]) -> float:
    found = [row["success"] for row in rows if all(row[name] == value for name, value in where.items())]
    return float(np.mean(found)) if found else np.nan


def save_planes(recovery: Recovery, path: Path, *, overwrite: bool = False) -> Path:
    """Writes the picture of the delay–Doppler planes."""
    from tmca.dbd.tables import planes
    from tmca.plots.dbd import Plane, planes_figure

    return save_figure(planes_figure([Plane(**one) for one in planes(recovery)]), path, overwrite=overwrite)


def check_results(out: Path, overwrite: bool) -> None:
    """Says before the work that results could not be written.

    Raises:
        OutputError: a file exists, or its folder is missing.
    """
    for suffix in _SUFFIXES:
        check_target(out.with_name(out.name + suffix), overwrite)


def save_results(
    study: Study, rows: Sequence[Measured], out: Path, command: Sequence[str], *, overwrite: bool = False
) -> None:
    """Writes the rows as Markdown, JSON, CSV and a picture."""

    def named(suffix: str) -> Path:
        return out.with_name(out.name + suffix)

    fixed = {**DEFAULTS, **study.fixed}
    settled = ", ".join(f"{name} = {value}" for name, value in fixed.items() if name not in study.axes)
    said = shlex.join(command)
    head = f"# Phase transition\n\nCommand: `{said}`\n\n{study.draws} draws a row; {settled}.\n\n"
    text = head + study_table(study, rows) + f"\n![share of successes]({named('.png').name})\n"
    write_text(text, named(".md"), overwrite=overwrite)
    described = {"command": said, "fixed": fixed, "draws": study.draws, "rows": list(rows)}
    write_json(described, named(".json"), overwrite=overwrite)
    lines = io.StringIO()
    writer = csv.DictWriter(lines, sorted({name for row in rows for name in row} - {"values"}), extrasaction="ignore")
    writer.writeheader()
    writer.writerows(rows)
    write_text(lines.getvalue(), named(".csv"), overwrite=overwrite)
    save_figure(study_figure(study, rows), named(".png"), overwrite=overwrite)
