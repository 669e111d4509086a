"""What ``benchmarks/realtime.py`` measures: every row is a function that gives numbers by name, times in seconds."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from timing import Clock, peak_memory
from torch import Tensor

import tmca
from tmca.data import rendered_scene
from tmca.decoders import decode, make_decoder
from tmca.priors import find_prior
from tmca.training import training_settings
from tmca.training.camera_training import TRAININGS
from tmca.training.patches import Patch

Found = dict[str, float]
SENSOR = tmca.Sensor(read_noise=0.01)
RANDOM = {"slots": 8, "shutter": "random"}
TILED = RANDOM | {"period": 32}
TWO_BUCKETS = TILED | {"shutter": "balanced", "buckets": 2}
_MOST = 7
"""Runs of a median."""


def spectral(settings: Mapping[str, Any]) -> tuple[Any, Any]:
    """Two snapshots of coffee with other noise, 256×256 pixels in 12 bands."""
    return _taken(tmca.SpectralCamera(12, (256, 256), sensor=SENSOR, **settings), tmca.read("coffee"))


def large() -> tuple[Any, Any]:
    """660×660 pixels in 28 bands behind one random mask, two pixels a band."""
    waves = np.linspace(453.3e-9, 648.1e-9, 28).tolist()
    camera = tmca.SpectralCamera(waves, (660, 660), 1, shutter="open", dispersion=2.0, sensor=SENSOR)
    scene = rendered_scene("coffee", wavelengths=waves, size=(400, 600))["radiance"]
    return _taken(camera, _laid(scene, (660, 660)))


def _laid(scene: Any, size: tuple[int, int]) -> Any:
    """A scene that is mirrored where it is smaller."""
    room = {axis: (0, max(0, side - scene.sizes[axis])) for axis, side in zip(("y", "x"), size, strict=True)}
    return scene.drop_vars(("y", "x"), errors="ignore").pad(room, mode="symmetric")


def _taken(camera: Any, scene: Any) -> tuple[Any, Any]:
    first, second = (tmca.simulate(scene, camera, seed=seed) for seed in (0, 1))
    return first, second


def both_first(taken: tuple[Any, Any], name: str) -> Found:
    """As `prepared`, with the deviation; before it a first frame without."""
    find_prior(taken[0].camera, None, make_decoder(name, taken[0].camera.kind).prior_kind)
    alone = Clock().seconds(lambda: decode(taken[0], name, uncertainty=False))
    return {"first without deviation": alone} | prepared(taken, name, uncertainty=True)


def prepared(taken: tuple[Any, Any], name: str, **options: Any) -> Found:
    """Seconds of a first frame, of preparing and of a next frame, and the largest difference that preparing makes."""
    decoder, clock, made = make_decoder(name, taken[0].camera.kind, options), Clock(), list[Any]()
    find_prior(taken[0].camera, None, decoder.prior_kind)  # learned before any frame, and cached
    first = clock.seconds(lambda: made.append(decode(taken[0], name, **options)))
    before = decode(taken[1], name, **options)
    preparing = clock.seconds(lambda: made.append(decoder.prepare(taken[0].camera)))
    difference = float((made[-1](taken[1]).values - before.values).abs().max())
    next_frame = clock.median(lambda: made[-1](taken[1]), _MOST)
    return {"first": first, "preparing": preparing, "next": next_frame, "largest difference": difference}


def alone(taken: tuple[Any, Any], name: str, repeats: int = 3, **options: Any) -> Found:
    """Seconds of a frame by a decoder that nothing is prepared for."""
    find_prior(taken[0].camera, None, make_decoder(name, taken[0].camera.kind).prior_kind)
    warm = int(repeats > 1)
    return {"next": Clock().median(lambda: decode(taken[1], name, **options), repeats, warm)}


def two_buckets() -> Found:
    """Beside one bucket."""
    one = prepared(spectral(TILED), "lmmse", uncertainty=True)
    found = prepared(spectral(TWO_BUCKETS), "lmmse", uncertainty=True)
    return found | {"over one bucket": found["next"] / one["next"]}


def fast() -> Found:
    """The smaller bank, and what it loses against the exact estimate."""
    taken = spectral(TILED)
    truth = _scene(taken[0].camera)
    quick = make_decoder("lmmse", "spectral", {"uncertainty": True, "fast": True}).prepare(taken[0].camera)
    exact = decode(taken[1], "lmmse")
    errors = [(one.values - truth).square().mean().log10() for one in (quick(taken[1]), exact)]
    return {"next": Clock().median(lambda: quick(taken[1]), _MOST), "loss, dB": float(10 * (errors[0] - errors[1]))}


def from_bank() -> Found:
    """A first frame from a bank in a file."""
    (first, _), how = spectral(TILED), {"uncertainty": True}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "bank.safetensors"
        make_decoder("lmmse", "spectral", how).prepare(first.camera, bank=file)
        return {
            "first": Clock().seconds(
                lambda: make_decoder("lmmse", "spectral", how).prepare(first.camera, bank=file)(first)
            )
        }


def of_large() -> Found:
    """With the peak of the process's memory."""
    return both_first(large(), "lmmse") | {"peak, GB": peak_memory()}


def light_field() -> tuple[Any, Any]:
    """Two snapshots of 270×480 pixels in 5×5 views behind tiles of 16."""
    camera = tmca.LightFieldCamera(5, (270, 480), 8, period=16, sensor=SENSOR)
    return _taken(camera, tmca.read("coffee", kind="light-field"))


def spectral_depth() -> tuple[Any, Any]:
    """Two snapshots of 256×256 pixels in 25 bands behind the masks of the thesis."""
    camera = tmca.SpectralDepthCamera.from_preset("thesis", sensor=SENSOR)
    return _taken(camera, camera.fitted(tmca.read("coffee", kind="spectral-depth")))


def likelihood() -> Found:
    """Beside the floor, the operator forward and back."""
    from tmca.data.in_memory import as_tensors

    taken = spectral_depth()
    camera = taken[0].camera
    cube, depth = as_tensors(camera.fitted(tmca.read("coffee", kind="spectral-depth")))

    def there_and_back() -> Tensor:
        return camera.A_adjoint(camera.A(cube, depth), depth)

    found = prepared(taken, "likelihood")
    with torch.no_grad():
        return found | {"floor": Clock().median(there_and_back, _MOST)}


def training() -> Found:
    """Steps of 16 patches of 64×64 pixels, forward and back, over the one whose first estimates are computed anew."""
    seconds = {learn: _step(*_system(learn)) for learn in ("none", "both")}
    system, patches = _system("none")
    cached = _step(system, patches, system.start(patches, 0, range(len(patches))))
    anew = seconds["none"]
    return {"anew": anew, "cached over anew": cached / anew, "learned over anew": seconds["both"] / anew}


def _step(system: Any, patches: list[Patch], start: Tensor | None = None) -> float:
    return Clock().median(lambda: system(patches, 0, range(len(patches)), start).backward(), 5)


def _system(learn: str) -> tuple[Any, list[Patch]]:
    """The quick preset, and a batch of it."""
    settings, kind = training_settings("spectral", "quick", None, {"camera.learn": learn}), TRAININGS["spectral"]
    camera = kind.camera(settings, lambda: tmca.read("coffee"))
    network = kind.network(settings, camera)
    system = kind.system(settings, camera, network, [SENSOR], find_prior(camera, None, "gaussian"))
    corners = range(0, 256, 64)
    cut = [_scene(camera)[0, :, top : top + 64, left : left + 64] for top in corners for left in corners]
    return system.train(), [Patch(one, one, "") for one in cut]


def operators() -> Found:
    """Forward model and adjoint over a copy of the cube."""
    from spectral import SHAPES, measure

    found = {}
    for shape in SHAPES:
        times, size = measure(shape, 50), "×".join(str(side) for side in shape if side > 1)
        found |= {f"{name} at {size}": times[name] / times["copy"] for name in ("forward", "adjoint")}
    return found


def _scene(camera: Any) -> Tensor:
    """(1, L, H, W) coffee at a camera's bands."""
    from tmca.data.in_memory import as_tensors

    scene: Tensor = as_tensors(camera.fitted(tmca.read("coffee")))[0]
    return scene


def live(exposures: int = 3600) -> Found:
    """Estimates a second of `tmca live` with the simulated bench and a recording, all on this core, and its memory."""
    with tempfile.TemporaryDirectory() as folder:
        snapshot, export = f"{folder}/s.nc", f"{folder}/patterns"
        codes = ["--slots", "8", "--shutter", "random", "--period", "32", "--read-noise", "0.01", "--bands", "12"]
        _run("simulate", "spectral", "coffee", "--crop", "256x256", *codes, "--out", snapshot)
        _run("export", snapshot, "--device", "dli4120", "--device", "coded-exposure", "--out", export, "--no-figures")
        how = ["--scene", "coffee", "--drift", "0,1", "--no-page", "--json", "--rate", "100"]
        words = ("live", export, *how, "--exposures", f"{exposures}", "--record", f"{folder}/r.zarr")
        process = subprocess.Popen([sys.executable, "-m", "tmca", *words], stdout=subprocess.PIPE, text=True)
        held = _memory_while(process)
        said = json.loads(process.stdout.read() if process.stdout else "")
    minute, end = held[min(60, len(held) - 1)], held[-1]
    kept = {"estimates a second": said["rate"], "estimates": said["estimates"], "dropped": said["dropped"]}
    return kept | {"seconds": len(held), "GB after a minute": minute, "GB at the end": end}


def _memory_while(process: subprocess.Popen[str]) -> list[float]:
    """GB that a process holds, every second until it ends."""
    held, status = list[float](), Path(f"/proc/{process.pid}/status")
    while process.poll() is None:
        held += [int(line.split()[1]) / 1e6 for line in status.read_text().splitlines() if line.startswith("VmRSS")]
        time.sleep(1)
    return held


def _run(*words: str) -> str:
    return subprocess.run([sys.executable, "-m", "tmca", *words], check=True, capture_output=True, text=True).stdout


class Row(NamedTuple):
    """A task.

    Args:
        what: is decoded.
        goals: by the names of figures.
        measure: gives the figures.
        before: the same of a package that could not prepare anything, where it could do the task.
    """

    what: str
    goals: Found
    measure: Callable[[], Found]
    before: Callable[[], Found] | None = None


ROWS: dict[str, Row] = {
    "tiled": Row(
        "256×256×12, tiles of 32, LMMSE with deviation",
        {"next": 0.08, "preparing": 3.0, "largest difference": 1e-4},
        lambda: prepared(spectral(TILED), "lmmse", uncertainty=True),
        lambda: alone(spectral(TILED), "lmmse", uncertainty=True),
    ),
    "fast": Row("the same, fast bank", {"next": 0.04, "loss, dB": 0.1}, fast),
    "bank": Row("the same, from a bank in a file", {"first": 0.3}, from_bank),
    "untiled": Row(
        "256×256×12, codes that do not repeat, LMMSE with deviation",
        {"first": 1.5, "first without deviation": 1.5, "next": 0.5},
        lambda: both_first(spectral(RANDOM), "lmmse"),
        lambda: alone(spectral(RANDOM), "lmmse", uncertainty=True),
    ),
    "large": Row(
        "660×660×28, one mask, 2 px a band, LMMSE with deviation",
        {"first": 25.0, "first without deviation": 25.0, "next": 8.0, "peak, GB": 4.0},
        of_large,
        lambda: alone(large(), "lmmse", 1, uncertainty=True),
    ),
    "mixture": Row(
        "256×256×12, tiles of 32, mixture with deviation",
        {"next": 1.0},
        lambda: prepared(spectral(TILED), "mixture", uncertainty=True),
        lambda: alone(spectral(TILED), "mixture", 1, uncertainty=True),
    ),
    "light field": Row(
        "270×480×25 views, tiles of 16, LMMSE with deviation",
        {"next": 0.1},
        lambda: prepared(light_field(), "lmmse", uncertainty=True),
        lambda: alone(light_field(), "lmmse", uncertainty=True),
    ),
    "likelihood": Row(
        "spectral-depth 256×256×25, patch likelihood",
        {"next": 0.5},
        likelihood,
        lambda: alone(spectral_depth(), "likelihood", 1),
    ),
    "two buckets": Row(
        "256×256×12, tiles of 32, two buckets, LMMSE with deviation", {"over one bucket": 2.5}, two_buckets
    ),
    "space-time": Row(
        "256×256×12, tiles of 32, two buckets, four frames",
        {},
        lambda: alone(spectral(TWO_BUCKETS), "space-time-lmmse"),
    ),
    "admm": Row(
        "256×256×12, ADMM-TV joint",
        {"next": 0.6},
        lambda: alone(spectral(RANDOM), "admm-tv-joint"),
        lambda: alone(spectral(RANDOM), "admm-tv-joint"),
    ),
    "admm, large": Row(
        "660×660×28, ADMM-TV joint",
        {"next": 20.0},
        lambda: alone(large(), "admm-tv-joint"),
        lambda: alone(large(), "admm-tv-joint", 1),
    ),
    "training": Row(
        "a training step from the LMMSE, 16 patches of 64×64",
        {"cached over anew": 0.25, "learned over anew": 1.5},
        training,
    ),
    "operators": Row(
        "spectral camera, K = 8, over a copy of the cube",
        {f"{name} at {size}": 2.5 for size in ("8×12×128×128", "28×256×256") for name in ("forward", "adjoint")},
        operators,
        operators,
    ),
    "live": Row("`tmca live`, simulated bench, 256×256×12, recorded", {"estimates a second": 10.0}, live),
}
"""By short name."""
