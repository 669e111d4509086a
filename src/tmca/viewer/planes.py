"""Delay-Doppler planes of a recovery of `tmca dbd`: the matched filter and the dual polynomial of every source."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data import Contents, Stored
from tmca.viewer.cubes import ONE, said
from tmca.viewer.items import Item, Layer, in_memory

_KIND = "dual blind deconvolution: recovery"
_LAYERS = {
    "matched_filter": ("matched", "matched filter, below its peak"),
    "dual_polynomial": ("polynomial", "‖f‖ / weight of the dual polynomial"),
}
_MOST, _FLOOR = 20, -30.0
"""Sources that are looked for; decibels below the peak where a matched filter is darkest."""
_AXES = {
    "x": (
        ("range_m", "range (m)"),
        ("length_m", "length (m)"),
        ("delay_s", "delay (s)"),
        ("delay", "normalised delay"),
    ),
    "y": (("velocity_m_s", "velocity (m/s)"), ("doppler_hz", "Doppler (Hz)"), ("doppler", "normalised Doppler")),
}
"""What columns and rows are, the first that the file has."""
_MOST_POINTS, _LONGEST = 1000, 300
"""Paths that are marked; characters of a doubt."""
_UNITS = {"range_m": "m", "length_m": "m", "velocity_m_s": "m/s", "delay_s": "s", "doppler_hz": "Hz"}


def holds_planes(contents: Contents) -> bool:
    """Whether a file is a recovery with planes."""
    return contents.attrs.get("kind") == _KIND and any(f"{name}_0" in contents.arrays for name in _LAYERS)


def plane_items(contents: Contents, title: str, **about: Any) -> list[Item]:
    """An item for every source: rows are Dopplers, the highest above; columns are delays."""
    items = []
    for number in range(_MOST):
        stored = {name: contents.arrays.get(f"{name}_{number}") for name in _LAYERS}
        found = {name: one for name, one in stored.items() if one is not None and len(one.shape) in (1, 2) and one.size}
        if not found:
            break
        first = next(iter(found.values()))
        source = str(first.attrs.get("source") or f"source {number + 1}")[:60]
        rows = max(one.shape[1] if len(one.shape) > 1 else 1 for one in found.values())
        view = _view(list(found.values()), contents.arrays.get(f"points_{number}"))
        layers = tuple(_layer(name, one, rows, view) for name, one in found.items())
        facts = {"source": source, **_axes(first), **said(contents.attrs), **_doubt(contents)}
        items.append(Item("array", f"{title}: {source}", layers, facts, **about))
    return items


def _layer(name: str, stored: Stored, rows: int, view: dict[str, Any]) -> Layer:
    """Of so many rows; what is the same for all Dopplers is repeated. Matched filters are in decibels."""
    values: NDArray[Any] = np.atleast_2d(np.asarray(stored.whole(), np.float32).T)[::-1]
    values = np.broadcast_to(values, (max(rows, len(values)), values.shape[1]))
    size = values.shape[0], values.shape[1]
    highest = max(1e-30, float(np.nanmax(values, initial=0.0)))
    span, unit = (0.0, highest), ""
    if name == "matched_filter":
        values, span, unit = 20 * np.log10(np.maximum(values / np.float32(highest), 1e-10)), (_FLOOR, 0.0), "dB"
    return Layer(*_LAYERS[name], size, ONE, in_memory(values[None]), unit=unit, span=span, view=view)


def _view(planes: Sequence[Stored], points: Stored | None) -> dict[str, Any]:
    """What columns and rows are, from the highest Doppler down, and the paths as shares of both."""
    extents: dict[str, list[float]] = {}
    labels: dict[str, str] = {}
    for axis, names in _AXES.items():
        for name, label in names:
            found = next((one for one in (_extent(plane, name) for plane in planes) if one), None)
            if found and axis not in extents:
                extents[axis], labels[f"{axis}label"] = found if axis == "x" else found[::-1], label
    if len(extents) < len(_AXES):
        return {}
    return {"extents": extents, **labels, "points": _shares(points)}


def _shares(points: Stored | None) -> list[list[float]]:
    """Where paths are on the picture, across and down, 0 to 1."""
    if points is None or len(points.shape) != 2 or points.shape[1] < 2 or points.shape[0] > _MOST_POINTS:
        return []
    values = np.asarray(points.whole(), float)[:, :2]
    values = values[np.all(np.isfinite(values), axis=1)]
    return [[float(delay % 1), float((0.5 - doppler) % 1)] for delay, doppler in values]


def _extent(stored: Stored, name: str) -> list[float] | None:
    extent = np.ravel(stored.attrs.get(name, ()))
    good = extent.size == 2 and extent.dtype.kind in "fiu" and np.all(np.isfinite(extent)) and extent[0] != extent[1]
    return [float(one) for one in extent] if good else None


def _doubt(contents: Contents) -> dict[str, str]:
    doubt = contents.attrs.get("doubt")
    return {"in doubt": doubt[:_LONGEST]} if isinstance(doubt, str) and doubt else {}


def _axes(stored: Stored) -> dict[str, str]:
    """From where to where the columns and rows are."""
    facts = {}
    for name, unit in _UNITS.items():
        if extent := _extent(stored, name):
            facts[name.partition("_")[0]] = f"{extent[0]:.4g} to {extent[1]:.4g} {unit}"
    return facts
