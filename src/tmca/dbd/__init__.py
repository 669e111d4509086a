"""Dual blind deconvolution: radar targets and radio paths from one overlaid signal, off the grid, certified."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tmca.dbd.problem import Problem, Truth, Units
    from tmca.dbd.recovery import RecoveredSource, Recovery
    from tmca.dbd.signals.simulate import simulate
    from tmca.dbd.solving import solve
    from tmca.dbd.source import Source

_HOMES = {
    "Problem": "problem",
    "Truth": "problem",
    "Units": "problem",
    "RecoveredSource": "recovery",
    "Recovery": "recovery",
    "simulate": "signals.simulate",
    "solve": "solving",
    "Source": "source",
}

__all__ = ["Problem", "RecoveredSource", "Recovery", "Source", "Truth", "Units", "simulate", "solve"]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"tmca.dbd.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'tmca.dbd' has no attribute {name!r}")
