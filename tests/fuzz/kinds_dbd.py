"""Files of dual blind deconvolution."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.kinds import kind
from tmca.dbd import read_scenario, simulate
from tmca.dbd.files import load_problem, save_problem
from tmca.dbd.model import Units


def _problem(path: Path) -> None:
    problem = simulate(5, 3, 2, 1, 1, snr_db=20.0)
    save_problem(replace(problem, units=Units(1e-6, 2e5, 77e9)), path)


def _samples(path: Path) -> None:
    problem = simulate(5, 3, 2, 1, 1, snr_db=20.0)
    radar, link = problem.sources
    np.savez(
        path, y=problem.y[0], basis_radar=radar.rows[0], basis_communications=link.rows, sigma=0.1, weight_radar=1.5,
        message_communications=link.message, delay_s=1e-6, doppler_hz=2e5, carrier_hz=77e9,
    )  # fmt: skip


def _scenario(path: Path) -> None:
    path.write_text(
        "bandwidth_hz: 10e6\nuseful_s: 3.3e-6\nprefix_s: 1.2e-6\ncarrier_hz: 77e9\npulses: 5\nsubspace: 2\n"
        "messages: shared\nantennas: 1\nspacing: 0.5\nsnr_db: 25\nseed: 3\n"
        "targets:\n  - {range_m: 120, velocity_m_s: 20, gain: 0.6 + 0.2j}\n"
        "paths:\n  - {length_m: 90, velocity_m_s: -3, gain: 1, angle_deg: 5}\n"
    )


def _draw(path: Path) -> Any:
    return read_scenario(path).draw().receive()


kind("problem.nc", _problem, load_problem)
kind("samples.npz", _samples, load_problem)
kind("scenario.yaml", _scenario, _draw)
