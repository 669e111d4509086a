"""Targets and paths by their names: one row each, with units, as plain numbers, a data frame or labelled arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.dbd.channel import Channel
from tmca.dbd.model import AXES, Problem, Real, Units, centred, distance, from_zero, is_radar, matched

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from tmca.dbd.recovery import Recovery

_SHARED = {
    "delay": ("1", "delay over the useful time of an interval"),
    "doppler": ("1", "Doppler over the pulse repetition frequency"),
    "angle": ("1", "antenna spacing in wavelengths times the sine of the angle"),
    "delay_s": ("s", "delay"),
    "doppler_hz": ("Hz", "Doppler"),
    "range_m": ("m", "range of a target"),
    "length_m": ("m", "length of a path"),
    "velocity_m_s": ("m/s", "radial velocity, positive away"),
    "angle_deg": ("degree", "angle from broadside"),
    "delay_doppler_correlation": ("1", "correlation of the errors of delay and Doppler"),
    "gain_real": ("", "real part of the gain"),
    "gain_imag": ("", "imaginary part of the gain"),
    "power_db": ("dB", "power, 20 log10 of the gain"),
}
"""Unit and meaning of every number of a path."""
_TENTH = 0.1
"""Resolution cells of range walk that are said."""
_WITHOUT_STD = ("delay_doppler_correlation", "gain_real", "gain_imag", "power_db")
WORDS = ("name", "role", "source", "relative_doppler", "not_resolved_from")


def path_rows(recovery: Recovery) -> list[dict[str, Any]]:
    """A row for every target and path, the nearest of each source first.

    ``name`` is such as ``target 1`` or ``path 2`` (with the source where several have targets or paths), ``role`` is
    ``radar`` or ``communications``. Numbers that have a Cramér–Rao bound at the estimated noise have a column more,
    ``…_std``, one standard deviation. What does not apply is None. ``not_resolved_from`` names a stronger path of the
    same source within a resolution cell, from which it is no farther than their standard deviation; else it is empty.
    """
    names, rows = path_names(recovery), []
    for channel, correlations in zip(recovery, _correlations(recovery), strict=True):
        for index in map(int, np.argsort(channel.points[:, 0])):
            row: dict[str, Any] = {"name": names[channel.name, index], "role": _role(channel), "source": channel.name}
            other = unresolved_from(channel, index)
            row |= {"relative_doppler": channel.relative_doppler}
            row["not_resolved_from"] = "" if other is None else names[channel.name, other]
            row |= _numbers(channel, index, recovery)
            row["delay_doppler_correlation"] = finite(correlations[index])
            rows.append(row)
    return rows


def _correlations(recovery: Recovery) -> list[Real]:
    """Per source ``(n,)``, of the errors of delay and Doppler at the Cramér–Rao bound; NaN where it is not known."""
    from tmca.dbd.noise import covariances

    nothing = [np.full(len(channel), np.nan) for channel in recovery]
    if not recovery.sigma or not any(map(len, recovery)):
        return nothing
    every = []
    for channel, covariance, unknown in zip(
        recovery, covariances(recovery.sources, recovery.sigma), nothing, strict=True
    ):
        if channel.atoms.columns[:2] != [0, 1]:
            every.append(unknown)
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            every.append(covariance[:, 0, 1] / np.sqrt(covariance[:, 0, 0] * covariance[:, 1, 1]))
    return every


def walk_line(recovery: Recovery) -> str:
    """That targets or paths walk through the ranges during the pulses, which the model leaves out; empty if not so.

    It is said from a tenth of a resolution cell on, and from one standard deviation.
    """
    units, (_, pulses, frequencies) = recovery.problem.units, recovery.problem.shape
    if units is None or units.carrier_hz is None:
        return ""
    names, moved = path_names(recovery), []
    for channel in recovery:
        walks = range_walk(channel.points, units, pulses)
        for index, walk in enumerate(walks):
            deviation = np.nan if channel.bounds is None else channel.bounds[index, 0]
            if walk > _TENTH / frequencies or walk > deviation:
                metres = float(units.physical(walk, 0, channel.name))
                moved.append((walk * frequencies, f"{names[channel.name, index]} by {metres:.2g} m"))
    if not moved:
        return ""
    cells, which = max(moved)
    return (
        f"{len(moved)} of {len(names)} paths move during the pulses, {which}, {cells:.2g} of a resolution cell: "
        "the model leaves this range walk out; ranges are those in the middle of the pulses"
    )


def range_walk(points: Real, units: Units, pulses: int) -> Real:
    """``(n,)``, by how much the normalised delays of ``(n, 3)`` points change from the first pulse to the last.

    The delay grows by Doppler over carrier frequency times the time; 0 where Doppler or carrier are not known.
    """
    turns = np.nan_to_num(centred(points[:, 1])) * (pulses - 1)
    return np.abs(turns) / (units.delay_s * (units.carrier_hz or np.inf))


def path_names(recovery: Recovery) -> dict[tuple[str, int], str]:
    """Names by source and index: targets and paths are counted from 1, from the least delay on.

    Those that match one with a name in the truth have that name.
    """
    roles, names = [_role(one) for one in recovery], {}
    for channel in recovery:
        word = "target" if is_radar(channel.name) else "path"
        of = f"{channel.name} " if roles.count(_role(channel)) > 1 else ""
        for number, index in enumerate(map(int, np.argsort(channel.points[:, 0])), start=1):
            names[channel.name, index] = f"{of}{word} {number}"
    return names | _true_names(recovery)


def _true_names(recovery: Recovery) -> dict[tuple[str, int], str]:
    """The truth's names of those that are within a resolution cell of one, by source and index."""
    names: dict[tuple[str, int], str] = {}
    for channel, truth in zip(recovery, recovery.problem.truth or (), strict=False):
        if not any(truth.names) or not len(channel) or channel.relative_doppler:
            continue
        here, there = matched(channel.positions, channel.atoms.seen(truth.points))
        apart = distance(channel.positions[here], channel.atoms.seen(truth.points)[there]) * channel.atoms.counts
        for index, true, cells in zip(here, there, apart, strict=True):
            if truth.names[true] and np.all(cells < 1) and truth.names[true] not in names.values():
                names[channel.name, int(index)] = truth.names[true]
    return names


def unresolved_from(channel: Channel, index: int) -> int | None:
    """The strongest path within a resolution cell of a weaker one whose distance is within the deviation of both."""
    if channel.bounds is None or not len(channel):
        return None
    bounds = np.nan_to_num(channel.bounds[:, channel.atoms.columns], nan=np.inf)
    apart = distance(channel.positions, channel.positions[index])
    within = np.max(apart * channel.atoms.counts, axis=1) < 1
    strengths = np.abs(channel.amplitudes)
    near = within & np.all(apart <= np.hypot(bounds, bounds[index]), axis=1) & (strengths > strengths[index])
    return int(np.argmax(np.where(near, strengths, -1))) if near.any() else None


def _role(channel: Channel) -> str:
    return "radar" if is_radar(channel.name) else "communications"


def _numbers(channel: Channel, index: int, recovery: Recovery) -> dict[str, float | None]:
    found = coordinates(channel, index) | quantities(channel, index, recovery.problem)
    gain = complex(channel.amplitudes[index])
    with np.errstate(divide="ignore"):
        power = float(20 * np.log10(abs(gain)))
    found |= {"gain_real": (gain.real, None), "gain_imag": (gain.imag, None), "power_db": (power, None)}
    numbers: dict[str, float | None] = {}
    for name in _SHARED:
        value, bound = found.get(name, (np.nan, None))
        numbers[name] = finite(value)
        if name not in _WITHOUT_STD:
            numbers[f"{name}_std"] = None if bound is None or numbers[name] is None else finite(bound)
    return numbers


def finite(value: float) -> float | None:
    """A plain number, None for NaN and infinity."""
    return float(value) if np.isfinite(value) else None


def coordinates(source: Channel, index: int) -> dict[str, tuple[float, float | None]]:
    """Normalised delay, Doppler and angle of a path with their deviations."""
    bounds = [None] * len(AXES) if source.bounds is None else source.bounds[index]
    return dict(zip(AXES, zip(source.points[index], bounds, strict=True), strict=True))


def quantities(source: Channel, index: int, problem: Problem) -> dict[str, tuple[float, float | None]]:
    """Delay, Doppler, range or length, velocity and angle of a path with their deviations, where there are units."""
    units, found = problem.units, {}
    if units is None:
        return {}
    names = ("range_m" if is_radar(source.name) else "length_m", "velocity_m_s", "angle_deg")
    scales = {0: ("delay_s", units.delay_s), 1: ("doppler_hz", units.doppler_hz)}
    for axis, (coordinate, bound) in enumerate(coordinates(source, index).values()):
        value: Real = np.asarray(coordinate)
        value = from_zero(value, problem.shape[2]) if axis == 0 else centred(value)
        if not np.isfinite(value):
            continue
        if axis in scales:
            name, scale = scales[axis]
            found[name] = (float(value) * scale, None if bound is None else float(bound) * scale)
        if axis != 1 or units.carrier_hz is not None:
            spread = None if bound is None else float(units.deviation(value, np.asarray(bound), axis, source.name))
            found[names[axis]] = (float(units.physical(value, axis, source.name)), spread)
    return found


def path_frame(recovery: Recovery) -> pd.DataFrame:
    """:func:`path_rows` as a data frame; columns of numbers that apply to no path are left out."""
    import pandas as pd

    rows = path_rows(recovery)
    frame = pd.DataFrame(rows, columns=list(rows[0]) if rows else [*WORDS, *_SHARED])
    numbers = [name for name in frame if name not in WORDS]
    frame[numbers] = frame[numbers].astype(float)
    nothing = [name for name in numbers if rows and frame[name].isna().all()]
    return frame.drop(columns=nothing if frame["not_resolved_from"].any() else [*nothing, "not_resolved_from"])


def path_dataset(recovery: Recovery) -> xr.Dataset:
    """:func:`path_rows` along one dimension ``path``, with units, and what was said of the recovery as attributes."""
    import xarray as xr

    frame = path_frame(recovery)
    words = {name: ("path", frame[name].to_numpy()) for name in WORDS if name != "name" and name in frame}
    variables = {}
    for name in (one for one in frame if one not in WORDS):
        unit, meaning = _SHARED[name.removesuffix("_std")]
        about = {"units": unit, "long_name": meaning + ", standard deviation" * name.endswith("_std")}
        variables[name] = ("path", frame[name].to_numpy(), about)
    about = {
        "method": recovery.method, "found": int(recovery.found), "exact": int(recovery.exact),
        "certificate": recovery.certificate_status, "unexplained": recovery.unexplained, "notes": list(recovery.notes),
    }  # fmt: skip
    if recovery.sigma is not None:
        about["sigma"] = recovery.sigma
    return xr.Dataset(variables, {"path": frame["name"].to_numpy(), **words}, about)


def path_csv(recovery: Recovery) -> str:
    """:func:`path_frame` as comma-separated values with a line of names."""
    return str(path_frame(recovery).to_csv(index=False))
