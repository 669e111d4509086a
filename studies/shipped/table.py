"""How good the network of any camera is on scenes that nothing was learned from: ``python -m studies.shipped.table``.

Every row: a camera, a scene; PSNR of the LMMSE that the network starts from and of the network; CPU seconds of both;
share of true values within one and two predicted standard deviations, and rank correlation of predicted with actual
error, over pixels (root mean squares over bands).
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.io import loadmat
from scipy.stats import spearmanr
from torch import Tensor

from studies.shipped.pool import KNOTS, TSA, decibels
from tmca.cameras import Snapshot, SpectralCamera
from tmca.data import read
from tmca.decoders import decode
from tmca.decoders.nets.weights import FOLDER, UNIVERSAL
from tmca.priors import interpolation
from tmca.sensor import Sensor

TILED = {"aperture": "random", "period": 32}
STATIC = {"slots": 1, "aperture": "static", "shutter": "open", "period": 32}
RANDOM = {"slots": 8, "shutter": "random", **TILED}
BUCKETS = {"slots": 4, "shutter": "balanced", "buckets": 2, **TILED}
WIDE = {"bands": TSA.tolist(), "dispersion": 2.0}


def cameras(data: Path) -> dict[str, dict[str, Any]]:
    """Settings of the cameras; the last one has bands, slots and a mask that the training never drew."""
    mask = torch.from_numpy(loadmat(data / "cassi/tsa/mask_256_sim.mat")["mask"].astype(np.float32))
    rows = {
        "28 bands, static, benchmark's mask, no noise": {**WIDE, "slots": 1, "aperture": mask[None], "shutter": "open"},
        "28 bands, two buckets, K = 4, no noise": {**WIDE, **BUCKETS, "seed": 77},
    }
    for noise in (0.0, 0.01):
        sensor = Sensor(read_noise=noise)
        for name, codes in {"static": STATIC, "K = 8 random": RANDOM, "two buckets, K = 4": BUCKETS}.items():
            rows[f"12 bands, {name}, σ = {noise:g}"] = {"bands": 12, **codes, "seed": 78, "sensor": sensor}
    unseen = {"bands": (1e-9 * np.linspace(420, 680, 20)).tolist(), "slots": 6, "shutter": "balanced", "buckets": 2}
    unseen |= {"aperture": "random", "duty": 0.35, "dispersion": 1.3, "seed": 79, "sensor": Sensor(read_noise=0.005)}
    return {**rows, "20 bands, two buckets, K = 6, 1.3 px a band, 35 % open, σ = 0.005": unseen}


def at_bands(file: Path, camera: SpectralCamera) -> Tensor:
    """(L, H, W) a cube of the `KNOTS`, linear between them."""
    cube = torch.from_numpy(read(file, wavelengths=KNOTS).values.astype(np.float32))
    return torch.einsum("lk,khw->lhw", interpolation(camera.wavelengths, torch.from_numpy(KNOTS)).float(), cube)


def row(camera: SpectralCamera, scene: Tensor, name: str) -> dict[str, float]:
    """Figures of one scene (L, H, W)."""
    snapshot = Snapshot(camera(scene[None], generator=0), camera, {"scene": name})
    figures, prior = {}, FOLDER / f"{UNIVERSAL}-prior.nc"
    decoders: dict[str, dict[str, Any]] = {"lmmse": {"prior": prior}, "network": {"weights": UNIVERSAL}}
    for label, given in decoders.items():
        begun = time.process_time()
        estimate = decode(snapshot, label, **given)
        figures[f"{label}_seconds"] = time.process_time() - begun
        figures[label] = float(decibels(estimate.values, scene[None])[0])
    assert estimate.deviation is not None
    return figures | certainty(estimate.values[0], estimate.deviation[0], scene)


def certainty(estimate: Tensor, deviation: Tensor, scene: Tensor) -> dict[str, float]:
    """Shares of true values within one and two standard deviations; rank correlation of predicted and actual error."""
    error = (estimate - scene).abs()
    predicted, actual = (part.square().mean(0).sqrt().flatten().numpy() for part in (deviation, error))
    within = {f"within_{n}": float((error <= n * deviation).float().mean()) for n in (1, 2)}
    return within | {"rank": float(spearmanr(predicted, actual).statistic)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--split", default="cave_test")
    parser.add_argument("--out", type=Path, default=Path("docs/results/universal.json"))
    how = parser.parse_args()
    rows = []
    for name, settings in cameras(how.data).items():
        for file in (how.data / "splits" / f"{how.split}.txt").read_text().split():
            camera = SpectralCamera(size=(256, 256), **settings)
            scene = at_bands(how.data / file, camera)
            rows.append({"camera": name, "scene": Path(file).stem, **row(camera, scene, Path(file).stem)})
            print(json.dumps(rows[-1], ensure_ascii=False), flush=True)
            how.out.write_text(json.dumps(rows, ensure_ascii=False, indent=1))


if __name__ == "__main__":
    main()
