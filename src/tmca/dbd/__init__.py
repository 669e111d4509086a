"""Dual blind deconvolution: radar targets and radio paths from one overlaid signal, off the grid, certified."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tmca.dbd.channel import Channel
    from tmca.dbd.coordinates import Units
    from tmca.dbd.files import load_problem, read_scenario, save_problem, save_recovery
    from tmca.dbd.model import Problem, Source, Truth
    from tmca.dbd.recovery import Recovery, Score, score
    from tmca.dbd.scenario import Path, Scenario, Target
    from tmca.dbd.simulation import simulate
    from tmca.dbd.solving import solve

_HOMES = {
    "channel": ("Channel",),
    "coordinates": ("Units",),
    "files": ("load_problem", "read_scenario", "save_problem", "save_recovery"),
    "model": ("Problem", "Source", "Truth"),
    "recovery": ("Recovery", "Score", "score"),
    "scenario": ("Path", "Scenario", "Target"),
    "simulation": ("simulate",),
    "solving": ("solve",),
}
_MODULES = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "Channel", "Path", "Problem", "Recovery", "Scenario", "Score", "Source", "Target", "Truth", "Units",
    "load_problem", "read_scenario", "save_problem", "save_recovery", "score", "simulate", "solve",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(f"tmca.dbd.{_MODULES[name]}"), name)
    raise AttributeError(f"module 'tmca.dbd' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
