"""Pictures of designs: what they gain."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tmca.experiments.figures import plain_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tmca.design import Advice

_COLOURS = ("#00798c", "#d1495b", "#edae49", "#66a182", "#8d6a9f")


def gains_figure(advice: Advice) -> Figure:
    """Gain over the static code against the number of slots, a line for each kind; bars are the scenes' spread."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 3.6), layout="constrained")
    axis = figure.add_subplot()
    axis.axhline(0, color="#999999", linewidth=0.8)
    surveyed = [c for c in advice.surveyed if c.design.kind != "static"]
    kinds = list(dict.fromkeys(c.design.kind for c in surveyed))
    for place, kind in enumerate(kinds):
        own = sorted((c for c in surveyed if c.design.kind == kind), key=lambda c: c.design.slots)
        x = [c.design.slots * 1.03 ** (place - (len(kinds) - 1) / 2) for c in own]
        axis.errorbar(
            x, [c.gain for c in own], [c.spread or 0.0 for c in own], fmt="o-", capsize=3, label=kind,
            color=_COLOURS[place % len(_COLOURS)], linewidth=1.2, markersize=4,
        )  # fmt: skip
    if (chosen := advice.chosen) is not None:
        said = ("recommended, " if advice.multiplex else "") + "searched longer, over its own static code"
        axis.errorbar(
            chosen.design.slots, chosen.gain, chosen.spread or 0.0, fmt="k*", capsize=3, markersize=11, label=said
        )
    slots = sorted({c.design.slots for c in surveyed}) or [1]
    axis.set_xscale("log", base=2)
    axis.set_xlim(slots[0] / 1.5, slots[-1] * 1.5)
    axis.set_xticks(slots, [str(k) for k in slots])
    axis.minorticks_off()
    if surveyed:
        figure.legend(fontsize=8, loc="outside lower center", ncols=len(kinds) + 1)
    plain_axes(axis, "each scene under the prior of the others", "slots K", "gain over the static code (dB)")
    return figure
