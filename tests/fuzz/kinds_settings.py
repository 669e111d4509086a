"""Files of dual blind deconvolution; settings that people write: YAML of studies, training and sensors; runs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tests.fuzz.kinds import kind
from tests.fuzz.kinds_formats import _labelled
from tmca.cameras import SpectralCamera
from tmca.cli.design import _sheet as sheet
from tmca.data import write_json
from tmca.dbd import read_recording, read_scenario, read_waveforms, simulate
from tmca.dbd.files import load_problem, save_problem
from tmca.dbd.model import Units
from tmca.design import load_examples
from tmca.evaluation import read_study
from tmca.evaluation.grid import run_cells
from tmca.optics.phase import Material
from tmca.plots.curves import training_figure
from tmca.priors import learn_prior
from tmca.specs import Hardware, SheetSpec
from tmca.training import training_settings
from tmca.training.checkpoints import load_latest, save_checkpoint
from tmca.training.folder import open_run
from tmca.training.log import TrainingLog
from tmca.training.patches import cached_array
from tmca.training.scenes import SceneLists


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


def _sigmf(path: Path) -> None:
    path.write_text(
        '{"global": {"core:datatype": "ci16_le", "core:sample_rate": 5e6, "core:num_channels": 1},'
        ' "captures": [{"core:sample_start": 0, "core:header_bytes": 0, "core:frequency": 77e9}]}'
    )
    np.arange(24, dtype="<i2").tofile(path.with_suffix(".sigmf-data"))


def _waveforms(path: Path) -> None:
    path.write_text(
        "radar: {kind: chirp, bandwidth_hz: 8e6, duration_s: 1.0e-6, pieces: 2}\n"
        "communications: {kind: ofdm, subcarriers: 9, unknowns: 2, shared: yes, prefix_s: 1.0e-6, seed: 1}\n"
        "other: {kind: samples, file: pulse.npy, sample_rate_hz: 5e6, start_s: 0.0, count: 9}\n"
    )


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
kind("pulse.sigmf-meta", _sigmf, read_recording)
kind("waveforms.yaml", _waveforms, lambda path: read_waveforms(str(path)))
kind("scenario.yaml", _scenario, _draw)


STUDY = """camera: spectral
title: A study
scenes: {test: [gradient, stripes]}
reading: {bands: 6}
settings: {period: 8}
codes:
  static: {camera: {slots: 1}}
  multiplexed: {camera: {slots: 8}, search: {noise: weak, kind: free, slots: 8}}
noises:
  weak: {read_noise: 0.005}
  strong: {full_well: 1e4, read_noise_electrons: 3, bits: 12}
motion: {pixels: 3, frames: 2}
decoders: [lmmse, admm-tv]
options: {admm-tv: {iterations: 20}}
seed: 1
seeds: 2
"""
TRAINING = """preset: quick
camera: {size: [64, 64], slots: 4, period: [8, 8], learn: both}
noise: [{read_noise: 0.01}, {full_well: 10000, bits: 12}]
decoder: {kind: unrolled, stages: 2}
codes: {slope: [4, 40], frozen: 0.2}
data: {bands: 6, patch: 32, batch: 4, pool: 100, shares: [0.8, 0.1, 0.1]}
optimiser: {steps: 100, decoder_rate: 1e-3}
faults: {delay: [0, 0.1], leakage: 0.01}
seed: 3
"""
SENSOR = "full_well: 10000\nread_noise_electrons: 3\nbits: 12\nexposure: 0.01\npattern_rate: 1e3\nslot_time: 1e-4\n"
HARDWARE = "misregistration: [0.5, -1]\ncontrast_ratio: 40\nmotion: 1:2\nleakage: 0.01\nrotation: 1e-1\n"
MATERIAL = """REFERENCES: "a data sheet"
DATA:
  - type: formula 2
    wavelength_range: 0.3 2.5
    coefficients: 0 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653
"""
TABULATED = """DATA:
  - type: tabulated n
    data: |
        0.40 1.530
        0.55 1.518
        0.70 1.513
"""


def _text(text: str) -> Any:
    def make(path: Path) -> None:
        path.write_text(text)

    return make


def _study(path: Path) -> Any:
    return read_study(path).model_dump()


def _training(path: Path) -> Any:
    return training_settings("spectral", file=path).model_dump()


def _sheet(path: Path) -> Any:
    return sheet(path, SheetSpec())


def _hardware(path: Path) -> Any:
    return Hardware.read(str(path)).faults()  # without the perfect contrast, which is infinite


def _material(path: Path) -> Any:
    return Material.read(path).index([450e-9, 550e-9, 650e-9])


def _parts() -> Any:
    torch.manual_seed(0)
    system = torch.nn.Conv2d(1, 2, 3)
    return system, {"decoder": torch.optim.AdamW(system.parameters())}


def _checkpoint(path: Path) -> None:
    system, optimizers = _parts()
    best = {"psnr": 20.0, "score": 20.0, "step": 3}
    for step in (3, 6):
        system(torch.ones(1, 1, 4, 4)).sum().backward()
        optimizers["decoder"].step()
        state = {"best": best, "losses": [0.1, 0.2], "time": 1.0, "cpu_seconds": 2.0}
        save_checkpoint(path, step, system, optimizers, state)


def _resume(path: Path) -> Any:
    system, optimizers = _parts()
    state = load_latest(path, system, optimizers)
    system(torch.ones(1, 1, 4, 4)).sum().backward()
    optimizers["decoder"].step()
    return state, system


def _run(path: Path) -> None:
    path.mkdir()
    open_run(path, training_settings("spectral", "quick"), SceneLists(("a",), ("b",)))
    _checkpoint(path / "checkpoints")


def _open(path: Path) -> Any:
    open_run(path, training_settings("spectral", "quick"), SceneLists(("a",), ("b",)))


def _log(path: Path) -> None:
    log = TrainingLog(path)
    for step in (10, 20, 30):
        log.add(step, {"loss": 0.1 / step, "psnr": 20.0 + step})


def _forget(path: Path) -> Any:
    log = TrainingLog(path)
    log.keep_until(25)
    training_figure(log.rows(), "mean squared error")
    return log.rows()


def _cells(path: Path) -> Any:
    cells = [{"name": f"cell {number}", "seed": number} for number in range(3)]
    return run_cells(cells, _cell, path)


def _cell(cell: dict[str, Any]) -> dict[str, Any]:
    return {"metrics": {"psnr": 20.5 + cell["seed"], "sam": 0.1}, "seconds": 0.25}


def _examples(path: Path) -> None:
    path.mkdir()
    scene = _labelled()
    camera = SpectralCamera(scene.wavelength.values, scene.shape[1:])
    learn_prior([scene], camera, "gaussian", block=(2, 2)).save(path / "scene-a.nc")
    write_json({"areas": {"a": 42}, "peaks": {"a": 0.9}}, path / "examples.json")


def _load_examples(path: Path) -> Any:
    examples = load_examples(path)
    return examples.scenes, examples.areas, examples.peaks, examples.light, examples.most_light


def _cached(path: Path) -> None:
    np.save(path, np.random.default_rng(0).random((3, 4, 5), dtype=np.float32))


def _mapped(path: Path) -> Any:
    return np.array(cached_array(path, lambda: np.zeros((3, 4, 5), np.float32)))


kind("study.yaml", _text(STUDY), _study)
kind("training.yaml", _text(TRAINING), _training)
kind("sensor.yaml", _text(SENSOR), _sheet)
kind("hardware.yaml", _text(HARDWARE), _hardware)
kind("material.yml", _text(MATERIAL), _material)
kind("table.yml", _text(TABULATED), _material)
kind("checkpoints", _checkpoint, _resume)
kind("run", _run, _open)
kind("log.csv", _log, _forget)
kind("cells", _cells, _cells)
kind("examples", _examples, _load_examples)
kind("cached.npy", _cached, _mapped, infinite=True)
