"""Pictures of a recovery: the norms of the dual polynomials over delay and Doppler, with their unit level."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.dbd.arrays import Real
from tmca.dbd.atoms.atoms import Atoms
from tmca.dbd.atoms.polynomial import Polynomial
from tmca.dbd.problem import Problem, Units
from tmca.dbd.recovery import RecoveredSource, Recovery
from tmca.dbd.source import AXES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_OVERSAMPLING = 12
_TITLE, _SMALL = 10, 9
_RING: dict[str, Any] = {"markersize": 12, "markerfacecolor": "none", "markeredgewidth": 1.6}


def planes_figure(recovery: Recovery) -> Figure:
    """A picture for every source: ``‖f‖ / weight`` over its delay–Doppler plane, what was found, the truth if known.

    ``block`` messages, whose polynomial does not depend on the Doppler, are drawn over the delay alone; with several
    antennas the angle is the one of the strongest path.
    """
    from matplotlib.figure import Figure

    count = len(recovery.sources)
    columns = min(count, 2)
    rows = -(-count // columns)
    figure = Figure(figsize=(5.6 * columns, 4.4 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).reshape(-1)
    for index, axis in enumerate(axes[:count]):
        _plane(axis, recovery, index)
    for axis in axes[count:]:
        axis.remove()
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=_SMALL, frameon=False)
    return figure


def _plane(axis: Axes, recovery: Recovery, index: int) -> None:
    problem, found = recovery.problem, recovery.sources[index]
    source = problem.sources[index]
    atoms = Atoms(source, problem.shape)
    norms = np.sqrt(Polynomial(atoms, recovery.q).norms_on_grid(_OVERSAMPLING)) / source.weight
    axis.set_title(f"{source.name}: norm of the dual polynomial", fontsize=_TITLE)
    if "angle" in atoms.axes and len(found.points):
        strongest = int(np.argmax(np.abs(found.amplitudes)))
        norms = norms[..., round(found.points[strongest, 2] * norms.shape[-1]) % norms.shape[-1]]
    if norms.ndim == 2:
        _drawn_plane(axis, norms, source.name, problem.units)
        _marks(axis, problem, found, index)
    else:
        _drawn_line(axis, norms.reshape(-1), atoms.axes[0], problem, found, index)
    axis.tick_params(labelsize=_SMALL)


def _drawn_plane(axis: Axes, norms: Real, name: str, units: Units | None) -> None:
    delays = _scaled(np.arange(norms.shape[0] + 1) / norms.shape[0], "delay", name, units)
    dopplers = _scaled(np.arange(norms.shape[1] + 1) / norms.shape[1] - 0.5, "doppler", name, units)
    shifted = np.roll(norms, norms.shape[1] // 2, axis=1)
    extent = (delays[0], delays[-1], dopplers[0], dopplers[-1])
    top = max(1.0, float(norms.max()))
    shown = axis.imshow(shifted.T, origin="lower", extent=extent, aspect="auto", cmap="viridis", vmin=0, vmax=top)
    if norms.max() > 0.98:
        middle = (np.arange(norms.shape[0]) + 0.5) / norms.shape[0]
        x = _scaled(middle - 0.5 / norms.shape[0], "delay", name, units)
        y = _scaled((np.arange(norms.shape[1]) / norms.shape[1]) - 0.5, "doppler", name, units)
        axis.contour(x, y, shifted.T, levels=[0.98], colors="black", linewidths=0.8)
    assert axis.figure is not None
    bar: Any = axis.figure.colorbar(shown, ax=axis)
    bar.set_label("‖f‖ / weight; black line: 0.98", fontsize=_SMALL)
    axis.set_xlabel(_label("delay", name, units), fontsize=_SMALL)
    axis.set_ylabel(_label("doppler", name, units), fontsize=_SMALL)


def _marks(axis: Axes, problem: Problem, found: RecoveredSource, index: int) -> None:
    """Truth as rings, what was found as crosses."""
    if problem.truth is not None:
        x, y = _places(problem.truth[index].points, found.name, problem.units)
        axis.plot(x, y, "o", label="truth", markeredgecolor="white", **_RING)
    x, y = _places(found.points, found.name, problem.units)
    axis.plot(x, y, "x", markersize=7, color="#d1495b", markeredgewidth=2, label="found")


def _places(points: Real, name: str, units: Units | None) -> tuple[Real, Real]:
    doppler = np.nan_to_num((points[:, 1] + 0.5) % 1.0 - 0.5)
    return _scaled(points[:, 0], "delay", name, units), _scaled(doppler, "doppler", name, units)


def _drawn_line(axis: Axes, norms: Real, name: str, problem: Problem, found: RecoveredSource, index: int) -> None:
    column, units = AXES.index(name), problem.units
    grid = _scaled(np.arange(len(norms)) / len(norms), name, found.name, units)
    axis.plot(grid, norms, color="#00798c", linewidth=1.2)
    axis.axhline(1.0, color="0.5", linewidth=0.8, linestyle="--")
    if problem.truth is not None:
        x = _scaled(problem.truth[index].points[:, column], name, found.name, units)
        axis.plot(x, np.ones_like(x), "o", label="truth", markeredgecolor="#edae49", **_RING)
    x = _scaled(found.points[:, column], name, found.name, units)
    axis.plot(x, np.ones_like(x), "x", markersize=7, color="#d1495b", markeredgewidth=2, label="found")
    axis.set_xlabel(_label(name, found.name, units), fontsize=_SMALL)
    axis.set_ylabel("‖f‖ / weight", fontsize=_SMALL)
    axis.set_ylim(0, 1.15 * max(1.0, float(norms.max())))


def _scaled(values: Real, axis: str, name: str, units: Units | None) -> Real:
    """Normalised coordinates in the units of the labels."""
    if units is None or axis == "angle":
        return values
    if axis == "delay":
        return physical(values, 0, name, units)
    return physical(values, 1, name, units)


def _label(axis: str, name: str, units: Units | None) -> str:
    if units is None or axis == "angle":
        return {"delay": "normalised delay", "doppler": "normalised Doppler", "angle": "normalised angle"}[axis]
    if axis == "delay":
        return "range, m" if name.startswith("radar") else "path length, m"
    return "radial velocity, m/s"


def physical(values: Real, axis: int, name: str, units: Units) -> Real:
    """Normalised delays as metres and Dopplers (−½ to ½) as metres a second; there and back for a radar."""
    light, ways = 299_792_458.0, 2.0 if name.startswith("radar") else 1.0
    if axis == 0:
        return values * units.delay_s * light / ways
    return values * units.doppler_hz * light / (ways * units.carrier_hz)
