"""A recovery in numbers and in words."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.dbd.channel import Channel
from tmca.dbd.model import AXES, Problem, is_radar
from tmca.dbd.paths import coordinates, finite, path_names, path_rows, quantities
from tmca.dbd.separation import Separation, joint_separation

if TYPE_CHECKING:
    from tmca.dbd.recovery import Recovery, Score

_NORMALISED = (("delay", "delay", 1.0, 6), ("doppler", "doppler", 1.0, 6), ("angle", "angle", 1.0, 6))
_PHYSICAL = (
    ("range_m", "range, m", 1.0, 2), ("length_m", "length, m", 1.0, 2), ("velocity_m_s", "velocity, m/s", 1.0, 2),
    ("angle_deg", "angle, degrees", 1.0, 2), ("delay_s", "delay, µs", 1e6, 5), ("doppler_hz", "Doppler, kHz", 1e-3, 3),
)  # fmt: skip
"""Numbers of a table: heading, factor and digits."""
_PLURAL = {"delay": "delays", "doppler": "Dopplers"}
_MOST_DECIMALS = 12
_MOST_IN_DOUBT = 12
"""Paths of a source that a table in doubt has, the strongest."""


def recovery_values(recovery: Recovery) -> dict[str, Any]:
    """Everything a script may ask for, in plain numbers."""
    values: dict[str, Any] = {"method": recovery.method, "found": recovery.found, "exact": recovery.exact}
    values |= {"certified": recovery.certified, "residual": recovery.residual, "sigma": recovery.sigma}
    values |= {"unexplained": recovery.unexplained, "doubt": recovery.doubt}
    values["joint_separation"] = _separation_values(recovery)
    values["paths"] = path_rows(recovery)
    values |= {"seconds": recovery.seconds, "notes": list(recovery.notes)}
    values["sources"] = {one.name: _source_values(one, recovery) for one in recovery.sources}
    if recovery.problem.truth is not None:
        score = recovery.score()
        error = finite(score.max_error)
        values["score"] = {"success": score.success, "tolerance": score.tolerance, "max_error": error}
        values["score"]["waveform_correlation"] = {one.name: one.waveform_correlation for one in score.sources}
    return values


def _source_values(source: Channel, recovery: Recovery) -> list[dict[str, Any]]:
    rows = []
    for index, gain in enumerate(source.amplitudes):
        row: dict[str, Any] = {"gain": abs(gain), "phase_rad": float(np.angle(gain)), "power_db": _decibels(gain)}
        for name, (value, bound) in (coordinates(source, index) | quantities(source, index, recovery.problem)).items():
            row[name] = finite(value)
            if bound is not None:
                row[f"{name}_bound"] = finite(bound)
        rows.append(row)
    return rows


def _decibels(gain: complex) -> float | None:
    return finite(20 * np.log10(abs(gain))) if gain else None


def _separation_values(recovery: Recovery) -> dict[str, Any]:
    """Whether the joint separation condition holds, in any coordinate, and how near the points are."""
    separation = joint_separation(recovery)
    values: dict[str, Any] = {"satisfied": any(one.satisfied for one in separation)}
    for one in separation:
        number = finite(one.condition_number)
        values[one.axis] = {"least": finite(one.least), "needed": one.needed, "condition_number": number}
    return values


def separation_line(recovery: Recovery) -> str:
    """The joint separation of all targets and paths in one line."""
    separation, parts, names = joint_separation(recovery), [], path_names(recovery)
    satisfied = [_PLURAL[one.axis] for one in separation if one.satisfied]
    for one in separation:
        between = f" ({' and '.join(names[path] for path in one.nearest)})" if one.nearest else ""
        least, needed = _apart(one, recovery)
        apart = f"{least}{between}" if one.nearest else "no two"
        comparison = f"not more than {needed}" if satisfied and not one.satisfied else f"more than {needed} is enough"
        parts.append(f"{_PLURAL[one.axis]} {apart} apart, {comparison}")
    if not parts:
        return "joint separation (Monsalve et al. 2022): not defined for these samples"
    verdict = f"satisfied by the {' and '.join(satisfied)}" if satisfied else "not satisfied"
    found = "of the points that were found; two closer than a resolution cell may appear as one"
    return f"joint separation (Monsalve et al. 2022): {verdict}: {'; '.join(parts)} ({found})"


def resolution_line(recovery: Recovery) -> str:
    """Resolution cells and unambiguous intervals of range and velocity of all sources; empty without units."""
    units, (_, pulses, frequencies) = recovery.problem.units, recovery.problem.shape
    if units is None or frequencies == 1:
        return ""
    parts: dict[str, list[str]] = {}
    for one in recovery.sources:
        metres = float(units.physical(np.array(1.0), 0, one.name))
        spans = [(f"{metres / frequencies:.3g} m", f"to {metres:.4g} m")]
        if pulses > 1 and units.carrier_hz is not None:
            speed = float(units.physical(np.array(1.0), 1, one.name))
            spans.append((f"{speed / pulses:.3g} m/s", f"±{speed / 2:.4g} m/s"))
        elif pulses > 1:
            spans.append((f"{units.doppler_hz / pulses / 1e3:.3g} kHz", f"±{units.doppler_hz / 2e3:.4g} kHz"))
        cells, ends = (", ".join(column) for column in zip(*spans, strict=True))
        parts.setdefault(f"{cells}, unambiguous {ends}", []).append(one.name)
    return "resolution: " + "; ".join(f"{' and '.join(names)} {said}" for said, names in parts.items())


def _apart(separation: Separation, recovery: Recovery) -> tuple[str, str]:
    """The least distance and the one that is needed: of one source in metres or metres a second, else as they are in
    time and frequency, or normalised without units.
    """
    units, sources = recovery.problem.units, {name for name, _ in separation.nearest}
    scale, unit, axis = 1.0, "", AXES.index(separation.axis)
    if units is not None and len(sources) == 1 and (axis == 0 or units.carrier_hz is not None):
        scale = float(units.physical(np.array(1.0), axis, sources.pop()))
        unit = " m" if axis == 0 else " m/s"
    elif units is not None:
        scale, unit = (units.delay_s * 1e6, " µs") if axis == 0 else (units.doppler_hz / 1e3, " kHz")
    return f"{separation.least * scale:.3g}{unit}", f"{separation.needed * scale:.3g}{unit}"


def recovery_lines(recovery: Recovery, markdown: bool = False, file: str = "") -> list[str]:
    """A table for every source, as Markdown if asked for, the flags (first in doubt), and what cannot be known.

    In doubt, only the strongest few paths are there, and the ``file`` that has them all; the doubt is repeated last.
    """
    rows = path_rows(recovery)
    tables = _tables(recovery, rows, markdown, file)
    verdict = _verdict(recovery)
    lines = [verdict, "", *tables] if recovery.doubt else [*tables, verdict]
    separated = separation_line(recovery)
    if any(map(len, recovery)):
        lines += [line for line in (resolution_line(recovery), separated) if line]
    if recovery.problem.truth is not None:
        lines.append(_against_truth(recovery.score()))
    lines += [f"note: {note}" for note in recovery.notes if note != separated]
    return [*lines, f"found: {_found(recovery)}"] if recovery.doubt and len(rows) > _MOST_IN_DOUBT else lines


def _tables(recovery: Recovery, rows: list[dict[str, Any]], markdown: bool, file: str) -> list[str]:
    """The paths of every source, in doubt the strongest, each with an empty line after it."""
    lines: list[str] = []
    for source in recovery.sources:
        mine = [row for row in rows if row["source"] == source.name]
        shown = _strongest(mine) if recovery.doubt else mine
        lines += _source_lines(source, shown, len(mine), recovery.problem, markdown)
        if len(shown) < len(mine):
            lines += ["", f"  and {len(mine) - len(shown)} weaker ones{f' (all in {file})' if file else ''}"]
        lines.append("")
    return lines


def _verdict(recovery: Recovery) -> str:
    """What was recovered, how exactly, and how long it took, in one line."""
    noise = "none" if recovery.sigma == 0 else f"{recovery.sigma:.3g}"
    return (
        f"found: {_found(recovery)} · exact fit: {'yes' if recovery.exact else 'no'} · "
        f"certificate: {recovery.certificate_status} · unexplained {recovery.unexplained:.2%} · "
        f"noise {noise} · {recovery.seconds:.2f} s"
    )


def _against_truth(score: Score) -> str:
    """How the recovery compares with the truth, in one line."""
    error = f"largest error {score.max_error:.2g} in normalised coordinates, 0 to 1"
    error = error if np.isfinite(score.max_error) else "wrong number of paths"
    return f"against the truth: {'success' if score.success else 'no success'} ({error})"


def _strongest(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The few rows of the largest gains, in their order."""
    order = sorted(rows, key=lambda row: -abs(complex(row["gain_real"], row["gain_imag"])))
    strongest = [row["name"] for row in order[:_MOST_IN_DOUBT]]
    return [row for row in rows if row["name"] in strongest]


def _found(recovery: Recovery) -> str:
    """Whether there are paths, and why they do not count."""
    if recovery.found:
        return "yes"
    return "no" if not any(map(len, recovery)) else f"no, {recovery.doubt}"


def _source_lines(
    source: Channel, mine: list[dict[str, Any]], count: int, problem: Problem, markdown: bool
) -> list[str]:
    """Some of a source's targets or paths in physical units where there are any, normalised without."""
    if not mine:
        return [f"{source.name}: no paths"]
    shown = [_cells(row, problem, source.relative_doppler) for row in mine]
    if any(row["not_resolved_from"] for row in mine):
        shown = [
            cells | {"not resolved from": row["not_resolved_from"]} for cells, row in zip(shown, mine, strict=True)
        ]
    table = [tuple(shown[0]), *(tuple(cells.values()) for cells in shown)]
    title = f"{source.name}: {count} path{'s' if count > 1 else ''}"
    if problem.units is not None:
        title += ", there and back" if is_radar(source.name) else ", one way"
    if markdown:
        table.insert(1, ("---",) * len(table[0]))
        return [title, "", *(f"| {' | '.join(cells)} |" for cells in table)]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = ["  ".join(f"{one:>{width}}" for one, width in zip(cells, widths, strict=True)) for cells in table]
    return [title, *(f"  {line}" for line in lines)]


def _cells(row: dict[str, Any], problem: Problem, relative: bool) -> dict[str, str]:
    """What a table says of a path, by headings."""
    cells = {"": row["name"]}
    for name, heading, scale, digits in _NORMALISED if problem.units is None else _PHYSICAL:
        if (value := row[name]) is not None:
            bound, moves = row[f"{name}_std"], name in ("doppler", "doppler_hz", "velocity_m_s")
            quantity, comma, unit = heading.partition(",")
            form = ".1e" if problem.units is None else "#.2g"
            spread = "" if bound is None else f" ± {bound * scale:{form}}".rstrip(".")
            shown = f"{value * scale:.{max(digits, _decimals(bound and bound * scale))}f}{spread}"
            cells[quantity + " (relative)" * (relative and moves) + comma + unit] = shown
    gain = complex(row["gain_real"], row["gain_imag"])
    power = "" if row["power_db"] is None else f"{row['power_db']:.2f}"
    return cells | {"gain": f"{abs(gain):.3g} ∠ {np.rad2deg(np.angle(gain)):.0f}°", "power, dB": power}


def _decimals(deviation: float | None) -> int:
    """Of a number whose standard deviation has two significant digits; 0 where there is none."""
    if not deviation or not np.isfinite(deviation):
        return 0
    return min(1 - int(np.floor(np.log10(deviation))), _MOST_DECIMALS)
