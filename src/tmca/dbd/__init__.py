"""Dual blind deconvolution: radar targets and radio paths from one overlaid signal, off the grid, certified.

>>> from tmca import dbd
>>> problem = dbd.simulate(M=9, P=5, J=2, targets=2, paths=1, seed=2)  # 9 frequencies, 5 pulses
>>> recovery = dbd.solve(problem)
>>> recovery.exact, recovery.certified
(True, True)
>>> recovery["radar"].points.shape  # delay, Doppler and angle of every target
(2, 3)
>>> dbd.score(recovery, problem).max_error < 1e-6
True

A :class:`Problem` holds samples and what is known of every :class:`Source`; one of your own needs no simulation.
``read_scenario("road").draw().receive()`` is one in metres and metres a second.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tmca.dbd.channel import Channel
    from tmca.dbd.files import load_problem, save_problem, save_recovery
    from tmca.dbd.identifiability import BeyondFreedom, LittleExplained, OneWay, SameSignals, beyond_freedom
    from tmca.dbd.model import Problem, Source, Truth, Units
    from tmca.dbd.noise import true_bounds
    from tmca.dbd.planes import delay_doppler_planes
    from tmca.dbd.recordings import read_recording
    from tmca.dbd.recovery import Recovery, Score, score
    from tmca.dbd.scenario import Path, Scenario, Target
    from tmca.dbd.scenario_files import read_scenario
    from tmca.dbd.separation import Separation, joint_separation
    from tmca.dbd.simulation import BASES, MESSAGES, simulate
    from tmca.dbd.solving import GRAMS, METHODS, solve
    from tmca.dbd.waveforms import (
        Chirp,
        Ofdm,
        SampledWaveform,
        basis_from_waveform,
        read_waveforms,
        spectra_of_recording,
        waveform_source,
        with_waveforms,
    )

_HOMES = {
    "channel": ("Channel",),
    "files": ("load_problem", "save_problem", "save_recovery"),
    "identifiability": ("BeyondFreedom", "LittleExplained", "OneWay", "SameSignals", "beyond_freedom"),
    "model": ("Problem", "Source", "Truth", "Units"),
    "noise": ("true_bounds",),
    "planes": ("delay_doppler_planes",),
    "recordings": ("read_recording",),
    "recovery": ("Recovery", "Score", "score"),
    "scenario": ("Path", "Scenario", "Target"),
    "scenario_files": ("read_scenario",),
    "separation": ("Separation", "joint_separation"),
    "simulation": ("BASES", "MESSAGES", "simulate"),
    "waveforms": (
        "Chirp",
        "Ofdm",
        "SampledWaveform",
        "basis_from_waveform",
        "read_waveforms",
        "spectra_of_recording",
        "waveform_source",
        "with_waveforms",
    ),
    "solving": ("GRAMS", "METHODS", "solve"),
}
_MODULES = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "BASES", "GRAMS", "MESSAGES", "METHODS", "BeyondFreedom", "Channel", "Chirp", "LittleExplained", "Ofdm", "OneWay",
    "Path", "Problem", "Recovery", "SameSignals", "SampledWaveform", "Scenario", "Score", "Separation", "Source",
    "Target", "Truth", "Units", "basis_from_waveform", "beyond_freedom", "delay_doppler_planes", "joint_separation",
    "load_problem", "read_recording", "read_scenario", "read_waveforms", "save_problem", "save_recovery", "score",
    "simulate", "solve", "spectra_of_recording", "true_bounds", "waveform_source", "with_waveforms",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(f"tmca.dbd.{_MODULES[name]}"), name)
    raise AttributeError(f"module 'tmca.dbd' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
