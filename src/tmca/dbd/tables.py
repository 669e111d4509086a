"""A recovery in numbers, in words, and as the arrays of a picture."""

from __future__ import annotations

from typing import Any

import numpy as np

from tmca.dbd.atoms import Atoms, Polynomial
from tmca.dbd.channel import Channel
from tmca.dbd.coordinates import AXES, Real, Units, centred, from_zero, is_radar
from tmca.dbd.model import Problem
from tmca.dbd.recovery import Recovery

_OVERSAMPLING = 12
_UNITS = {"m": "m", "m_s": "m/s", "deg": "degrees"}


def recovery_values(recovery: Recovery) -> dict[str, Any]:
    """Everything a script may ask for, in plain numbers."""
    values: dict[str, Any] = {"method": recovery.method, "found": recovery.found, "exact": recovery.exact}
    values |= {"certified": recovery.certified, "residual": recovery.residual, "sigma": recovery.sigma}
    values |= {"seconds": recovery.seconds, "notes": list(recovery.notes)}
    values["sources"] = {one.name: _source_values(one, recovery.problem) for one in recovery.sources}
    if recovery.problem.truth is not None:
        score = recovery.score()
        error = _plain(score.max_error)
        values["score"] = {"success": score.success, "tolerance": score.tolerance, "max_error": error}
        values["score"]["waveform_correlation"] = {one.name: one.waveform_correlation for one in score.sources}
    return values


def _source_values(source: Channel, problem: Problem) -> list[dict[str, Any]]:
    rows = []
    for index, point in enumerate(source.points):
        row: dict[str, Any] = {axis: _plain(value) for axis, value in zip(AXES, point, strict=True)}
        row |= {"gain": abs(source.amplitudes[index]), "phase_rad": float(np.angle(source.amplitudes[index]))}
        if source.bounds is not None:
            pairs = zip(AXES, source.bounds[index], strict=True)
            row |= {f"{axis}_bound": _plain(value) for axis, value in pairs}
        for name, (value, spread) in _quantities(source, index, problem).items():
            row[name] = value
            if spread is not None:
                row[f"{name}_bound"] = _plain(spread)
        rows.append(row)
    return rows


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _quantities(source: Channel, index: int, problem: Problem) -> dict[str, tuple[float, float | None]]:
    """Range or length, velocity and angle of a path with their deviations, where there are units."""
    if problem.units is None:
        return {}
    delay, *others = source.points[index]
    point = np.array([from_zero(delay, problem.shape[2]), *centred(np.array(others))])
    names = ("range_m" if is_radar(source.name) else "length_m", "velocity_m_s", "angle_deg")
    quantities = {}
    for axis in map(int, np.flatnonzero(np.isfinite(point))):
        bound = None
        if source.bounds is not None:
            bound = float(problem.units.deviation(point[axis], source.bounds[index, axis], axis, source.name))
        quantities[names[axis]] = (float(problem.units.physical(point[axis], axis, source.name)), bound)
    return quantities


def recovery_lines(recovery: Recovery) -> list[str]:
    """A table for every source, the flags, and what cannot be known."""
    lines = []
    for source in recovery.sources:
        lines += [*_source_lines(source, recovery.problem), ""]
    proof = "not looked for" if recovery.certificate is None else recovery.certificate.status
    noise = "none" if recovery.sigma == 0 else f"{recovery.sigma:.3g}"
    lines.append(
        f"found: {'yes' if recovery.found else 'no'} · exact fit: {'yes' if recovery.exact else 'no'} · "
        f"certificate: {proof} · residual {recovery.residual:.2g} · noise {noise} · {recovery.seconds:.2f} s"
    )
    if recovery.problem.truth is not None:
        score = recovery_values(recovery)["score"]
        error = "wrong number of paths" if score["max_error"] is None else f"largest error {score['max_error']:.2g}"
        lines.append(f"against the truth: {'success' if score['success'] else 'no success'} ({error})")
    return [*lines, *(f"note: {note}" for note in recovery.notes)]


def _source_lines(source: Channel, problem: Problem) -> list[str]:
    count = len(source.points)
    if not count:
        return [f"{source.name}: no paths"]
    rows = [_named_cells(source, int(index), problem) for index in np.argsort(source.points[:, 0])]
    headings = "  ".join(f"{one:>22}" for one in rows[0])
    lines = ["  ".join(f"{one:>22}" for one in row.values()) for row in rows]
    return [f"{source.name}: {count} path{'s' if count > 1 else ''}", headings, *lines]


def _named_cells(source: Channel, index: int, problem: Problem) -> dict[str, str]:
    """Heading → text of a path: in physical units where there are any, normalised without."""
    relative = " (relative)" if source.relative_doppler else ""
    cells = {}
    for name, (value, spread) in _quantities(source, index, problem).items():
        quantity, unit = name.split("_", 1)
        heading = f"{quantity}{relative if quantity == 'velocity' else ''}, {_UNITS[unit]}"
        cells[heading] = _with_bound(value, spread, 2)
    if not cells:
        for axis in np.flatnonzero(np.isfinite(source.points[index])):
            spread = None if source.bounds is None else source.bounds[index, axis]
            heading = AXES[axis] + (relative if axis == 1 else "")
            cells[heading] = _with_bound(source.points[index, axis], spread, 6)
    return cells | {"gain": f"{abs(source.amplitudes[index]):.3g}"}


def _with_bound(value: float, bound: float | None, digits: int) -> str:
    text = f"{value:.{digits}f}"
    if bound is None:
        return text
    return f"{text} ± {bound:.1e}" if digits > 2 and np.isfinite(bound) else f"{text} ± {bound:.2g}"


def planes(recovery: Recovery) -> list[dict[str, Any]]:
    """What :class:`tmca.plots.dbd.Plane` shows of every source: ``‖f‖ / weight``, the estimate, the truth if known.

    Over delay and Doppler; ``block`` messages, whose polynomial does not depend on the Doppler, over the delay alone;
    with several antennas at the angle of the strongest path.
    """
    return [_plane(recovery, index) for index in range(len(recovery.sources))]


def _plane(recovery: Recovery, index: int) -> dict[str, Any]:
    problem, channel = recovery.problem, recovery.sources[index]
    atoms = Atoms(problem.sources[index], problem.shape)
    norms = np.sqrt(Polynomial(atoms, recovery.q).norms_on_grid(_OVERSAMPLING)) / atoms.source.weight
    title = f"{channel.name}: norm of the dual polynomial"
    if "angle" in atoms.axes and len(channel):
        angle = channel.points[channel.strongest, 2]
        norms = norms[..., round(angle * norms.shape[-1]) % norms.shape[-1]]
        title += f" at the angle {angle:.3f}"
    if recovery.sigma == 0 and not recovery.certified:
        title += ", no certificate"
    axes = [AXES.index(axis) for axis in atoms.axes[: norms.ndim]]
    if norms.ndim == 2:
        norms = np.roll(norms, norms.shape[1] // 2, axis=1)
    starts = [-0.5 if place else 0.0 for place in range(norms.ndim)]
    ranges = [start + np.arange(size + 1) / size for start, size in zip(starts, norms.shape, strict=True)]
    truth = None if problem.truth is None else problem.truth[index].points
    return {
        "title": title,
        "norms": norms,
        "edges": [_scaled(one, axis, channel.name, problem.units) for one, axis in zip(ranges, axes, strict=True)],
        "labels": [_label(axis, channel.name, problem.units) for axis in axes],
        "estimate": _places(channel.points, axes, channel.name, problem.units),
        "truth": None if truth is None else _places(truth, axes, channel.name, problem.units),
    }


def _places(points: Real, axes: list[int], name: str, units: Units | None) -> Real:
    """``(n, 1 or 2)`` of points in a picture's units; Dopplers over a delay are of −½ to ½."""
    columns = [points[:, axes[0]], *(np.nan_to_num(centred(points[:, axis])) for axis in axes[1:])]
    return np.stack([_scaled(one, axis, name, units) for one, axis in zip(columns, axes, strict=True)], axis=-1)


def _scaled(values: Real, axis: int, name: str, units: Units | None) -> Real:
    return values if units is None or axis == 2 else units.physical(values, axis, name)


def _label(axis: int, name: str, units: Units | None) -> str:
    if units is None or axis == 2:
        return ("normalised delay", "normalised Doppler", "normalised angle")[axis]
    return ("range, m" if is_radar(name) else "path length, m", "radial velocity, m/s")[axis]
