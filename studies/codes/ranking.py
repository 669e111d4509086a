"""What decoders make of codes on test scenes: the order of many codes, and networks behind designed and random ones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tmca
from studies.codes.records import Cell, Code, Correlation, Figures, RankedRow
from studies.codes.searches import mean, sensor_of, task_of
from tmca.cameras import CodedCamera
from tmca.codes import write_codes
from tmca.data import load_scene, make_folder, split_rendered
from tmca.decoders import Weights
from tmca.design import MixtureMse, Task, TileMse, decibels, on_frame
from tmca.metrics import psnr
from tmca.priors import GaussianMixturePrior, GaussianPrior
from tmca.training import train, training_settings

RANKED: dict[str, Code] = {
    **{f"static, {share:.0%} open": Code(1, settings={"shutter": "open", "transmittance": share})
       for share in (0.2, 0.5, 0.8)},
    "static, blue noise": Code(1, settings={"aperture": "blue-noise", "shutter": "open"}),
    "static, designed": Code(1, "static"),
    **{f"random K = {k}": Code(k) for k in (2, 4, 8, 16)},
    **{f"random K = {k}, 80% open": Code(k, settings={"transmittance": 0.8, "duty": 0.8}) for k in (2, 8)},
    **{f"random K = {k}, 20% open": Code(k, settings={"transmittance": 0.4, "duty": 0.5}) for k in (2, 8)},
    **{f"one-hot K = {k}": Code(k, settings={"shutter": "one-hot"}) for k in (2, 4, 8)},
    **{f"one-hot K = {k}, designed": Code(k, "one-hot") for k in (2, 4)},
    **{f"free K = {k}, designed": Code(k, "free") for k in (2, 4, 8)},
    "complementary K = 4": Code(4, settings={"aperture": "complementary", "shutter": "complementary"}),
    "blue noise K = 4": Code(4, settings={"aperture": "blue-noise", "shutter": "blue-noise"}),
    "S-matrix K = 7": Code(7, settings={"shutter": "s-matrix"}),
    "static aperture, random shutter K = 4": Code(4, settings={"aperture": "static"}),
}  # fmt: skip
"""Codes of every family, light and number of slots, random and designed."""
SIZE = (256, 256)
"""(H, W) of the middles of test scenes that codes are ranked on, pixels."""
_FROZEN, _RATE = 0.9, 0.1
"""Share of a training after which codes are fixed, and their learning rate."""


def networks(slots: int) -> dict[str, Code]:
    """Codes that networks are trained for at the corners of the study."""
    return {
        "static, random": Code(1, settings={"shutter": "open"}),
        "static, designed": Code(1, "static"),
        "static, tuned with the network": Code(1, "static", "aperture"),
        f"random K = {slots}": Code(slots),
        f"free K = {slots}, designed": Code(slots, "free"),
        f"free K = {slots}, tuned with the network": Code(slots, "free", "both"),
    }


def ranking(cell: Cell) -> list[RankedRow]:
    """Expected PSNR of one code, and what decoders make of it on the middle of the test scenes."""
    assert cell.code is not None
    task = task_of(cell)
    camera, weights = coded(task, cell.code), None
    if cell.steps:
        weights = _trained(task, cell, cell.code, camera)
        camera = Weights.load(weights).camera_for(task.period)  # tuned codes are others than it began with
    lmmse = _measured(task, cell, camera, "lmmse", prior=GaussianPrior.load(cell.prior))
    row: RankedRow = {
        "noise": cell.noise, "codes": cell.codes, "expected": task.psnr(camera), "lmmse": lmmse,
        "throughput": camera.throughput(),
    }  # fmt: skip
    if weights:
        row["unrolled"] = _measured(task, cell, camera, "network", weights=weights)
    if cell.kind == "network":
        row["seed"] = cell.seed
        return [row]
    prior = GaussianMixturePrior.load(cell.mixture)
    error = MixtureMse.of(prior, task.examples.model, task.noise.read, task.noise.shot)
    row["expected_mixture"] = decibels(TileMse(error).whole(camera))
    row["expected_there"] = task_of(cell, cell.light).psnr(coded(task, cell.code))
    return [row]


def coded(task: Task, code: Code) -> CodedCamera:
    """A camera of one period with a code of ``RANKED``."""
    if code.design:
        return task.design(code.design, code.slots).camera
    size = task.period
    return tmca.SpectralCamera(
        bands=task.bands, size=size, period=size, seed=task.seed, slots=code.slots, **code.settings
    )


def _measured(task: Task, cell: Cell, camera: CodedCamera, decoder: str, **how: Any) -> Figures:
    """PSNR on the middle of each test scene."""
    values = {}
    for path in cell.test:
        scene = load_scene(path, bands=cell.bands, size=SIZE)
        frame = on_frame(camera, task.camera, SIZE, sensor_of(cell))
        estimate = tmca.reconstruct(tmca.simulate(scene, frame, seed=cell.seed), decoder, **how)
        values[Path(path).stem] = float(psnr(estimate.values[0].numpy(), scene.values))
    return values


def _trained(task: Task, cell: Cell, code: Code, camera: CodedCamera) -> Path:
    """Weights of an unrolled network trained for these codes and this noise alone, with the codes if they are tuned."""
    folder, codes = make_folder(Path(cell.folder)), camera.codes
    file = folder / "codes.nc"
    write_codes(file, codes.aperture.tile(), codes.shutter.tile(), task.period, overwrite=True)
    static = {"shutter": "open"} if camera.slots == 1 else {}
    coded_aperture = {"size": _frame(task.period), "period": list(task.period), "slots": camera.slots, **static}
    scenes = {
        "train": [*cell.train * 3, *sorted(split_rendered()["train"])],  # given ones outnumber the rendered ones
        "prior": list(cell.train),
        "validation": list(cell.validation),
    }
    described = {
        "camera": {**coded_aperture, "learn": code.tune},
        "noise": [cell.sensor],
        "codes": {"start": str(file), "frozen": _FROZEN, "slope": [2.0, 40.0]},
        "decoder": {"kind": "unrolled", "start": "lmmse"},
        "data": {"bands": cell.bands, **scenes, "pool": 512},
        "optimiser": {"steps": cell.steps, "loss": "log", "code_rate": _RATE},
        "seed": cell.seed,
        "validate_every": max(1, cell.steps // 4),
    }
    return train(training_settings("spectral", None, None, described), folder / "run").weights


def _frame(period: Sequence[int]) -> list[int]:
    """A frame of whole periods that holds a patch at every place of the tile."""
    return [side * -(-160 // side) for side in period]


def correlations(rows: Sequence[RankedRow]) -> list[Correlation]:
    """Spearman's rank correlation of expected PSNR, by the examples as they are and dimmed and under a mixture, with
    each decoder's mean over the test scenes."""
    found: list[Correlation] = []
    for noise in dict.fromkeys(row["noise"] for row in rows):
        chosen = [row for row in rows if row["noise"] == noise]
        networks = [row for row in chosen if "unrolled" in row]
        for decoder, known, measured in (
            ("lmmse", chosen, [row["lmmse"] for row in chosen]),
            ("unrolled", networks, [row["unrolled"] for row in networks]),
        ):
            if len(known) > 2:
                found.append(_correlation(noise, decoder, known, [mean(by) for by in measured]))
    return found


def _correlation(noise: str, decoder: str, rows: Sequence[RankedRow], means: Sequence[float]) -> Correlation:
    from scipy.stats import spearmanr

    def rank(values: Sequence[float]) -> float:
        return float(spearmanr(values, means).statistic)

    return {
        "noise": noise, "decoder": decoder, "codes": len(rows),
        "rank_correlation": rank([row["expected"] for row in rows]),
        "rank_correlation_there": rank([row["expected_there"] for row in rows]),
        "mixture_rank_correlation": rank([row["expected_mixture"] for row in rows]),
    }  # fmt: skip
