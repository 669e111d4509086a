"""A recovery in numbers, in words, and as the arrays of a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.dbd.atoms import Atoms, Polynomial
from tmca.dbd.channel import Channel
from tmca.dbd.model import AXES, Problem, Real, Units, centred, from_zero, is_radar

if TYPE_CHECKING:
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
        error = _finite(score.max_error)
        values["score"] = {"success": score.success, "tolerance": score.tolerance, "max_error": error}
        values["score"]["waveform_correlation"] = {one.name: one.waveform_correlation for one in score.sources}
    return values


def _source_values(source: Channel, problem: Problem) -> list[dict[str, Any]]:
    rows = []
    for index, gain in enumerate(source.amplitudes):
        row: dict[str, Any] = {"gain": abs(gain), "phase_rad": float(np.angle(gain))}
        for name, (value, bound) in (_coordinates(source, index) | _quantities(source, index, problem)).items():
            row[name] = _finite(value)
            if bound is not None:
                row[f"{name}_bound"] = _finite(bound)
        rows.append(row)
    return rows


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _coordinates(source: Channel, index: int) -> dict[str, tuple[float, float | None]]:
    """Normalised delay, Doppler and angle of a path with their deviations."""
    bounds = [None] * len(AXES) if source.bounds is None else source.bounds[index]
    return dict(zip(AXES, zip(source.points[index], bounds, strict=True), strict=True))


def _quantities(source: Channel, index: int, problem: Problem) -> dict[str, tuple[float, float | None]]:
    """Range or length, velocity and angle of a path with their deviations, where there are units."""
    units, quantities = problem.units, {}
    if units is None:
        return {}
    names = ("range_m" if is_radar(source.name) else "length_m", "velocity_m_s", "angle_deg")
    for axis, (coordinate, bound) in enumerate(_coordinates(source, index).values()):
        value = np.asarray(coordinate)
        value = from_zero(value, problem.shape[2]) if axis == 0 else centred(value)
        if np.isfinite(value):
            spread = None if bound is None else float(units.deviation(value, np.asarray(bound), axis, source.name))
            quantities[names[axis]] = (float(units.physical(value, axis, source.name)), spread)
    return quantities


def recovery_lines(recovery: Recovery) -> list[str]:
    """A table for every source, the flags, and what cannot be known."""
    lines = []
    for source in recovery.sources:
        lines += [*_source_lines(source, recovery.problem), ""]
    noise = "none" if recovery.sigma == 0 else f"{recovery.sigma:.3g}"
    lines.append(
        f"found: {'yes' if recovery.found else 'no'} · exact fit: {'yes' if recovery.exact else 'no'} · "
        f"certificate: {recovery.certificate_status} · residual {recovery.residual:.2g} · noise {noise} · "
        f"{recovery.seconds:.2f} s"
    )
    if recovery.problem.truth is not None:
        score = recovery.score()
        wrong = not np.isfinite(score.max_error)
        error = "wrong number of paths" if wrong else f"largest error {score.max_error:.2g}"
        lines.append(f"against the truth: {'success' if score.success else 'no success'} ({error})")
    return [*lines, *(f"note: {note}" for note in recovery.notes)]


def _source_lines(source: Channel, problem: Problem) -> list[str]:
    """In physical units where there are any, normalised without."""
    if not len(source):
        return [f"{source.name}: no paths"]
    rows, relative = [], " (relative)" if source.relative_doppler else ""
    digits, spread = (6, ".1e") if problem.units is None else (2, ".2g")
    for index in map(int, np.argsort(source.points[:, 0])):
        cells = {}
        for name, (value, bound) in (_quantities(source, index, problem) or _coordinates(source, index)).items():
            quantity, _, unit = name.partition("_")
            heading = quantity + relative * (quantity in ("doppler", "velocity")) + f", {_UNITS.get(unit)}" * bool(unit)
            if np.isfinite(value):
                cells[heading] = f"{value:.{digits}f}" + ("" if bound is None else f" ± {bound:{spread}}")
        rows.append(cells | {"gain": f"{abs(source.amplitudes[index]):.3g}"})
    lines = ["  ".join(f"{one:>22}" for one in cells) for cells in (rows[0], *(row.values() for row in rows))]
    return [f"{source.name}: {len(source)} path{'s' if len(source) > 1 else ''}", *lines]


def planes(recovery: Recovery) -> list[dict[str, Any]]:
    """What :class:`tmca.plots.dbd.Plane` shows of every source: ``‖f‖ / weight``, the estimate, the truth if known.

    Over delay and Doppler; ``block`` messages, whose polynomial does not depend on the Doppler, over the delay alone;
    with several antennas at the angle of the strongest path.
    """
    return [_plane(recovery, index) for index in range(len(recovery.sources))]


def _plane(recovery: Recovery, index: int) -> dict[str, Any]:
    problem, channel = recovery.problem, recovery.sources[index]
    atoms, units = Atoms(problem.sources[index], problem.shape), problem.units
    norms = Polynomial(atoms, recovery.q).levels_on_grid(_OVERSAMPLING)
    title = f"{channel.name}: norm of the dual polynomial"
    if "angle" in atoms.axes and len(channel):
        angle = channel.points[channel.strongest, 2]
        norms = norms[..., round(angle * norms.shape[-1]) % norms.shape[-1]]
        title += f" at the angle {angle:.3f}"
    if recovery.sigma == 0 and not recovery.certified:
        title += ", no certificate"
    axes = atoms.columns[: norms.ndim]
    if norms.ndim == 2:
        norms = np.roll(norms, norms.shape[1] // 2, axis=1)
    starts = [-0.5 if place else 0.0 for place in range(norms.ndim)]
    ranges = [start + np.arange(size + 1) / size for start, size in zip(starts, norms.shape, strict=True)]

    def places(points: Real) -> Real:
        """``(n, 1 or 2)``; Dopplers over a delay are of −½ to ½."""
        columns = [points[:, axes[0]], *(np.nan_to_num(centred(points[:, axis])) for axis in axes[1:])]
        scaled = (_labelled(one, axis, channel.name, units)[0] for one, axis in zip(columns, axes, strict=True))
        return np.stack(list(scaled), axis=-1)

    shown = [_labelled(one, axis, channel.name, units) for one, axis in zip(ranges, axes, strict=True)]
    return {
        "title": title,
        "norms": norms,
        "edges": [edges for edges, _ in shown],
        "labels": [label for _, label in shown],
        "estimate": places(channel.points),
        "truth": None if problem.truth is None else places(problem.truth[index].points),
    }


def _labelled(values: Real, axis: int, name: str, units: Units | None) -> tuple[Real, str]:
    """Coordinates in a picture's units, and what its axis is called."""
    if units is None or axis == 2:
        return values, ("normalised delay", "normalised Doppler", "normalised angle")[axis]
    labels = ("range, m" if is_radar(name) else "path length, m", "radial velocity, m/s")
    return units.physical(values, axis, name), labels[axis]
