"""What ``tmca design`` predicts of one and two buckets beside what its codes give on other scenes:
``python benchmarks/advice.py --design SPLIT --measure SPLIT``.

Codes are searched for the middles of every other scene of the first split, with little effort. The LMMSE under the
prior of the same scenes then reconstructs the middles of four scenes between them and of the second split. Gains are
over the static design, in dB.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from statistics import mean, stdev

import torch
import xarray as xr

from tmca.cameras import Snapshot
from tmca.data import read_split
from tmca.data.scenes import load_scene
from tmca.decoders import decode
from tmca.design import (
    Advice,
    Candidate,
    Effort,
    SensorSheet,
    advise,
    camera_arguments,
    design_model,
    designable,
    learn_examples,
    on_frame,
)
from tmca.metrics import psnr
from tmca.priors import learn_prior

SENSORS = {
    "σ = 0.001": {"read_noise": 0.001},
    "σ = 0.01": {"read_noise": 0.01},
    "10 000 e⁻, 3 e⁻": {"full_well": 10_000.0, "read_noise_electrons": 3.0},
}
BANDS, EFFORT = 12, Effort(2, 80, 0)


def middle(file: Path, size: int) -> xr.DataArray:
    """The middle of a scene, size × size pixels of 12 bands."""
    return load_scene(str(file), bands=BANDS, size=(size, size))


def advised(
    cubes: Sequence[xr.DataArray], sheet: SensorSheet, slots: Sequence[int], period: int, descents: int
) -> Advice:
    """The advice for a sensor and example scenes."""
    bands = cubes[0]["wavelength"].values.tolist()
    scenes = {str(number): torch.from_numpy(cube.values.copy()) for number, cube in enumerate(cubes)}
    model = design_model(designable("static", 1, (8, 8), bands=bands).taps())
    examples, survey = learn_examples(scenes, model, bands), Effort(descents, 40, 0)
    return advise(examples, sheet, slots=slots, period=(period, period), survey=survey, effort=EFFORT, bands=bands)


def measured(candidate: Candidate, sheet: SensorSheet, cubes: Sequence[xr.DataArray], prior: object) -> list[float]:
    """PSNR of the LMMSE of every scene through the codes of a design, dB."""
    found = []
    for seed, cube in enumerate(cubes):
        arguments = camera_arguments(cube["wavelength"].values.tolist(), None)
        camera = on_frame(candidate.design.camera, arguments, cube.shape[1:], sheet.sensor())
        scene = torch.from_numpy(cube.values.copy())[None]
        estimate = decode(Snapshot(camera(scene, generator=seed), camera), "lmmse", prior=prior)
        found.append(psnr(estimate.values, scene))
    return found


def rows(advice: Advice, examples: Sequence[xr.DataArray], others: Sequence[xr.DataArray]) -> list[str]:
    """A row for each design: predicted and measured gain over the static one, each with its spread."""
    camera = on_frame(advice.static.design.camera, camera_arguments(
        examples[0]["wavelength"].values.tolist(), None), examples[0].shape[1:], advice.sheet.sensor())  # fmt: skip
    prior = learn_prior(examples, camera)
    static = measured(advice.static, advice.sheet, others, prior)
    written = [f"| static | {advice.static.psnr:.2f} dB | {mean(static):.2f} dB | |"]
    for each in advice.finals[1:]:
        gains = [own - base for own, base in zip(measured(each, advice.sheet, others, prior), static, strict=True)]
        written.append(
            f"| {each.design.kind}, K = {each.design.slots} | {each.gain:+.2f} ± {each.spread:.2f} "
            f"| {mean(gains):+.2f} ± {stdev(gains):.2f} | {', '.join(f'{gain:+.2f}' for gain in gains)} |"
        )
    return written


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--design", type=Path, required=True, help="split file of example scenes and others")
    parser.add_argument("--measure", type=Path, required=True, help="split file of further ones to measure")
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--period", type=int, default=16)
    parser.add_argument("--slots", type=int, nargs="+", default=[2, 4])
    parser.add_argument(
        "--descents", type=int, default=1, help="of each search of the survey, the second from random codes"
    )
    parser.add_argument("--sensors", nargs="+", choices=SENSORS, default=list(SENSORS))
    how = parser.parse_args()
    listed = read_split(how.design)
    examples = [middle(file, how.size) for file in listed[::2]]
    others = [*listed[1:8:2], *read_split(how.measure)]
    print("measured on", ", ".join(Path(file).stem for file in others), flush=True)
    cubes = [middle(file, how.size) for file in others]
    for name in how.sensors:
        advice = advised(examples, SensorSheet(**SENSORS[name], buckets=2), how.slots, how.period, how.descents)
        print(f"\n{name}\n\n| codes | predicted | measured | scene by scene |\n| --- | --- | --- | --- |")
        print("\n".join(rows(advice, examples, cubes)), flush=True)


if __name__ == "__main__":
    main()
