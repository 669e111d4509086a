"""Pictures of a recovery: the norms of the dual polynomials over delay and Doppler, with their unit level."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.dbd.arrays import Real
from tmca.dbd.atoms.atoms import Atoms
from tmca.dbd.atoms.polynomial import Polynomial
from tmca.dbd.physical import centred, is_radar, physical
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
    figure = Figure(figsize=(5.2 * columns + 0.8, 4.4 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).reshape(-1)
    norms = [_norms(recovery, index) for index in range(count)]
    top = max(1.0, *(float(one.max()) for one in norms))
    shown: Any = None
    for index, axis in enumerate(axes[:count]):
        shown = _plane(axis, recovery, index, norms[index], top) or shown
    for axis in axes[count:]:
        axis.remove()
    if shown is not None:
        figure.colorbar(shown, ax=list(axes[:count])).set_label("‖f‖ / weight; black line: 0.98", fontsize=_SMALL)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=_SMALL, frameon=False)
    return figure


def _norms(recovery: Recovery, index: int) -> Real:
    """``‖f‖ / weight`` on a fine grid of a source's coordinates."""
    source = recovery.problem.sources[index]
    atoms = Atoms(source, recovery.problem.shape)
    return np.sqrt(Polynomial(atoms, recovery.q).norms_on_grid(_OVERSAMPLING)) / source.weight


def _plane(axis: Axes, recovery: Recovery, index: int, norms: Real, top: float) -> Any:
    """Draws a source; returns the image, if it is one."""
    problem, found = recovery.problem, recovery.sources[index]
    atoms = Atoms(problem.sources[index], problem.shape)
    title = f"{found.name}: norm of the dual polynomial"
    if "angle" in atoms.axes and len(found.points):
        angle = found.points[int(np.argmax(np.abs(found.amplitudes))), 2]
        norms = norms[..., round(angle * norms.shape[-1]) % norms.shape[-1]]
        title += f" at the angle {angle:.3f}"
    if recovery.sigma == 0 and not recovery.certified:
        title += ", no certificate"
    axis.set_title(title, fontsize=_TITLE)
    axis.tick_params(labelsize=_SMALL)
    if norms.ndim == 2:
        shown = _drawn_plane(axis, norms, found.name, problem.units, top)
        _marks(axis, problem, found, index)
        return shown
    _drawn_line(axis, norms.reshape(-1), atoms.axes[0], problem, found, index)
    return None


def _drawn_plane(axis: Axes, norms: Real, name: str, units: Units | None, top: float) -> Any:
    sizes = norms.shape
    delays = _scaled(np.array([0.0, 1.0]), "delay", name, units)
    dopplers = _scaled(np.array([-0.5, 0.5]), "doppler", name, units)
    shifted = np.roll(norms, sizes[1] // 2, axis=1)
    extent = (delays[0], delays[1], dopplers[0], dopplers[1])
    shown = axis.imshow(shifted.T, origin="lower", extent=extent, aspect="auto", cmap="viridis", vmin=0, vmax=top)
    if norms.max() > 0.98:
        x = _scaled(np.arange(sizes[0]) / sizes[0], "delay", name, units)
        y = _scaled(np.arange(sizes[1]) / sizes[1] - 0.5, "doppler", name, units)
        axis.contour(x, y, shifted.T, levels=[0.98], colors="black", linewidths=0.8)
    axis.set_xlabel(_label("delay", name, units), fontsize=_SMALL)
    axis.set_ylabel(_label("doppler", name, units), fontsize=_SMALL)
    return shown


def _marks(axis: Axes, problem: Problem, found: RecoveredSource, index: int) -> None:
    """Truth as rings, what was found as crosses."""
    from matplotlib.patheffects import withStroke

    if problem.truth is not None:
        x, y = _places(problem.truth[index].points, found.name, problem.units)
        outlined = [withStroke(linewidth=3.2, foreground="black")]  # seen on the plane and in the legend
        axis.plot(x, y, "o", label="truth", markeredgecolor="white", path_effects=outlined, **_RING)
    x, y = _places(found.points, found.name, problem.units)
    axis.plot(x, y, "x", markersize=7, color="#d1495b", markeredgewidth=2, label="found")


def _places(points: Real, name: str, units: Units | None) -> tuple[Real, Real]:
    doppler = np.nan_to_num(centred(points[:, 1]))
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
    return values if units is None or axis == "angle" else physical(values, AXES.index(axis), name, units)


def _label(axis: str, name: str, units: Units | None) -> str:
    if units is None or axis == "angle":
        return {"delay": "normalised delay", "doppler": "normalised Doppler", "angle": "normalised angle"}[axis]
    if axis == "delay":
        return "range, m" if is_radar(name) else "path length, m"
    return "radial velocity, m/s"
