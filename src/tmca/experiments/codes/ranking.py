"""What decoders make of codes on test scenes: the order of many codes, and networks behind designed and random ones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tmca.cameras import CodedCamera, SpectralCamera
from tmca.codes import write_codes
from tmca.data.scenes import load_scene
from tmca.design import MixtureMse, TileMse, decibels
from tmca.experiments.cells import Measured, Settings
from tmca.experiments.codes.task import Task, on_frame
from tmca.priors import GaussianMixturePrior, GaussianPrior
from tmca.sensor import Sensor

RANKED: dict[str, dict[str, Any]] = {
    **{
        f"static, {share:.0%} open": {"slots": 1, "shutter": "open", "transmittance": share}
        for share in (0.2, 0.5, 0.8)
    },
    "static, blue noise": {"slots": 1, "aperture": "blue-noise", "shutter": "open"},
    "static, designed": {"design": "static", "slots": 1},
    **{f"random K = {k}": {"slots": k} for k in (2, 4, 8, 16)},
    **{f"random K = {k}, 80% open": {"slots": k, "transmittance": 0.8, "duty": 0.8} for k in (2, 8)},
    **{f"random K = {k}, 20% open": {"slots": k, "transmittance": 0.4, "duty": 0.5} for k in (2, 8)},
    **{f"one-hot K = {k}": {"slots": k, "shutter": "one-hot"} for k in (2, 4, 8)},
    **{f"one-hot K = {k}, designed": {"design": "one-hot", "slots": k} for k in (2, 4)},
    **{f"free K = {k}, designed": {"design": "free", "slots": k} for k in (2, 4, 8)},
    "complementary K = 4": {"slots": 4, "aperture": "complementary", "shutter": "complementary"},
    "blue noise K = 4": {"slots": 4, "aperture": "blue-noise", "shutter": "blue-noise"},
    "S-matrix K = 7": {"slots": 7, "shutter": "s-matrix"},
    "static aperture, random shutter K = 4": {"slots": 4, "aperture": "static"},
}
"""Codes of every family, light and number of slots, random and designed."""
_JUDGES = {
    "expected": "rank_correlation",
    "expected_there": "rank_correlation_there",
    "expected_mixture": "mixture_rank_correlation",
}


def networks(slots: int) -> dict[str, dict[str, Any]]:
    """Codes that networks are trained for at the corners of the study."""
    return {
        "static, random": {"slots": 1, "shutter": "open"},
        "static, designed": {"design": "static", "slots": 1},
        "static, tuned with the network": {"design": "static", "slots": 1, "tune": "aperture"},
        f"random K = {slots}": {"slots": slots},
        f"free K = {slots}, designed": {"design": "free", "slots": slots},
        f"free K = {slots}, tuned with the network": {"design": "free", "slots": slots, "tune": "both"},
    }


def ranking(cell: Settings) -> Measured:
    """Expected PSNR of one code, and what decoders make of it on the middle of the test scenes."""
    from tmca.decoders import Weights

    task = Task.of(cell)
    camera, weights = coded(task, cell["code"]), None
    if cell["steps"]:
        weights = _trained(task, cell, camera)
        camera = Weights.load(weights).camera_for(task.period)  # tuned codes are others than it began with
    found: Measured = {"expected": task.psnr(camera), "throughput": camera.throughput()}
    mixture = GaussianMixturePrior.load(cell["mixture"])
    error = MixtureMse.of(mixture, task.examples.model, task.noise.read, task.noise.shot)
    found["expected_mixture"] = decibels(TileMse(error).whole(camera))
    found["lmmse"] = _measured(task, cell, camera, "lmmse", prior=GaussianPrior.load(cell["prior"]))
    if weights:
        found["unrolled"] = _measured(task, cell, camera, "network", weights=weights)
    return found


def ranked_there(cell: Settings) -> Measured:
    """Expected PSNR of every ranked code, the examples dimmed to the mean irradiance of the test scenes."""
    task, there = Task.of(cell), Task.of(cell, cell["light"])
    return {"expected_there": {name: there.psnr(coded(task, code)) for name, code in RANKED.items()}}


def coded(task: Task, code: dict[str, Any]) -> CodedCamera:
    """A camera of one period with a code of ``RANKED``."""
    if "design" in code:
        return task.design(code["design"], code["slots"]).camera
    return SpectralCamera(bands=task.bands, size=task.period, period=task.period, seed=task.seed, **code)


def _measured(task: Task, cell: Settings, camera: CodedCamera, decoder: str, **with_: Any) -> dict[str, float]:
    """PSNR on the middle of each test scene."""
    from tmca.applications import simulate
    from tmca.experiments.spectral.imaging import reconstruct_snapshot

    size, found = (int(cell["size"][0]), int(cell["size"][1])), {}
    for path in cell["test"]:
        scene = load_scene(path, bands=cell["bands"], size=size)
        taken = simulate(scene, on_frame(camera, task.camera, size, Sensor(**cell["sensor"])), seed=cell["seed"])
        result = reconstruct_snapshot(taken, decoder, truth=scene, **with_)
        found[Path(path).stem] = result.metrics["psnr"]
    return found


def _trained(task: Task, cell: Settings, camera: CodedCamera) -> Path:
    """Weights of an unrolled network trained for these codes and this noise alone, with the codes if they are tuned."""
    from tmca.data import make_folder
    from tmca.experiments.spectral.rows import FROZEN, RATE, scenes_of
    from tmca.training import train, training_settings

    folder, codes = make_folder(Path(cell["folder"])), camera.codes
    file = folder / "codes.nc"
    write_codes(file, codes.aperture.tile(), codes.shutter.tile(), task.period, overwrite=True)
    static = {"shutter": "open"} if camera.slots == 1 else {}
    own = {"size": _frame(task.period), "period": list(task.period), "slots": camera.slots}
    training = {
        "camera": {**own, "learn": cell["code"].get("tune", "none"), **static},
        "noise": [cell["sensor"]],
        "codes": {"start": str(file), "frozen": FROZEN["unrolled"], "slope": [2.0, 40.0]},
        "decoder": {"kind": "unrolled", "start": "lmmse"},
        "data": {"bands": cell["bands"], **scenes_of(cell["train"]), "validation": cell["validation"], "pool": 512},
        "optimiser": {"steps": cell["steps"], "loss": "log", "code_rate": RATE["unrolled"]},
        "seed": cell["seed"],
        "validate_every": max(1, cell["steps"] // 4),
    }
    return train(training_settings("spectral", None, None, training), folder / "run").weights


def _frame(period: Sequence[int]) -> list[int]:
    """A frame of whole periods that holds a patch at every place of the tile."""
    return [side * -(-160 // side) for side in period]


def correlations(cells: Sequence[Measured]) -> list[dict[str, Any]]:
    """Spearman's rank correlation of expected PSNR, by the examples as they are and dimmed and under a mixture, with
    each decoder's mean over the test scenes."""
    from scipy.stats import spearmanr

    found = []
    for noise in dict.fromkeys(cell["noise"] for cell in cells):
        own = [cell for cell in cells if cell["noise"] == noise]
        for decoder in ("lmmse", "unrolled"):
            known = [cell for cell in own if decoder in cell]
            if len(known) > 2:
                means = [np.mean(list(cell[decoder].values())) for cell in known]
                row = {"noise": noise, "decoder": decoder, "codes": len(known)}
                for key, name in _JUDGES.items():
                    row[name] = float(spearmanr([cell[key] for cell in known], means).statistic)
                found.append(row)
    return found
