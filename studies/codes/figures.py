"""Pictures of the study of codes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from studies.codes.records import RankedRow, Results
from studies.codes.tables import grid_rows, network_rows, test_rows
from tmca.plots import add_bar, grid, plain_axes, save_figure

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = ("#9aa5b1", "#5b6770", "#00798c", "#d1495b", "#edae49")


def files_of(out: Path) -> list[Path]:
    """Pictures of a study."""
    return [out / f"codes_{name}.png" for name in ("read_noise", "full_well", "gains", "order")]


def study_figures(found: Results, out: Path, *, overwrite: bool = False) -> list[Path]:
    """Maps of the gain over (K, read noise) and (K, full well); gains on test scenes and the order of codes."""
    noises = list(dict.fromkeys(row["noise"] for row in found["grid"]))
    parts = [[n for n in noises if n.startswith("σ")], [n for n in noises if not n.startswith("σ")]]
    labels = ("read noise, snapshot units", "full well, read noise")
    figures = [gain_maps(grid_rows(found, 1), part, label) for part, label in zip(parts, labels, strict=True)]
    if found["test"]:
        figures += [gains_figure(found), order_figure(found["ranking"])]
    return [save_figure(one, file, overwrite=overwrite) for one, file in zip(figures, files_of(out), strict=False)]


def gain_maps(rows: pd.DataFrame, noises: Sequence[str], label: str) -> Figure:
    """Gain over the static design of one-hot and free codes: expected, and under the prior of the other scenes."""
    rows, meanings = rows[rows.slots > 1], {"gain": "expected", "held_out": "prior of the other scenes"}
    slots, noises = sorted(rows.slots.unique()), [noise for noise in noises if noise in set(rows.noise)]
    figure, axes = grid(2, 2, width=4.6, aspect=0.75)
    top = float(rows[[*meanings]].abs().max(axis=None)) or 1.0
    for line, (key, meaning) in zip(axes, meanings.items(), strict=True):
        for axis, kind in zip(line, ("one-hot", "free"), strict=True):
            known = rows[rows.kind == kind].pivot(index="noise", columns="slots", values=key)
            values = known.reindex(index=noises, columns=slots).to_numpy()
            shown = axis.imshow(values, cmap="RdBu", vmin=-top, vmax=top, aspect="auto")
            for (y, x), value in np.ndenumerate(values):
                colour = "white" if abs(value) > 0.6 * top else "black"
                axis.text(x, y, f"{value:+z.1f}", ha="center", va="center", fontsize=8, color=colour)
            axis.set_xticks(range(len(slots)), [str(k) for k in slots])
            axis.set_yticks(range(len(noises)), [_short(noise) for noise in noises])
            plain_axes(axis, f"{kind}, {meaning}", "slots K", label)
            add_bar(axis, shown, "gain over static (dB)")
    return figure


def _short(noise: str) -> str:
    return noise.removeprefix("σ = ").replace(" full well, ", "\n").removesuffix(" read noise")


def gains_figure(found: Results) -> Figure:
    """Gain of designed time-multiplexed codes over the static design: said beforehand, and measured on test scenes."""
    rows, order = test_rows(found["test"], found["light"]), dict.fromkeys(row["noise"] for row in found["grid"])
    networks = network_rows(found["network"]) if found["network"] else None
    figure, axes = grid(1, 2, width=6.6, aspect=0.52)
    for axis, kind in zip(axes[0], ("free", "one-hot"), strict=True):
        designed = rows[rows.codes == f"{kind}, designed"].set_index("noise")
        bars = {
            "expected": designed.expected.to_dict(),
            "prior of the other scenes": designed.predicted.to_dict(),
            "the same, examples dimmed to each scene": designed.there.to_dict(),
            "LMMSE, test scenes": designed.gain.to_dict(),
        }
        if networks is not None:
            trained = networks[networks.codes == f"{kind} K = {found['slots']}, designed"]
            bars["unrolled, test scenes"] = trained.set_index("noise").gain.to_dict()
        _draw_bars(axis, {name: values for name, values in bars.items() if values}, list(order))
        plain_axes(axis, f"{kind} codes, K = {found['slots']}", "", "gain over the static design (dB)")
    return figure


def _draw_bars(axis: Axes, bars: dict[str, dict[str, float]], order: Sequence[str]) -> None:
    noises = [noise for noise in order if any(noise in values for values in bars.values())]
    width = 0.8 / len(bars)
    for place, (name, values) in enumerate(bars.items()):
        x = [noises.index(noise) + (place - (len(bars) - 1) / 2) * width for noise in values]
        shown = axis.bar(x, list(values.values()), width, label=name, color=_COLOURS[place])
        axis.bar_label(shown, fmt="{:+z.1f}", fontsize=6.5)
        for noise in set(noises) - set(values):
            middle = noises.index(noise) + (place - (len(bars) - 1) / 2) * width
            axis.text(middle, 0, " not computed", rotation=90, ha="center", va="bottom", fontsize=6.5, color="#777777")
    axis.axhline(0, color="#333333", linewidth=0.8)
    axis.set_xticks(range(len(noises)), [_short(noise) if noise[0] != "σ" else noise for noise in noises])
    axis.margins(y=0.12)
    axis.set_xlim(-0.6, len(noises) - 0.4)
    axis.legend(fontsize=8)


def order_figure(ranked: Sequence[RankedRow]) -> Figure:
    """Every ranked code: PSNR on test scenes against the expected one, a column for each noise.

    Above expected of the examples as they are, below of examples dimmed to the test scenes' mean.
    """
    noises = list(dict.fromkeys(row["noise"] for row in ranked))
    figure, axes = grid(2, len(noises), width=4.6, aspect=0.8)
    for row, dimmed in zip(axes, (False, True), strict=True):
        label = "PSNR expected, examples dimmed (dB)" if dimmed else "PSNR expected (dB)"
        for axis, noise in zip(row, noises, strict=True):
            _draw_order(axis, [code for code in ranked if code["noise"] == noise], dimmed)
            plain_axes(axis, f"{noise}: only the order is compared, not the level", label, "PSNR on test scenes (dB)")
    return figure


def _draw_order(axis: Axes, codes: Sequence[RankedRow], dimmed: bool) -> None:
    measured = {"LMMSE": {code["codes"]: code["lmmse"] for code in codes}}
    measured["unrolled"] = {code["codes"]: code["unrolled"] for code in codes if "unrolled" in code}
    for colour, (decoder, values) in zip(_COLOURS[2:], measured.items(), strict=False):
        known = [code for code in codes if code["codes"] in values]
        x = [code["expected_there" if dimmed else "expected"] for code in known]
        y = [float(np.mean(list(values[code["codes"]].values()))) for code in known]
        if known:
            axis.plot(x, y, "o", color=colour, markersize=5, label=decoder)
    axis.legend(fontsize=8)
