"""What no receiver could hear, said before anything is computed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tmca.dbd.physical import LIGHT_M_S
from tmca.errors import SettingError

if TYPE_CHECKING:
    from tmca.dbd.signals.scenario import Scenario
    from tmca.dbd.signals.ways import Way


def check_numbers(scene: Scenario) -> None:
    """Sizes are whole and positive, durations positive, the signal-to-noise ratio finite."""
    for name in ("pulses", "subspace", "antennas", "seed"):
        value = getattr(scene, name)
        if not np.isfinite(value) or value != int(value) or value < (0 if name == "seed" else 1):
            raise SettingError(name, f"{value}", f"a whole number of {0 if name == 'seed' else 1} or more")
    named = ("bandwidth_hz", "useful_s", "carrier_hz", "spacing")
    for name in named + (("pulse_s",) if scene.pulse_s is not None else ()):
        value = getattr(scene, name)
        if not (np.isfinite(value) and value > 0):
            raise SettingError(name, f"{value}", "a positive number")
    if not (np.isfinite(scene.prefix_s) and scene.prefix_s >= 0):
        raise SettingError("prefix_s", f"{scene.prefix_s}", "seconds, zero or more")
    if scene.snr_db is not None and not abs(scene.snr_db) <= 300:
        raise SettingError("snr_db", f"{scene.snr_db}", "decibels from -300 to 300")


def check_delays(scene: Scenario) -> None:
    """Echoes end within the interval, paths come within the prefix, none before it was sent."""
    assert scene.pulse_s is not None
    last = max((one.delay_s for one in scene.targets), default=0.0) + scene.pulse_s
    if last > scene.useful_s:
        reach = (scene.useful_s - scene.pulse_s) * LIGHT_M_S / 2
        found = f"an echo that ends {last * 1e6:.4g} µs after the pulse"
        remedy = f"take targets within {reach:.4g} m, a longer interval or a shorter pulse"
        raise SettingError("targets", found, f"{scene.useful_s * 1e6:.4g} µs at most", remedy)
    late = max((one.delay_s for one in scene.paths), default=0.0)
    if late > scene.prefix_s:
        found = f"a path of {late * 1e6:.4g} µs"
        remedy = "take a longer prefix; without one, subcarriers are no longer orthogonal"
        raise SettingError("paths", found, f"at most the prefix, {scene.prefix_s * 1e6:.4g} µs", remedy)
    ways: list[Way] = [*scene.targets, *scene.paths]
    if min((one.delay_s for one in ways), default=0.0) < 0:
        raise SettingError("targets and paths", "a negative distance", "distances of zero or more")


def check_unambiguous(scene: Scenario) -> None:
    """Dopplers stay within half the pulse repetition frequency, and angles within half a turn between antennas."""
    for what, channel, ways in (("targets", scene.targets, 2), ("paths", scene.paths, 1)):
        fastest = max((abs(one.velocity_m_s) for one in channel), default=0.0)
        limit = LIGHT_M_S / (2 * ways * scene.carrier_hz * scene.interval_s)
        if fastest >= limit:
            remedy = "take shorter intervals or a lower carrier; faster ones look like slower ones"
            raise SettingError(what, f"{fastest:.4g} m/s", f"less than {limit:.4g} m/s", remedy)
        turn = scene.spacing * max((abs(np.sin(np.deg2rad(one.angle_deg))) for one in channel), default=0.0)
        if scene.antennas > 1 and turn >= 0.5:
            found = f"a turn of {turn:.4g} wavelengths between antennas {scene.spacing:g} wavelengths apart"
            raise SettingError(what, found, "less than 0.5", "take antennas closer together or smaller angles")
