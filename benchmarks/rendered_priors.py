"""Priors of rendered and real scenes: ``python benchmarks/rendered_priors.py --scenes SPLIT --prior FILE``.

PSNR of the patch LMMSE under each prior (``rendered`` is the package's own), for every scene of the split: 12 bands,
K = 8 random slots, one bucket, tile 32, noise σ = 0.01 of full scale, middle 256×256 pixels.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch

import tmca
from tmca.data import load_scene, read_split
from tmca.metrics import psnr
from tmca.priors import find_prior


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=Path, required=True, help="split file of scenes that are decoded")
    parser.add_argument("--prior", action="append", required=True, help="file, or rendered; again for another")
    parser.add_argument("--decoder", default="lmmse", help="lmmse or mixture [lmmse]")
    options = parser.parse_args()
    torch.set_num_threads(1)
    kind = "mixture" if options.decoder == "mixture" else "gaussian"
    cubes = {path.stem: load_scene(path, bands=12, size=(256, 256)) for path in read_split(options.scenes)}
    waves = next(iter(cubes.values()))["wavelength"].values.tolist()
    sensor = tmca.Sensor(read_noise=0.01)
    camera = tmca.SpectralCamera(waves, (256, 256), 8, shutter="random", period=32, seed=0, sensor=sensor)
    print(f"| prior | {' | '.join(cubes)} | mean |\n|{'---|' * (len(cubes) + 2)}")
    for name in options.prior:
        prior, found = find_prior(camera, None if name == "rendered" else name, kind), []
        for cube in cubes.values():
            scene = torch.from_numpy(np.ascontiguousarray(cube.values))[None]
            snapshot = tmca.Snapshot(camera(scene, generator=0), camera)
            estimate = tmca.reconstruct(snapshot, options.decoder, prior=prior).values.clamp(0, 1)
            found.append(float(psnr(estimate, scene)))
        cells = " | ".join(f"{value:.2f}" for value in (*found, np.mean(found)))
        print(f"| {Path(name).stem} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
