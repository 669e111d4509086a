"""Delay-Doppler planes: the matched filter of the estimated waveform, and the norm of the dual polynomial."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tmca.dbd.atoms import Atoms, Polynomial
from tmca.dbd.channel import Channel
from tmca.dbd.model import AXES, LIGHT_M_S, Real, Units, centred, is_radar
from tmca.dbd.noise import covariances
from tmca.errors import SettingError, check_choice

if TYPE_CHECKING:
    import xarray as xr

    from tmca.dbd.recovery import Recovery

AXES_OF_PLANES = ("auto", "range", "time", "normalised")
"""Metres and metres a second, microseconds and kilohertz, or neither; ``auto`` is the first that the units allow."""
_OVERSAMPLING, _POINTS = 12, 600
"""Points of a resolution cell, and about the most along an axis."""


class _Scale(NamedTuple):
    """From a normalised coordinate to that of a picture."""

    factor: float
    label: str


def delay_doppler_planes(recovery: Recovery) -> dict[str, xr.Dataset]:
    """Of every source both planes, with delay and Doppler as coordinates.

    ``matched_filter``: the gain a single path of the estimated waveform would have at each place, ``|Σ conj(s) y
    exp(+j2π(n τ + p ν))| / Σ |s|²``; without paths, of no known waveform, in units of its highest value.
    ``dual_polynomial``: ``‖f‖ / weight``, without noise at most one, and one at the paths; in noise it peaks there.
    Over the delay alone for ``block`` messages, whose polynomial does not depend on the Doppler.

    Dimensions are ``delay`` (0 to 1) and ``doppler`` (−½ to ½), normalised; where the problem has units, the
    coordinates ``delay_s``, ``doppler_hz`` and, with a carrier, ``range_m`` or ``length_m`` and ``velocity_m_s`` lie
    along them. With several antennas the planes are those at the angle of the strongest path.
    """
    import xarray as xr

    planes = {}
    for index, channel in enumerate(recovery):
        variables: dict[str, Any] = {}
        coordinates: dict[str, Any] = {}
        for name, (values, axes) in (("matched_filter", matched_filter(recovery, index)),
                                     ("dual_polynomial", dual_polynomial(recovery, index))):  # fmt: skip
            dims = [AXES[axis] for axis in axes]
            variables[name] = (dims, values)
            places = [_places(size, axis) for size, axis in zip(values.shape, axes, strict=True)]
            coordinates |= dict(zip(dims, places, strict=True))
        units = recovery.problem.units
        for name, (dim, factor) in ({} if units is None else _along(units, channel.name)).items():
            if dim in coordinates:
                coordinates[name] = (dim, coordinates[dim] * factor)
        planes[channel.name] = xr.Dataset(variables, coordinates, {"unexplained": recovery.unexplained})
    return planes


def _places(size: int, axis: int) -> Real:
    return np.arange(size) / size - (0.5 if axis else 0.0)


def _along(units: Units, name: str) -> dict[str, tuple[str, float]]:
    distance = "range_m" if is_radar(name) else "length_m"
    along = {"delay_s": ("delay", units.delay_s), "doppler_hz": ("doppler", units.doppler_hz)}
    one = np.array(1.0)
    along[distance] = ("delay", float(units.physical(one, 0, name)))
    if units.carrier_hz is not None:
        along["velocity_m_s"] = ("doppler", float(units.physical(one, 1, name)))
    return along


def dual_polynomial(recovery: Recovery, index: int) -> tuple[Real, list[int]]:
    """The norms as shares of their bound on a grid, Dopplers from −½ on, and which axes they are over."""
    atoms = Atoms(recovery.problem.sources[index], recovery.problem.shape)
    return _on_grid(Polynomial(atoms, recovery.q), recovery.sources[index])


def matched_filter(recovery: Recovery, index: int) -> tuple[Real, list[int]]:
    """The matched filter of the estimated waveform on a grid, and which axes it is over."""
    problem, channel = recovery.problem, recovery.sources[index]
    source = problem.sources[index]
    if not len(channel) or not np.any(channel.waveform):
        values, axes = _on_grid(Polynomial(Atoms(source, problem.shape), problem.y), channel)
        return values / max(float(values.max()), 1e-300), axes
    sent = source.with_signal(channel.waveform)
    energy = float(np.sum(np.abs(sent.rows) ** 2)) * problem.shape[0]
    values, axes = _on_grid(Polynomial(Atoms(sent, problem.shape), problem.y), channel)
    return values * (sent.weight / energy), axes


def _on_grid(polynomial: Polynomial, channel: Channel) -> tuple[Real, list[int]]:
    atoms = polynomial.atoms
    finest = int(np.clip(_POINTS // atoms.counts.max(), 2, _OVERSAMPLING))
    norms = polynomial.levels_on_grid(finest)
    if "angle" in atoms.axes and norms.ndim > 1:
        angle = channel.points[channel.strongest, 2] if len(channel) else 0.0
        norms = norms[..., round(angle * norms.shape[-1]) % norms.shape[-1]]
    axes = atoms.columns[: norms.ndim]
    for place in (place for place, axis in enumerate(axes) if axis):
        norms = np.roll(norms, norms.shape[place] // 2, axis=place)
    return norms, axes


def planes(recovery: Recovery, axes: str = "auto") -> list[dict[str, Any]]:
    """What :class:`tmca.plots.dbd.Plane` shows of every source: both planes, the estimate, the truth if known.

    Where the polynomial is over the delay alone, the matched filter is the highest of all Dopplers.

    Args:
        recovery: to be shown.
        axes: one of ``AXES_OF_PLANES``.

    Raises:
        SettingError: axes that the units of the problem do not allow.
    """
    check_axes(axes, recovery.problem.units)
    spreads: list[Any] = [None] * len(recovery.sources)
    if recovery.sigma and any(map(len, recovery)):
        spreads = covariances(recovery.sources, recovery.sigma)
    return [_plane(recovery, index, axes, spread) for index, spread in enumerate(spreads)]


def _plane(recovery: Recovery, index: int, asked: str, spread: Real | None) -> dict[str, Any]:
    problem, channel = recovery.problem, recovery.sources[index]
    norms, axes = dual_polynomial(recovery, index)
    matched, over = matched_filter(recovery, index)
    scales = {axis: _scale(axis, channel.name, problem.units, asked) for axis in axes}
    truth = None if problem.truth is None else problem.truth[index]
    return {
        "title": _title(recovery, channel),
        "norms": norms,
        "edges": _edges(norms, scales),
        "labels": [one.label for one in scales.values()],
        "estimate": _drawn(channel.points, scales),
        "truth": None if truth is None else _drawn(truth.points, scales),
        "names": () if truth is None else truth.names,
        "matched": matched if over == axes else matched.max(axis=1),
        "covariances": _scaled(spread, channel, scales),
    }


def _title(recovery: Recovery, channel: Channel) -> str:
    """Of the planes of a source."""
    title = f"{channel.name}: norm of the dual polynomial"
    if "angle" in channel.atoms.axes and len(channel):
        title += f" at the angle {channel.points[channel.strongest, 2]:.3f}"
    return f"{title}, no certificate" if recovery.sigma == 0 and not recovery.certified else title


def _edges(values: Real, scales: dict[int, _Scale]) -> list[Real]:
    """Of the pixels of a picture, along each axis."""
    pairs = zip(values.shape, scales.items(), strict=True)
    return [one.factor * np.append(_places(size, axis), 0.5 if axis else 1.0) for size, (axis, one) in pairs]


def _drawn(points: Real, scales: dict[int, _Scale]) -> Real:
    """``(n, 1 or 2)`` in units of the picture; Dopplers are of −½ to ½."""
    values = [points[:, axis] if axis == 0 else np.nan_to_num(centred(points[:, axis])) for axis in scales]
    return np.stack([value * one.factor for value, one in zip(values, scales.values(), strict=True)], axis=-1)


def _scaled(spread: Real | None, channel: Channel, scales: dict[int, _Scale]) -> Real | None:
    """Covariances of the coordinates of a picture, ``(n, 2, 2)``; None without."""
    if spread is None or len(scales) != 2 or not len(channel):
        return None
    places = [channel.atoms.columns.index(axis) for axis in scales]
    factors = np.array([one.factor for one in scales.values()])
    return spread[:, places][:, :, places] * np.outer(factors, factors)


def _scale(axis: int, name: str, units: Units | None, asked: str) -> _Scale:
    """Of one axis of a picture, and what it is called."""
    if units is None or asked == "normalised":
        return _Scale(1.0, ("normalised delay", "normalised Doppler", "normalised angle")[axis])
    if axis == 2:
        return _Scale(1.0, "normalised angle")
    if asked == "time" or (axis == 1 and units.carrier_hz is None):
        return _Scale(units.delay_s * 1e6, "delay, µs") if axis == 0 else _Scale(units.doppler_hz / 1e3, "Doppler, kHz")
    trips = 2.0 if is_radar(name) else 1.0
    if axis == 0:
        return _Scale(units.delay_s * LIGHT_M_S / trips, "range, m" if trips > 1 else "path length, m")
    return _Scale(float(units.physical(np.array(1.0), 1, name)), "radial velocity, m/s")


def check_axes(asked: str, units: Units | None) -> None:
    """Raises SettingError for axes that do not exist or that units do not allow."""
    check_choice("axes", asked, AXES_OF_PLANES)
    needs = {"time": "delay_s and doppler_hz", "range": "delay_s, doppler_hz and carrier_hz"}.get(asked)
    if needs and (units is None or (asked == "range" and units.carrier_hz is None)):
        raise SettingError("axes", asked, f"a problem with {needs}", "take auto")
