"""The figures of the model card: ``python benchmarks/weights.py [--test SPLIT]`` on rendered test scenes and a split.

For every sensor and scene: random codes of the same kind with the patch LMMSE, then the shipped codes with the patch
LMMSE and with their network, all under the prior of the rendered scenes.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import torch
import xarray as xr
from advice import SENSORS

from tmca.applications import evaluate, simulate
from tmca.cameras import SpectralCamera
from tmca.data import read_split, split_rendered
from tmca.data.scenes import load_scene
from tmca.decoders import Weights, decode
from tmca.sensor import Sensor


def random_camera(weights: Weights, size: tuple[int, int], sensor: Sensor) -> SpectralCamera:
    """Random codes with as many slots and the same tile."""
    shutter = "random" if weights.slots > 1 else "open"
    return SpectralCamera(
        weights.wavelengths, size, weights.slots, shutter=shutter, sensor=sensor, period=weights.period
    )


def rows(scene: xr.DataArray, slots: int) -> list[str]:
    """Markdown rows of one scene and one camera."""
    weights, size = Weights.find("default", slots), (scene.sizes["y"], scene.sizes["x"])
    found = []
    for noise, settings in SENSORS.items():
        sensor = Sensor(**settings)
        learned = simulate(scene, weights.camera_for(size, sensor=sensor))
        plain = simulate(scene, random_camera(weights, size, sensor))
        prior = weights.load_prior()
        estimates = (
            decode(plain, "lmmse", prior=prior),
            decode(learned, "lmmse", prior=prior),
            decode(learned, "network", weights=weights),
        )
        values = [evaluate(estimate, scene)["psnr"] for estimate in estimates]
        numbers = " | ".join(f"{value:.2f}" for value in values)
        found.append(f"| {scene.attrs['name']} | {weights.slots} | {noise} | {numbers} |")
    return found


def table(scenes: Sequence[xr.DataArray]) -> None:
    """Print the table, scene by scene."""
    print("| scene | K | sensor | random codes, LMMSE | learned codes, LMMSE | learned codes, network |")
    print("|---|---|---|---|---|---|")
    for scene in scenes:
        for slots in (1, 8):
            print("\n".join(rows(scene, slots)), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--test", type=Path, help="split file of more scenes")
    options = parser.parse_args()
    torch.set_num_threads(1)
    names = [*sorted(split_rendered()["test"]), *(read_split(options.test) if options.test else [])]
    table([load_scene(name, bands=12) for name in names])


if __name__ == "__main__":
    main()
