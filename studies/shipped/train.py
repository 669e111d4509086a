"""The network and the prior that come with tmca for spectral cameras of any bands, codes, buckets and noise.

``make train-shipped`` does the first two of these steps. On any machine with the data::

    python -m studies.shipped.train pack ../shared/data/splits --out runs/shipped/cubes

writes ``{train,val}.xz`` and ``about.pt``: names of the scenes, and the mask of the benchmark. Then, on a graphics
processor where there is one::

    python -m studies.shipped.train fit runs/shipped/cubes --out runs/shipped --seconds 600

draws cameras and scenes for a part of the time, learns for the rest, and writes ``state.pt`` (below 16 MB) with every
report. Run again, it goes on from there with other cameras and scenes, unless ``--fresh``; stopped, it loses what it
learned since the last report. ::

    python -m studies.shipped.train ship runs/shipped/cubes --load runs/shipped/state.pt --trained "on one H100"

writes the files that come with the package.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from torch import Tensor

import tmca
from studies.shipped.pool import KNOTS, Example, benchmark_camera, drawn_camera, example, gains
from studies.shipped.scenes import read_cubes, write_cubes
from tmca.cameras import SpectralCamera
from tmca.data import atomic_path
from tmca.decoders import SubspaceNetwork, Weights
from tmca.priors import SubspacePrior
from tmca.sensor import Noise

SETTINGS: dict[str, Any] = {"rank": 16, "stages": 3, "widths": (80, 112, 144), "blocks": 2, "gather": 2}
BLOCK = (12, 122)
"""Rows and columns of the prior: enough for 54 columns of dispersion."""
_RATE, _WARM, _LAST = 1e-3, 100, 0.02
_ROWS = 128
"""Rows of a scene in a step; all its columns, along which light is dispersed."""
_EARLY, _SPREAD = 0.3, 0.05
"""Weights of the loss of stages before the last, and of that of the standard deviation."""
_FLOOR = 1e-6
_DARKEST = 1e-8
SIZE = (256, 256)
STATE = "state.pt"
FOLDER, UNIVERSAL = Path(tmca.__file__).parent / "weights", "universal"
"""Where ``ship`` writes, and the name of what it writes."""
CAMERAS: dict[str, tuple[dict[str, Any], Noise]] = {
    "K = 8": ({"bands": 12, "slots": 8, "aperture": "random", "shutter": "random", "seed": 5}, Noise(0.01)),
    "two buckets": (
        {"bands": 12, "slots": 4, "aperture": "random", "shutter": "balanced", "buckets": 2, "seed": 6},
        Noise(0.001),
    ),
}
"""Cameras beside that of the benchmark on which validation scenes are decoded."""


def loss_of(steps: Sequence[Any], truth: Tensor) -> Tensor:
    """Logarithm of the mean square error, which weighs dark scenes like bright ones, of the last stage and, less, of
    those before; and the Gaussian likelihood of the errors under the standard deviation that is predicted."""
    *early, last = [torch.log((one.estimate - truth).square().mean((1, 2, 3)) + _FLOOR).mean() for one in steps]
    variance = steps[-1].deviation.square() + _DARKEST
    error = (steps[-1].estimate.detach() - truth).square()
    return last + _EARLY * sum(early) + _SPREAD * 0.5 * (error / variance + variance.log()).mean()


class Average:
    """Exponential moving average of a network's parameters."""

    def __init__(self, network: SubspaceNetwork) -> None:
        self.values = [one.detach().clone() for one in network.parameters()]
        self.steps = 0

    @torch.no_grad()
    def update(self, network: SubspaceNetwork) -> None:
        self.steps += 1
        share = max(1e-3, 1 / (self.steps / 5 + 1))
        torch._foreach_lerp_(self.values, [one.detach() for one in network.parameters()], share)

    @torch.no_grad()
    def swap(self, network: SubspaceNetwork) -> None:
        """Exchange the parameters of a network with their average; a second time, back."""
        for mine, its in zip(self.values, network.parameters(), strict=True):
            held = its.detach().clone()
            its.copy_(mine)
            mine.copy_(held)


@dataclass
class Trained:
    """A network, and for how many steps and seconds it has learned in all pieces, the drawing of scenes left out."""

    network: SubspaceNetwork
    steps: int = 0
    seconds: float = 0.0

    @classmethod
    def of(cls, prior: SubspacePrior, state: Path | None = None) -> Self:
        """One that begins in the subspace of the prior, or goes on from a state; old states have no counts."""
        network = SubspaceNetwork(**SETTINGS)
        mean, basis = prior.mean.cpu(), prior.basis.cpu()
        own = prior.moments[:, :, 0, 0].diagonal().cpu() + (mean @ basis).square()
        network.basis.copy_(basis * own.sqrt())
        if state is None:
            return cls(network)
        stored = torch.load(state, weights_only=True)
        network.load_state_dict(stored["network"])
        return cls(network, stored.get("steps", 0), stored.get("seconds", 0.0))

    def save(self, path: Path) -> None:
        """Write the state, whole or not at all."""
        network = {name: value.cpu() for name, value in self.network.state_dict().items()}
        with atomic_path(path, overwrite=True) as temporary:
            torch.save({"network": network, "steps": self.steps, "seconds": self.seconds}, temporary)


class Fit:
    """Training of one piece."""

    def __init__(self, trained: Trained, pool: list[Example], batch: int, seed: int) -> None:
        self.trained, self.network, self.pool, self.batch = trained, trained.network, pool, batch
        self.average, self.rng = Average(self.network), np.random.default_rng((seed, trained.steps, 1))
        self.optimiser = torch.optim.AdamW(self.network.parameters(), lr=_RATE, weight_decay=1e-4, betas=(0.9, 0.99))

    def step(self, number: int, done: float) -> Tensor:
        """One step when a share of the time is ``done``; the gain of the batch over its first estimates, dB."""
        rate = _RATE * min(1, (number + 1) / _WARM) * (_LAST + (1 - _LAST) * 0.5 * (1 + math.cos(math.pi * done)))
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        one = self.pool[self.rng.integers(len(self.pool))]
        height, device = one.scenes.shape[2], one.scenes.device
        top = 4 * int(self.rng.integers(max(0, height - _ROWS) // 4 + 1))
        chosen = self.rng.choice(len(one.scenes), min(self.batch, len(one.scenes)), replace=False)
        truth, snapshot, operator, start = one.part(slice(top, top + _ROWS), torch.from_numpy(chosen).to(device))
        steps = list(self.network.at(one.wavelengths).steps(snapshot, operator, one.noise, start))
        self.optimiser.zero_grad(set_to_none=True)
        loss_of(steps, truth).backward()
        norm = torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        if torch.isfinite(norm):
            self.optimiser.step()
        self.average.update(self.network)
        self.trained.steps += 1
        errors = [(part - truth).square().mean((1, 2, 3)) for part in (start, steps[-1].estimate.detach())]
        return 10 * torch.log10(errors[0] / errors[1]).mean()


def fit(folder: Path, out: Path, device: torch.device, seconds: float, how: argparse.Namespace) -> None:
    """Draw examples, then learn until the time is over, from where the last piece ended."""
    begun, state = time.perf_counter(), out / STATE
    out.mkdir(parents=True, exist_ok=True)
    cubes, held_out = read_cubes(folder / "train.xz"), read_cubes(folder / "val.xz")
    mask = torch.load(folder / "about.pt", weights_only=True)["mask"][: how.size, : how.size]
    prior = learned(cubes, device)
    trained = Trained.of(prior, state if state.exists() and not how.fresh else None)
    report(f"{device}, {trained.steps} steps in {trained.seconds:.0f} s so far")
    place(trained.network, device)
    rng, size = np.random.default_rng((how.seed, trained.steps)), (how.size, how.size)
    kinds = {"benchmark": benchmark_camera(mask)}
    kinds |= {name: (SpectralCamera(size=size, **given), noise) for name, (given, noise) in CAMERAS.items()}
    checked = {name: example(*one, held_out, prior, rng, 0, device) for name, one in kinds.items()}
    pool: list[Example] = []
    drawing = time.perf_counter() + how.drawing
    while not pool or (len(pool) < how.cameras and time.perf_counter() < drawing):
        one = benchmark_camera(mask) if rng.random() < how.benchmark or not pool else drawn_camera(rng, size)
        pool.append(example(*one, cubes, prior, rng, how.scenes, device))
    report(f"{len(pool)} cameras of {how.scenes} scenes, {time.perf_counter() - begun:.0f} s")
    learn(Fit(trained, pool, how.batch, how.seed), checked, begun + seconds, state)


def place(network: SubspaceNetwork, device: torch.device) -> None:
    """Bring a network to where it learns, its layers laid out for speed; on a graphics processor in half precision."""
    torch.nn.utils.convert_conv2d_weight_memory_format(network.to(device), torch.channels_last)
    if device.type == "cuda":
        torch.backends.cudnn.benchmark = True
        network.body.forward = torch.autocast("cuda", torch.bfloat16)(network.body.forward)  # type: ignore[method-assign]


def learn(fit: Fit, checked: dict[str, Example], end: float, state: Path) -> None:
    """Steps until the time ``end``; every now and then validation figures, and the state stored."""
    begun, number, recent, before = time.perf_counter(), 0, [], fit.trained.seconds
    every, shown = max(30.0, (end - begun) / 10), begun
    while (now := time.perf_counter()) < end:
        recent.append(fit.step(number, (now - begun) / (end - begun)))
        number += 1
        fit.trained.seconds = before + time.perf_counter() - begun
        if now - shown > every or number == 20:
            shown = now
            figures(fit, checked, f"step {number}, training {float(torch.stack(recent).mean()):+.2f} dB", state)
            recent.clear()
    figures(fit, checked, f"step {number}, the end", state)


@torch.no_grad()
def figures(fit: Fit, checked: dict[str, Example], when: str, state: Path) -> None:
    """Store the averaged network, and report it on validation scenes."""
    fit.average.swap(fit.network)
    fit.trained.save(state)
    every = {name: gains(fit.network, one) for name, one in checked.items()}
    shown = [f"{name} " + " ".join(f"{a:.2f}{b:+.2f}" for a, b in rows) for name, rows in every.items()]
    report(" | ".join((when, *shown)))
    fit.average.swap(fit.network)


def learned(cubes: Sequence[Tensor], device: torch.device) -> SubspacePrior:
    """The prior of the training scenes."""
    cubes = [cube.double().to(device) for cube in cubes]
    return SubspacePrior.learn(cubes, BLOCK, rank=SETTINGS["rank"], wavelengths=KNOTS.tolist())


def report(text: str) -> None:
    print(text, flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    packing = commands.add_parser("pack")
    packing.add_argument("splits", type=Path)
    packing.add_argument("--out", type=Path, default=Path("cubes"))
    fitting = commands.add_parser("fit")
    fitting.add_argument("folder", type=Path)
    fitting.add_argument("--out", type=Path, default=Path())
    fitting.add_argument("--device", default="auto", help="auto: cuda where there is one, else cpu")
    fitting.add_argument("--fresh", action="store_true", help=f"begin anew, whatever {STATE} holds")
    numbers = {"seconds": 600.0, "drawing": 70.0, "cameras": 64, "scenes": 16, "batch": 6, "benchmark": 0.3}
    for name, value in {**numbers, "seed": 0, "size": SIZE[0]}.items():
        fitting.add_argument(f"--{name}", type=type(value), default=value)
    shipping = commands.add_parser("ship")
    shipping.add_argument("folder", type=Path)
    shipping.add_argument("--load", type=Path, required=True)
    shipping.add_argument("--trained", required=True, help="on which machine, for the card")
    how = parser.parse_args(arguments)
    if how.command == "pack":
        pack(how.splits, how.out)
    elif how.command == "ship":
        ship(how.folder, how.load, how.trained)
    else:
        best = "cuda" if torch.cuda.is_available() else "cpu"
        fit(how.folder, how.out, torch.device(best if how.device == "auto" else how.device), how.seconds, how)


def ship(folder: Path, state: Path, trained: str) -> None:
    """Write network and prior into the package."""
    prior = learned(read_cubes(folder / "train.xz"), torch.device("cpu"))
    names = torch.load(folder / "about.pt", weights_only=True)["train"]
    replace(prior, sources=tuple(names)).save(FOLDER / f"{UNIVERSAL}-prior.nc", overwrite=True)
    network = Trained.of(prior, state)
    counts = {"steps": network.steps, "seconds": round(network.seconds)}
    card = {"trained": trained, **counts, "scenes": list(names), "recipe": "studies/shipped/train.py"}
    camera = SpectralCamera(KNOTS.tolist(), (16, 16), 1, aperture="static", shutter="open")
    weights = Weights.of(network.network, camera, f"{UNIVERSAL}-prior.nc", card)
    weights.save(FOLDER / f"{UNIVERSAL}.safetensors", overwrite=True)


def pack(splits: Path, out: Path) -> None:
    """Write the cubes and the mask of the benchmark."""
    from scipy.io import loadmat

    from tmca.data import read

    out.mkdir(parents=True, exist_ok=True)
    about: dict[str, Any] = {}
    for split in ("train", "val"):
        about[split] = names = (splits / f"cave_{split}.txt").read_text().split()
        scenes = [read(splits.parent / name, wavelengths=KNOTS) for name in names]
        write_cubes([torch.from_numpy(scene.values.astype(np.float32)) for scene in scenes], out / f"{split}.xz")
    mask = loadmat(splits.parent / "cassi/tsa/mask_256_sim.mat")["mask"].astype(np.float32)
    torch.save({**about, "mask": torch.from_numpy(mask)}, out / "about.pt")


if __name__ == "__main__":
    main()
