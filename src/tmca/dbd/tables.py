"""A recovery in numbers and words."""

from __future__ import annotations

from typing import Any

import numpy as np

from tmca.dbd.arrays import Real
from tmca.dbd.figures import physical
from tmca.dbd.problem import Units
from tmca.dbd.recovery import RecoveredSource, Recovery
from tmca.dbd.source import AXES


def recovery_values(recovery: Recovery) -> dict[str, Any]:
    """Everything a script may ask for, in plain numbers."""
    values: dict[str, Any] = {"method": recovery.method, "found": recovery.found, "exact": recovery.exact}
    values |= {"certified": recovery.certified, "residual": recovery.residual, "sigma": recovery.sigma}
    values |= {"seconds": recovery.seconds, "notes": list(recovery.notes)}
    values["sources"] = {one.name: _source_values(one, recovery.problem.units) for one in recovery.sources}
    if recovery.problem.truth is not None:
        score = recovery.score()
        found = score.max_error if np.isfinite(score.max_error) else None
        values["score"] = {"success": score.success, "tolerance": score.tolerance, "max_error": found}
        values["score"]["waveform_correlation"] = {one.name: one.waveform_correlation for one in score.sources}
    return values


def _source_values(source: RecoveredSource, units: Units | None) -> list[dict[str, Any]]:
    rows = []
    for index, point in enumerate(source.points):
        row: dict[str, Any] = {axis: _plain(value) for axis, value in zip(AXES, point, strict=True)}
        row |= {"gain": abs(source.amplitudes[index]), "phase_rad": float(np.angle(source.amplitudes[index]))}
        if source.bounds is not None:
            pairs = zip(AXES, source.bounds[index], strict=True)
            row |= {f"{axis}_bound": _plain(value) for axis, value in pairs}
        if units is not None:
            delay, doppler = _physical(point, source.name, units)
            row |= {"range_m" if source.name.startswith("radar") else "length_m": delay, "velocity_m_s": doppler}
        rows.append(row)
    return rows


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _physical(point: Real, name: str, units: Units) -> tuple[float, float]:
    doppler = np.nan_to_num((point[1] + 0.5) % 1.0 - 0.5)
    return float(physical(point[0], 0, name, units)), float(physical(doppler, 1, name, units))


def recovery_lines(recovery: Recovery) -> list[str]:
    """A table for every source, the flags, and what cannot be known."""
    lines = []
    for source in recovery.sources:
        lines += [*_source_lines(source, recovery.problem.units), ""]
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


def _source_lines(source: RecoveredSource, units: Units | None) -> list[str]:
    if not len(source.points):
        return [f"{source.name}: no paths"]
    axes = [index for index in range(len(AXES)) if np.all(np.isfinite(source.points[:, index]))]
    headings = [AXES[index] + (" (relative)" if index == 1 and source.relative_doppler else "") for index in axes]
    if units is not None:
        headings += ["range, m" if source.name.startswith("radar") else "length, m", "velocity, m/s"]
    lines = [f"{source.name}: {len(source.points)} paths", "  ".join(f"{one:>22}" for one in (*headings, "gain"))]
    for index in np.argsort(source.points[:, 0]):
        cells = [_with_bound(source, int(index), axis) for axis in axes]
        if units is not None:
            cells += [f"{value:.2f}" for value in _physical(source.points[index], source.name, units)]
        cells.append(f"{abs(source.amplitudes[index]):.3g}")
        lines.append("  ".join(f"{one:>22}" for one in cells))
    return lines


def _with_bound(source: RecoveredSource, index: int, axis: int) -> str:
    value = f"{source.points[index, axis]:.6f}"
    if source.bounds is None:
        return value
    bound = source.bounds[index, axis]
    return f"{value} ± {bound:.1e}" if np.isfinite(bound) else f"{value} (no bound)"
