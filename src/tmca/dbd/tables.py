"""A recovery in numbers and words."""

from __future__ import annotations

from typing import Any

import numpy as np

from tmca.dbd.physical import centred, deviation, from_zero, key, physical
from tmca.dbd.problem import Problem
from tmca.dbd.recovery import RecoveredSource, Recovery
from tmca.dbd.source import AXES

_UNITS = {"m": "m", "m_s": "m/s", "deg": "degrees"}


def recovery_values(recovery: Recovery) -> dict[str, Any]:
    """Everything a script may ask for, in plain numbers."""
    values: dict[str, Any] = {"method": recovery.method, "found": recovery.found, "exact": recovery.exact}
    values |= {"certified": recovery.certified, "residual": recovery.residual, "sigma": recovery.sigma}
    values |= {"seconds": recovery.seconds, "notes": list(recovery.notes)}
    values["sources"] = {one.name: _source_values(one, recovery.problem) for one in recovery.sources}
    if recovery.problem.truth is not None:
        score = recovery.score()
        found = score.max_error if np.isfinite(score.max_error) else None
        values["score"] = {"success": score.success, "tolerance": score.tolerance, "max_error": found}
        values["score"]["waveform_correlation"] = {one.name: one.waveform_correlation for one in score.sources}
    return values


def _source_values(source: RecoveredSource, problem: Problem) -> list[dict[str, Any]]:
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


def _quantities(source: RecoveredSource, index: int, problem: Problem) -> dict[str, tuple[float, float | None]]:
    """Range or length, velocity and angle of a path with their deviations, where there are units."""
    if problem.units is None:
        return {}
    delay, *others = source.points[index]
    point = np.array([from_zero(delay, problem.shape[2]), *centred(np.array(others))])
    found = {}
    for axis in np.flatnonzero(np.isfinite(point)):
        place = (int(axis), source.name, problem.units)
        spread = None if source.bounds is None else float(deviation(point[axis], source.bounds[index, axis], *place))
        found[key(int(axis), source.name)] = (float(physical(point[axis], *place)), spread)
    return found


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


def _source_lines(source: RecoveredSource, problem: Problem) -> list[str]:
    count = len(source.points)
    if not count:
        return [f"{source.name}: no paths"]
    rows = [_named_cells(source, int(index), problem) for index in np.argsort(source.points[:, 0])]
    headings = "  ".join(f"{one:>22}" for one in rows[0])
    lines = ["  ".join(f"{one:>22}" for one in row.values()) for row in rows]
    return [f"{source.name}: {count} path{'s' if count > 1 else ''}", headings, *lines]


def _named_cells(source: RecoveredSource, index: int, problem: Problem) -> dict[str, str]:
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
