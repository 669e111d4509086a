"""Blocks of the patch LMMSE before many bands: ``python benchmarks/many_bands.py --train SPLIT --scenes SPLIT``.

For blocks of some sizes (rows × columns) and distances: PSNR of each scene behind one random mask, and CPU seconds of
a frame on one thread, the least of all scenes. All blocks are cut from one prior, learned from the training scenes.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
import xarray as xr
from timing import Clock
from torch import Tensor

import tmca
from tmca.data import read_split
from tmca.data.fitting import middle_of
from tmca.decoders.lmmse import PatchEstimator
from tmca.metrics import psnr
from tmca.priors import GaussianPrior, learn_prior
from tmca.priors.finding import usual_block

Stride = tuple[int, int] | None
TRIED: tuple[tuple[int, int, Stride], ...] = (
    (2, 14, None), (3, 40, None), (4, 28, None), (4, 40, None), (4, 40, (2, 40)), (6, 40, (4, 40)),
)  # fmt: skip
"""Rows, columns beside twice the dispersion, and distance of blocks; None is the usual one."""


def scenes(split: Path, waves: Sequence[float], size: tuple[int, int] | None = None) -> dict[str, xr.DataArray]:
    """Of a split at some wavelengths, and of a size."""
    found = {}
    for path in read_split(split):
        cube = tmca.read(path).interp(wavelength=list(waves)).astype("float32")
        name = Path(path).stem
        found[name] = cube.assign_attrs(name=name) if size is None else middle_of(cube, size, name)
    return found


def measured(
    camera: tmca.SpectralCamera, prior: GaussianPrior, stride: Stride, cubes: Mapping[str, xr.DataArray]
) -> str:
    """PSNR of every scene, and seconds of one frame."""
    estimator, clock, said = PatchEstimator(prior, camera.taps(), camera.noise, stride=stride), Clock(), []
    seconds, estimates = [], list[Tensor]()
    for name, cube in cubes.items():
        scene = torch.from_numpy(np.ascontiguousarray(cube.values))[None]
        taken = camera(scene, generator=0)
        seconds.append(clock.seconds(lambda taken=taken: estimates.append(estimator(taken).estimate.clamp(0, 1))))
        said.append(f"{name} {float(psnr(estimates[-1], scene)):.2f}")
    model = estimator.layout.grid.model
    what = f"{model.block[1:]} at {stride or 'usual'}, {model.measurements} measurements"
    return f"{what}: {', '.join(said)} dB, {min(seconds):.1f} s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--train", type=Path, required=True, help="split file of scenes that the prior is learned from")
    parser.add_argument("--scenes", type=Path, required=True, help="split file of scenes that are decoded")
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--noise", type=float, default=0.001, help="standard deviation, of full scale")
    options = parser.parse_args()
    torch.set_num_threads(1)
    waves, size = np.linspace(453.3e-9, 648.1e-9, 28).tolist(), (options.size, options.size)
    sensor = tmca.Sensor(read_noise=options.noise)
    camera = tmca.SpectralCamera(waves, size, 1, shutter="open", dispersion=2.0, sensor=sensor)
    span = camera.dispersion_extent
    cubes = scenes(options.scenes, waves, size)
    largest = max(rows for rows, _, _ in TRIED), max(2 * span + more for _, more, _ in TRIED)
    prior = learn_prior(scenes(options.train, waves).values(), camera, block=largest)
    assert isinstance(prior, GaussianPrior)
    print(f"usual block {usual_block('gaussian', len(waves), span)}, dispersion {span} columns", flush=True)
    for rows, more, stride in TRIED:
        print(measured(camera, prior.cut(rows, 2 * span + more), stride, cubes), flush=True)


if __name__ == "__main__":
    main()
