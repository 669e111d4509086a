"""Delay-Doppler planes of a recovery of `tmca dbd`: the matched filter and the dual polynomial of every source."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data import Contents, Stored
from tmca.viewer.cubes import ONE, said
from tmca.viewer.items import Item, Layer, in_memory

_KIND = "dual blind deconvolution: recovery"
_LAYERS = {
    "matched_filter": ("matched", "matched filter, gain of a path"),
    "dual_polynomial": ("polynomial", "‖f‖ / weight of the dual polynomial"),
}
_MOST = 20
"""Sources that are looked for."""
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
        layers = tuple(_layer(name, one, rows) for name, one in found.items())
        facts = {"source": source, **_axes(first), **said(contents.attrs)}
        items.append(Item("array", f"{title}: {source}", layers, facts, **about))
    return items


def _layer(name: str, stored: Stored, rows: int) -> Layer:
    """Of so many rows; what is the same for all Dopplers is repeated."""
    values: NDArray[Any] = np.atleast_2d(np.asarray(stored.whole(), np.float32).T)[::-1]
    values = np.broadcast_to(values, (max(rows, len(values)), values.shape[1]))
    size = values.shape[0], values.shape[1]
    span = 0.0, max(1e-30, float(np.nanmax(values, initial=0.0)))
    return Layer(_LAYERS[name][0], _LAYERS[name][1], size, ONE, in_memory(values[None]), span=span)


def _axes(stored: Stored) -> dict[str, str]:
    """From where to where the columns and rows are."""
    facts = {}
    for name, unit in _UNITS.items():
        extent = np.ravel(stored.attrs.get(name, ()))
        if extent.size == 2 and extent.dtype.kind in "fiu":
            facts[name.partition("_")[0]] = f"{extent[0]:.4g} to {extent[1]:.4g} {unit}"
    return facts
