"""Does the expected error put codes into the order that decoders put them in on test scenes?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tmca.cameras import SpectralCamera
from tmca.codes import write_codes
from tmca.design.search import decibels
from tmca.experiments.cells import Measured, Settings
from tmca.experiments.codes_cells import Task, on_frame
from tmca.experiments.scenes import load_scene
from tmca.priors import GaussianPrior
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


def ranking(cell: Settings) -> Measured:
    """Expected PSNR of one code, and what decoders make of it on the middle of the test scenes."""
    task = Task.of(cell)
    camera = _coded(task, cell)
    found: Measured = {"expected": decibels(task.error.whole(camera)), "throughput": camera.throughput()}
    found["lmmse"] = _measured(task, cell, camera, "lmmse", prior=GaussianPrior.load(cell["prior"]))
    if cell["steps"]:
        found["unrolled"] = _measured(task, cell, camera, "network", weights=_trained(task, cell, camera))
    return found


def _coded(task: Task, cell: Settings) -> SpectralCamera:
    """A camera of one period with the cell's codes."""
    code = dict(cell["code"])
    if "design" in code:
        kind, slots = code["design"], code["slots"]
        if kind == "free":
            return task.best_free(slots, [task.search("static", 1).camera, task.search("one-hot", slots).camera]).camera
        return task.search(kind, slots).camera
    return SpectralCamera(bands=task.bands, size=task.period, period=task.period, seed=cell["seed"], **code)


def _measured(task: Task, cell: Settings, camera: SpectralCamera, decoder: str, **with_: Any) -> dict[str, float]:
    """PSNR on the middle of each test scene."""
    from tmca.experiments.spectral import reconstruct_snapshot, take_snapshot

    size, found = (int(cell["size"][0]), int(cell["size"][1])), {}
    for path in cell["test"]:
        scene = load_scene(path, bands=cell["bands"], size=size)
        taken = take_snapshot(scene, on_frame(camera, task.bands, size, Sensor(**cell["sensor"])), seed=cell["seed"])
        result = reconstruct_snapshot(taken, decoder, truth=scene, **with_)
        found[Path(path).stem] = result.metrics["psnr"]
    return found


def _trained(task: Task, cell: Settings, camera: SpectralCamera) -> Path:
    """Weights of an unrolled network trained for these codes and this noise alone."""
    from tmca.data import make_folder
    from tmca.training import settings_from, train_spectral

    folder, codes = make_folder(Path(cell["folder"])), camera.multiplexed
    file = folder / "codes.nc"
    write_codes(file, codes.aperture.tile(), codes.shutter.tile(), task.period, overwrite=True)
    training = {
        "camera": {"size": _frame(task.period), "period": list(task.period), "slots": camera.slots},
        "noise": [cell["sensor"]], "codes": {"start": str(file)},
        "decoder": {"kind": "unrolled", "start": "lmmse"},
        "data": {"bands": cell["bands"], "train": cell["train"], "validation": cell["validation"], "pool": 512},
        "optimiser": {"steps": cell["steps"], "loss": "log"}, "seed": cell["seed"],
        "validate_every": max(1, cell["steps"] // 4),
    }  # fmt: skip
    bands = cell["bands"]
    return train_spectral(
        settings_from(None, None, training), folder / "run", lambda name: load_scene(name, bands=bands)
    ).weights


def _frame(period: Sequence[int]) -> list[int]:
    """A frame of whole periods that holds a patch at every place of the tile."""
    return [side * -(-160 // side) for side in period]


def correlations(cells: Sequence[Measured]) -> list[dict[str, Any]]:
    """Spearman's rank correlation of the expected PSNR with each decoder's mean over the test scenes, by noise."""
    from scipy.stats import spearmanr

    found = []
    for noise in dict.fromkeys(cell["noise"] for cell in cells):
        own = [cell for cell in cells if cell["noise"] == noise]
        for decoder in ("lmmse", "unrolled"):
            known = [cell for cell in own if decoder in cell]
            if len(known) > 2:
                means = [sum(cell[decoder].values()) / len(cell[decoder]) for cell in known]
                rank = float(spearmanr([cell["expected"] for cell in known], means).statistic)
                found.append({"noise": noise, "decoder": decoder, "codes": len(known), "rank_correlation": rank})
    return found
