"""What ``tmca.register`` loses against the true mask: ``python benchmarks/registration.py --scenes SPLIT``.

Each draw images a scene behind a mask that lies elsewhere than the camera says: shifted by up to 2 pixels along each
axis, rotated by up to 0.5°, scaled by up to 1 %, the dispersion wrong by up to 1 %. The LMMSE then decodes with the
true mask, with the one that was registered and with the one that was drawn.
"""

from __future__ import annotations

import argparse
import math
import shlex
import statistics
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from timing import Clock

import tmca
from tmca.codes import Codes
from tmca.data import read_array, read_split
from tmca.optics.spectral import on_columns
from tmca.registration.placement import SmoothPlanes, seen_from
from tmca.workers import in_processes

SIZE, NOISE = (256, 256), 0.01
BANDS = {12: (np.linspace(400e-9, 700e-9, 12), 1.0), 28: (np.linspace(453.3e-9, 648.1e-9, 28), 2.0)}
"""Wavelengths and pixels of dispersion a band."""
ALLOWED = 1.0
"""dB."""


@dataclass(frozen=True)
class Draw:
    """Where a mask lies, and what it costs.

    Args:
        shift, rotation, scale, dispersion: that were drawn: pixels, degrees, factors.
        true, registered, drawn: PSNR of the LMMSE with the true mask, the registered one and the one of the camera, dB.
        seconds: of `register`, CPU time.
        converged: a place stood out.
    """

    bands: int
    scene: str
    shift: tuple[float, float]
    rotation: float
    scale: float
    dispersion: float
    true: float
    registered: float
    drawn: float
    seconds: float
    converged: bool

    @property
    def loss(self) -> float:
        """dB."""
        return self.true - self.registered

    def __str__(self) -> str:
        shift = f"{self.shift[0]:+.2f}, {self.shift[1]:+.2f}"
        place = f"{shift}, {self.rotation:+.2f}°, {self.scale:.4f}, {self.dispersion:.4f}"
        losses = f"{self.loss:+.2f} | {self.true - self.drawn:+.2f}"
        return f"| {self.scene} | {place} | {self.true:.2f} | {losses} | {self.seconds:.0f} |"


def imaged(
    camera: tmca.SpectralCamera, scene: torch.Tensor, vector: np.ndarray, dispersion: float, seed: int
) -> tuple[tmca.Snapshot, tmca.Snapshot]:
    """A snapshot with its true camera, and on the columns of the one that was drawn, which it is taken to be of."""
    aperture, shutter = camera.codes()
    planes = SmoothPlanes(aperture)(*seen_from(torch.as_tensor(vector, dtype=torch.float32), SIZE))
    bands = camera.dispersion.scaled(dispersion)
    first = -bands.origin
    codes = Codes(planes, on_columns(shutter, first, SIZE[1] + bands.extent))
    true = camera.replace(codes=codes, dispersion=bands)
    values = true(scene, generator=seed)
    narrow = on_columns(values, -first, camera.snapshot_shape[-1])
    return tmca.Snapshot(values, true), tmca.Snapshot(narrow, camera)


def draw(bands: int, scene: str, mask: Path | None, seed: int) -> Draw:
    """One of the draws."""
    waves, step = BANDS[bands]
    cube = tmca.read(scene).interp(wavelength=waves.tolist()).astype("float32")
    truth = torch.from_numpy(np.ascontiguousarray(cube.values))[None]
    aperture = "random" if mask is None else torch.from_numpy(np.asarray(read_array(mask), dtype=np.float32))[None]
    sensor = tmca.Sensor(read_noise=NOISE)
    camera = tmca.SpectralCamera(
        waves.tolist(), SIZE, 1, aperture=aperture, shutter="open", dispersion=step, sensor=sensor, seed=1
    )
    rng, half = np.random.default_rng([bands, seed]), max(SIZE) / 2
    down, right, rotation, scale, wider = rng.uniform(-1, 1, 5) * (2, 2, 0.5, 0.01, 0.01)
    vector = np.array([down, right, math.radians(rotation) * half, scale * half, 0, 0, 0, 0])
    true, taken = imaged(camera, truth, vector, 1 + wider, seed)
    made: list[tmca.registration.Registered] = []
    seconds = Clock().seconds(lambda: made.append(tmca.register(taken)))
    decoded = (tmca.reconstruct(one, "lmmse", uncertainty=False) for one in (true, made[0].snapshot, taken))
    decibels = [float(tmca.metrics.psnr(one.values.clamp(0, 1), truth)) for one in decoded]
    place = (float(down), float(right)), float(rotation), 1 + float(scale), 1 + float(wider)
    return Draw(bands, Path(scene).stem, *place, *decibels, seconds, made[0].converged)


def summary(draws: Sequence[Draw]) -> list[str]:
    """A table of all draws, by number of bands."""
    titles = (
        "bands",
        "draws",
        f"within {ALLOWED:g} dB",
        "loss, median",
        "largest",
        "as drawn, median",
        "CPU s",
        "most",
    )
    lines = [f"| {' | '.join(titles)} |", f"| {' | '.join(['---'] * len(titles))} |"]
    for bands in sorted({one.bands for one in draws}):
        own = [one for one in draws if one.bands == bands]
        losses, seconds = [one.loss for one in own], [one.seconds for one in own]
        unregistered = statistics.median(one.true - one.drawn for one in own)
        lines.append(
            f"| {bands} | {len(own)} | {sum(loss <= ALLOWED for loss in losses)} | {statistics.median(losses):.2f} dB "
            f"| {max(losses):.2f} dB | {unregistered:.1f} dB | {statistics.median(seconds):.0f} | {max(seconds):.0f} |"
        )
    return lines


def page(draws: Sequence[Draw], given: Sequence[str]) -> str:
    """All draws as Markdown."""
    from tmca.evaluation.tables import repository_commit

    command = shlex.join(["python", "benchmarks/registration.py", *given])
    within = sum(one.loss <= ALLOWED for one in draws)
    lines = ["# Masks in register, from the snapshot alone", ""]
    lines += [f"Command: `{command}` at commit `{repository_commit()}`.", "", _WORDS, ""]
    lines += [f"**In {within} of {len(draws)} draws the loss is {ALLOWED:g} dB or less.**", "", *summary(draws)]
    for bands in sorted({one.bands for one in draws}):
        lines += ["", f"## {bands} bands", "", "| scene | place | true mask, dB | loss | as drawn | CPU s |"]
        lines += ["| --- | --- | --- | --- | --- | --- |", *(str(one) for one in draws if one.bands == bands)]
    return "\n".join(lines) + "\n"


_WORDS = f"""Scenes of {SIZE[0]}×{SIZE[1]} pixels through one mask and one prism, σ = {NOISE:g}; 12 bands
(400 to 700 nm, 1 pixel a band) or 28 (453 to 648 nm, 2 pixels). *Place* is where the mask lies: pixels down and
right, rotation, scale, and dispersion over that of the camera. *Loss* is in PSNR of the patch LMMSE, against the one
with the true mask, of the mask that `tmca.register` found and, *as drawn*, of the one that the camera has. All use the
prior of the rendered scenes. CPU seconds are those of `register` on one thread."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=Path, required=True, help="split file")
    parser.add_argument("--draws", type=int, nargs="+", default=[30, 20], help="of each number of bands")
    parser.add_argument("--bands", type=int, nargs="+", choices=BANDS, default=list(BANDS))
    parser.add_argument("--mask", type=Path, help="file of one of 256×256 pixels; a random one without it")
    parser.add_argument("--seed", type=int, default=0, help="of the first draw")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, help="a page of the results, Markdown")
    options = parser.parse_args()
    scenes = [str(path) for path in read_split(options.scenes)]
    counts = zip(options.bands, options.draws * (len(options.bands) // len(options.draws)), strict=True)
    seeds = [(bands, options.seed + number) for bands, count in counts for number in range(count)]
    work = [(bands, scenes[seed % len(scenes)], options.mask, seed) for bands, seed in seeds]
    work.sort(key=lambda piece: piece[-1])
    found: dict[int, Draw] = {}
    for place, one in in_processes(draw, work, options.jobs):
        found[place] = one
        print(f"{len(found)} of {len(work)}: {asdict(one)}", flush=True)
        if options.out is not None:
            options.out.write_text(page([found[place] for place in sorted(found)], sys.argv[1:]))
    print("\n".join(summary(list(found.values()))))


if __name__ == "__main__":
    main()
