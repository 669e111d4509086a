"""Ground truth of a bench: fringes, projectors, spectral scans; captures with their truth."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import torch

from studies.rendered_table import bench, render_scan
from tests.fuzz.kinds import kind
from tests.fuzz.kinds_formats import NM, cube
from tests.fuzz.kinds_own import NET
from tmca.cameras import Snapshot, SpectralCamera
from tmca.data import write_dataset
from tmca.decoders import Weights, build_network
from tmca.lab.frames import write_frames
from tmca.lab.ground_truth.fringes import FringePlan, load_plan, read_capture, write_fringes
from tmca.lab.ground_truth.geometry import camera_rays, load_calibration
from tmca.lab.ground_truth.join import open_cube
from tmca.lab.ground_truth.scan import measure_reflectance, read_scan
from tmca.tuning.folder import find_pairs
from tmca.tuning.pairs import read_pair

BANDS = (450e-9, 550e-9, 650e-9)


def _fringes(path: Path) -> None:
    plan = FringePlan(size=(8, 64), fringes=(1, 4), steps=3)
    write_fringes(plan, path)
    phase = 2 * np.pi * np.linspace(0, 1, 13) * np.ones((6, 1))
    seen = [
        1000 + 800 * np.cos(count * phase - 2 * np.pi * step / plan.steps)
        for count in plan.fringes
        for step in range(plan.steps)
    ]
    write_frames(path / "captured", dict(zip(plan.names, np.array(seen).astype(np.uint16), strict=True)))


def _read_fringes(path: Path) -> Any:
    plan = load_plan(path)
    return plan, read_capture(path / "captured", plan)


def _projector(path: Path) -> None:
    bench((12, 16), (32, 64)).save(path)


def _read_projector(path: Path) -> Any:
    calibration = load_calibration(path)
    return calibration, camera_rays(calibration)


def _scan(path: Path) -> None:
    seen = render_scan(0.2 + 0.6 * cube().astype(np.float64), bits=16, darks=2)
    path.mkdir()
    for name, frames in (("scene", seen.scene), ("white", seen.white)):
        write_frames(path / name, {f"{name}_{nm:g}nm": frame for nm, frame in zip(NM, frames, strict=True)})
    write_frames(path / "dark", {f"dark_{index}": frame for index, frame in enumerate(seen.dark)})


def _read_scan(path: Path) -> Any:
    return measure_reflectance(read_scan(path / "scene", path / "dark", path / "white"))


def _measured(path: Path) -> None:
    _scan(path.with_suffix(""))
    write_dataset(_read_scan(path.with_suffix("")), path)
    shutil.rmtree(path.with_suffix(""))


def _pairs(path: Path) -> None:
    path.mkdir()
    torch.manual_seed(0)
    camera = SpectralCamera(BANDS, (6, 7), 2, period=3)
    Weights.of(build_network("unet", bands=3, start="dagger", **NET), camera).save(path / "weights.safetensors")
    for name in ("first", "second"):
        scene = torch.rand(1, *camera.scene_shape)
        Snapshot(camera(scene), camera, {}).save(path / f"{name}.nc")
        write_dataset(camera.label(scene), path / f"{name}_truth.nc")


def _read_pairs(path: Path) -> Any:
    weights = Weights.load(path / "weights.safetensors")
    return [read_pair(files, weights, None)[0] for files in find_pairs(path)]


kind("fringes", _fringes, _read_fringes)
kind("projector.json", _projector, _read_projector)
kind("scan", _scan, _read_scan, infinite=True)
kind("spectra.nc", _measured, open_cube, infinite=True)
kind("tuning", _pairs, _read_pairs)
