"""The network and the prior that come with tmca for spectral cameras of any bands, codes, buckets and noise.

``make train-shipped`` does all three of these steps. On any machine with the data::

    python -m studies.shipped.train pack ../shared/data/splits --out runs/shipped/cubes

writes ``{train,val}.xz`` and ``about.pt``: names of the scenes, and the mask of the benchmark. Then, on a graphics
processor where there is one::

    python -m studies.shipped.train fit runs/shipped/cubes --out runs/shipped --seconds 600

draws cameras and scenes for a part of the time, learns for the rest, and writes ``state.pt`` (below 16 MB) with every
report. Run again, it goes on from there with other cameras and scenes, unless ``--fresh``; stopped, it loses what it
learned since the last report. The size of the network is ``large`` on a graphics processor and ``small`` elsewhere,
unless ``--preset`` says another (`studies.shipped.presets`). ::

    python -m studies.shipped.train ship runs/shipped/cubes --load runs/shipped/state.pt --trained "on one H100" --out .

writes ``universal.safetensors`` and its prior, for ``tmca reconstruct --weights``; without ``--out`` into the package.
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
from studies.shipped.presets import BLOCK, PRESETS, RANK, Preset
from studies.shipped.scenes import read_cubes, write_cubes
from tmca.cameras import SpectralCamera
from tmca.data import atomic_path
from tmca.decoders import SubspaceNetwork, Weights
from tmca.devices import computes_half
from tmca.priors import SubspacePrior
from tmca.sensor import Noise

_RATE, _WARM, _LAST = 1e-3, 100, 0.02
_ROWS = 128
"""Rows of a scene in a step; all its columns, along which light is dispersed."""
_EARLY, _SPREAD = 0.3, 0.05
"""Weights of the loss of stages before the last, and of that of the standard deviation."""
_FLOOR = 1e-6
_DARKEST = 1e-8
_BENCHMARK = 0.3
"""Share of the cameras that are that of the benchmark."""
STATE = "state.pt"
FOLDER, UNIVERSAL = Path(tmca.__file__).parent / "weights", "universal"
"""Where ``ship`` writes unless it is told another folder, and the name of what it writes."""
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
    def new(cls, prior: SubspacePrior, preset: Preset) -> Self:
        """One that begins in the subspace of the prior."""
        network = SubspaceNetwork(rank=prior.basis.shape[1], **preset.network)
        mean, basis = prior.mean.cpu(), prior.basis.cpu()
        own = prior.moments[:, :, 0, 0].diagonal().cpu() + (mean @ basis).square()
        network.basis.copy_(basis * own.sqrt())
        return cls(network)

    @classmethod
    def load(cls, state: Path) -> Self:
        """What a piece has written."""
        stored = torch.load(state, weights_only=True)
        if "settings" not in stored:
            raise SystemExit(f"{state}: written before there were presets; begin anew with --fresh")
        network = SubspaceNetwork(**stored["settings"])
        network.load_state_dict(stored["network"])
        return cls(network, stored["steps"], stored["seconds"])

    def save(self, path: Path) -> None:
        """Write the state, whole or not at all."""
        network = {name: value.cpu() for name, value in self.network.state_dict().items()}
        with atomic_path(path, overwrite=True) as temporary:
            counts = {"steps": self.steps, "seconds": self.seconds}
            torch.save({"network": network, "settings": self.network.settings, **counts}, temporary)


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


def fit(folder: Path, out: Path, device: torch.device, preset: Preset, how: argparse.Namespace) -> None:
    """Draw examples, then learn until the time is over, from where the last piece ended."""
    begun, state = time.perf_counter(), out / STATE
    out.mkdir(parents=True, exist_ok=True)
    cubes, held_out = read_cubes(folder / "train.xz"), read_cubes(folder / "val.xz")
    prior, resumed = learned(cubes, device), state.exists() and not how.fresh
    trained = Trained.load(state) if resumed else Trained.new(prior, preset)
    if how.preset and trained.network.settings != Trained.new(prior, preset).network.settings:
        raise SystemExit(f"{state}: a network of another preset than {how.preset}; go on without --preset, or --fresh")
    parameters = sum(one.numel() for one in trained.network.parameters())
    report(f"{device}, {parameters} parameters, {trained.steps} steps in {trained.seconds:.0f} s so far")
    place(trained.network, device)
    rng = np.random.default_rng((how.seed, trained.steps))
    mask = torch.load(folder / "about.pt", weights_only=True)["mask"][: preset.size, : preset.size]
    kinds = {"benchmark": benchmark_camera(mask)}
    size = (preset.size, preset.size)
    kinds |= {name: (SpectralCamera(size=size, **given), noise) for name, (given, noise) in CAMERAS.items()}
    checked = {name: example(*one, held_out, prior, rng, 0, device) for name, one in kinds.items()}
    pool = examples(preset, cubes, prior, mask, rng, device)
    report(f"{len(pool)} cameras of {preset.scenes} scenes, {time.perf_counter() - begun:.0f} s")
    learn(Fit(trained, pool, preset.batch, how.seed), checked, begun + how.seconds, state)


def examples(
    preset: Preset,
    cubes: Sequence[Tensor],
    prior: SubspacePrior,
    mask: Tensor,
    rng: np.random.Generator,
    device: torch.device,
) -> list[Example]:
    """What a piece learns from: the camera of the benchmark, and others, until their number or the time is reached."""
    pool: list[Example] = []
    end, size = time.perf_counter() + preset.drawing, (preset.size, preset.size)
    while not pool or (len(pool) < preset.cameras and time.perf_counter() < end):
        one = benchmark_camera(mask) if rng.random() < _BENCHMARK or not pool else drawn_camera(rng, size)
        pool.append(example(*one, cubes, prior, rng, preset.scenes, device))
    return pool


def place(network: SubspaceNetwork, device: torch.device) -> None:
    """Bring a network to where it learns, laid out for speed, and in half precision where the device computes it."""
    torch.nn.utils.convert_conv2d_weight_memory_format(network.to(device), torch.channels_last)
    torch.backends.cudnn.benchmark = device.type == "cuda"
    if computes_half(device):
        network.body.forward = torch.autocast(device.type, torch.bfloat16)(network.body.forward)  # type: ignore[method-assign]


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
    return SubspacePrior.learn(cubes, BLOCK, rank=RANK, wavelengths=KNOTS.tolist())


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
    fitting.add_argument("--preset", choices=PRESETS, help="usually large on a graphics processor, small elsewhere")
    fitting.add_argument("--seconds", type=float, default=600.0, help="of this piece, in all")
    fitting.add_argument("--seed", type=int, default=0)
    numbers = {
        name: type(getattr(PRESETS["small"], name)) for name in ("size", "cameras", "scenes", "drawing", "batch")
    }
    for name, kind in numbers.items():
        fitting.add_argument(f"--{name}", type=kind, help="in the place of the preset's")
    shipping = commands.add_parser("ship")
    shipping.add_argument("folder", type=Path)
    shipping.add_argument("--load", type=Path, required=True)
    shipping.add_argument("--trained", required=True, help="on which machine, for the card")
    shipping.add_argument("--out", type=Path, default=FOLDER, help="usually the package")
    how = parser.parse_args(arguments)
    if how.command == "pack":
        pack(how.splits, how.out)
    elif how.command == "ship":
        ship(how.folder, how.load, how.trained, how.out)
    else:
        best = "cuda" if torch.cuda.is_available() else "cpu"
        device = torch.device(best if how.device == "auto" else how.device)
        preset = PRESETS[how.preset or ("large" if device.type == "cuda" else "small")]
        given = {name: getattr(how, name) for name in numbers if getattr(how, name) is not None}
        fit(how.folder, how.out, device, replace(preset, **given), how)


def ship(folder: Path, state: Path, trained: str, out: Path) -> None:
    """Write network and prior into a folder."""
    out.mkdir(parents=True, exist_ok=True)
    prior = learned(read_cubes(folder / "train.xz"), torch.device("cpu"))
    names = torch.load(folder / "about.pt", weights_only=True)["train"]
    replace(prior, sources=tuple(names)).save(out / f"{UNIVERSAL}-prior.nc", overwrite=True)
    network = Trained.load(state)
    counts = {"steps": network.steps, "seconds": round(network.seconds)}
    card = {"trained": trained, **counts, "scenes": list(names), "recipe": "studies/shipped/train.py"}
    camera = SpectralCamera(KNOTS.tolist(), (16, 16), 1, aperture="static", shutter="open")
    weights = Weights.of(network.network, camera, f"{UNIVERSAL}-prior.nc", card)
    weights.save(out / f"{UNIVERSAL}.safetensors", overwrite=True)


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
