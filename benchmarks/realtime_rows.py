"""What ``benchmarks/realtime.py`` measures: every row is a function that gives numbers by name, times in seconds."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
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
from tmca.training.engine import choose_precision
from tmca.training.patches import Patch

Found = dict[str, float]
SENSOR = tmca.Sensor(read_noise=0.01)
RANDOM = {"slots": 8, "shutter": "random"}
TILED = RANDOM | {"period": 32}
TWO_BUCKETS = TILED | {"shutter": "balanced", "buckets": 2}
WITH_DEVIATION = {"uncertainty": True}
_MOST = 7
"""Runs of a median."""


class Taken(NamedTuple):
    """Two snapshots of a scene, with other noise."""

    first: Any
    second: Any
    scene: Any


def spectral(settings: Mapping[str, Any]) -> Taken:
    """Coffee, 256×256 pixels in 12 bands."""
    return _taken(tmca.SpectralCamera(12, (256, 256), sensor=SENSOR, **settings), tmca.read("coffee"))


def large() -> Taken:
    """660×660 pixels in 28 bands behind one random mask, two pixels a band."""
    waves = np.linspace(453.3e-9, 648.1e-9, 28).tolist()
    camera = tmca.SpectralCamera(waves, (660, 660), 1, shutter="open", dispersion=2.0, sensor=SENSOR)
    scene = rendered_scene("coffee", wavelengths=waves, size=(400, 600))["radiance"]
    return _taken(camera, _laid(scene, (660, 660)))


def _laid(scene: Any, size: tuple[int, int]) -> Any:
    """A scene that is mirrored where it is smaller."""
    room = {axis: (0, max(0, side - scene.sizes[axis])) for axis, side in zip(("y", "x"), size, strict=True)}
    return scene.drop_vars(("y", "x"), errors="ignore").pad(room, mode="symmetric")


def _taken(camera: Any, scene: Any) -> Taken:
    first, second = (tmca.simulate(scene, camera, seed=seed) for seed in (0, 1))
    return Taken(first, second, scene)


def light_field() -> Taken:
    """270×480 pixels in 5×5 views behind tiles of 16."""
    camera = tmca.LightFieldCamera(5, (270, 480), 8, period=16, sensor=SENSOR)
    return _taken(camera, tmca.read("coffee", kind="light-field"))


def spectral_depth() -> Taken:
    """256×256 pixels in 25 bands behind the masks of the thesis."""
    camera = tmca.SpectralDepthCamera.from_preset("thesis", sensor=SENSOR)
    return _taken(camera, tmca.read("coffee", kind="spectral-depth"))


def prepared(taken: Taken, name: str, **options: Any) -> Found:
    """Seconds of a first frame, of preparing and of a next frame, and what the process held at most; the PSNR, and the
    largest difference that preparing makes."""
    decoder, clock, made = _decoder(taken, name, options), Clock(), list[Any]()
    first = clock.seconds(lambda: made.append(decode(taken.first, name, **options)))
    anew = decode(taken.second, name, **options)
    preparing = clock.seconds(lambda: made.append(decoder.prepare(taken.first.camera)))
    estimate = made[-1](taken.second)
    difference = float((estimate.values - anew.values).abs().max())
    next_frame = clock.median(lambda: made[-1](taken.second), _MOST)
    found = {"first": first, "preparing": preparing, "next": next_frame, "peak, GB": peak_memory()}
    return found | {"PSNR": quality(estimate, taken), "largest difference": difference}


def with_and_without(taken: Taken, name: str) -> Found:
    """As `prepared`, with the deviation; and then a first frame without."""
    found = prepared(taken, name, **WITH_DEVIATION)
    camera = taken.first.camera.replace()  # holds nothing that was computed
    snapshot = tmca.simulate(taken.scene, camera, seed=0)
    return {"first, estimate alone": Clock().seconds(lambda: decode(snapshot, name, uncertainty=False))} | found


def unprepared(taken: Taken, name: str, repeats: int = 3, **options: Any) -> Found:
    """Seconds of a frame that nothing is prepared for, and its PSNR."""
    _decoder(taken, name, options)
    made = list[Any]()
    seconds = Clock().median(lambda: made.append(decode(taken.second, name, **options)), repeats, int(repeats > 1))
    return {"frame": seconds, "PSNR": quality(made[-1], taken)}


def _decoder(taken: Taken, name: str, options: Mapping[str, Any]) -> Any:
    """A decoder whose prior was learned before any frame, and is cached."""
    camera = taken.first.camera
    decoder = make_decoder(name, camera.kind, options)
    if decoder.prior_kind is not None:
        find_prior(camera, None, decoder.prior_kind)
    return decoder


def quality(estimate: Any, taken: Taken) -> float:
    """PSNR in dB."""
    return float(tmca.evaluate(estimate, taken.scene)["psnr"])


def fast() -> Found:
    """The smaller bank, and what it loses against the exact estimate."""
    taken = spectral(TILED)
    quick = make_decoder("lmmse", "spectral", WITH_DEVIATION | {"fast": True}).prepare(taken.first.camera)
    loss = quality(decode(taken.second, "lmmse"), taken) - quality(quick(taken.second), taken)
    return {"next": Clock().median(lambda: quick(taken.second), _MOST), "loss, dB": loss}


def from_bank() -> Found:
    """A first frame from a bank that another process stored in a file."""
    first = spectral(TILED).first
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "bank.safetensors"
        with ProcessPoolExecutor(1, get_context("spawn")) as other:
            other.submit(_store_bank, file).result()
        decoder = make_decoder("lmmse", "spectral", WITH_DEVIATION)
        return {"first": Clock().seconds(lambda: decoder.prepare(first.camera, bank=file)(first))}


def _store_bank(file: Path) -> None:
    make_decoder("lmmse", "spectral", WITH_DEVIATION).prepare(spectral(TILED).first.camera, bank=file)


def two_buckets() -> Found:
    """Beside one bucket."""
    one = prepared(spectral(TILED), "lmmse", **WITH_DEVIATION)
    found = prepared(spectral(TWO_BUCKETS), "lmmse", **WITH_DEVIATION)
    return found | {"next over one bucket": found["next"] / one["next"]}


def likelihood() -> Found:
    """Beside the floor, the operator forward and back."""
    from tmca.data.in_memory import as_tensors

    taken = spectral_depth()
    camera = taken.first.camera
    cube, depth = as_tensors(camera.fitted(taken.scene))

    def there_and_back() -> Tensor:
        return camera.A_adjoint(camera.A(cube, depth), depth)

    found = prepared(taken, "likelihood")
    with torch.no_grad():
        floor = Clock().median(there_and_back, _MOST)
    return found | {"floor": floor, "next over floor": found["next"] / floor}


def training() -> Found:
    """Steps of 16 patches of 64×64 pixels, forward and back, in the precision that `tmca train` chooses here: first
    estimates computed anew or once, codes learned."""
    fixed, patches = _system("none")
    start = fixed.start(patches, 0, range(len(patches)))
    learned = _step(*_system("both"))
    return {"anew": _step(fixed, patches), "cached": _step(fixed, patches, start), "learned": learned}


def training_before() -> Found:
    return {"anew": _step(*_system("none"))}


def _step(system: Any, patches: list[Patch], start: Tensor | None = None) -> float:
    half = choose_precision("auto", "cpu") == "bf16-mixed"

    def step() -> None:
        with torch.autocast("cpu", torch.bfloat16, enabled=half):
            loss = system(patches, 0, range(len(patches)), start)
        loss.backward()

    return Clock().median(step, 5)


def _system(learn: str) -> tuple[Any, list[Patch]]:
    """The quick preset, and a batch of it."""
    settings, kind = training_settings("spectral", "quick", None, {"camera.learn": learn}), TRAININGS["spectral"]
    camera = kind.camera(settings, lambda: tmca.read("coffee"))
    network = kind.network(settings, camera)
    system = kind.system(settings, camera, network, [SENSOR], find_prior(camera, None, "gaussian"))
    scene = torch.from_numpy(tmca.read("coffee", bands=12, size=(256, 256)).values)
    corners = range(0, 256, 64)
    cut = [scene[:, top : top + 64, left : left + 64] for top in corners for left in corners]
    return system.train(), [Patch(one, one, "") for one in cut]


def operators() -> Found:
    """Forward model and adjoint over a copy of the cube."""
    from spectral import SHAPES, measure

    found = {}
    for shape in SHAPES:
        times, size = measure(shape, 50), "×".join(str(side) for side in shape if side > 1)
        found |= {f"{name} at {size}": times[name] / times["copy"] for name in ("forward", "adjoint")}
    return found


def machine() -> Found:
    """What matrix products and copies reach on one core."""
    clock, matrix, values = Clock(), torch.rand(2000, 2000), torch.rand(50_000_000)
    target = torch.empty_like(values).copy_(values)
    product = clock.median(lambda: matrix @ matrix, 5)
    copy = clock.median(lambda: target.copy_(values), 5)
    return {"GFlop/s": 2e-9 * 2000**3 / product, "GB/s copied": 1e-9 * 4 * len(values) / copy}


def live(exposures: int = 4500) -> Found:
    """Estimates a second of `tmca live` with a simulated bench of 30 exposures a second and a recording, all on this
    core, wall time; and the memory that it holds."""
    with tempfile.TemporaryDirectory() as folder:
        snapshot, export = f"{folder}/s.nc", f"{folder}/patterns"
        codes = ["--slots", "8", "--shutter", "random", "--period", "32", "--read-noise", "0.01", "--bands", "12"]
        _run("simulate", "spectral", "coffee", "--crop", "256x256", *codes, "--out", snapshot)
        _run("export", snapshot, "--device", "dli4120", "--device", "coded-exposure", "--out", export, "--no-figures")
        how = ["--scene", "coffee", "--drift", "0,1", "--no-page", "--json", "--rate", "30"]
        words = ("live", export, *how, "--exposures", f"{exposures}", "--record", f"{folder}/r.zarr")
        said, held = _watched(*words)
    stated = {"estimates a second": said["rate"], "estimates": said["estimates"], "dropped": said["dropped"]}
    half = {"GB at half the time": held[len(held) // 2], "GB at the end": held[-1]} if held else {}
    return stated | {"seconds": len(held), **half}


def _watched(*words: str) -> tuple[dict[str, float], list[float]]:
    """What a command says as JSON, and GB that it holds, second by second."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as errors:
        process = subprocess.Popen([sys.executable, "-m", "tmca", *words], stdout=out, stderr=errors)
        held, status = list[float](), Path(f"/proc/{process.pid}/status")
        while process.poll() is None:
            lines = status.read_text().splitlines() if status.exists() else []
            held += [int(line.split()[1]) / 1e6 for line in lines if line.startswith("VmRSS")]
            time.sleep(1)
        for file in (out, errors):
            file.seek(0)
        if process.returncode:
            raise RuntimeError(errors.read().strip())
        return json.loads(out.read()), held


def _run(*words: str) -> str:
    return subprocess.run([sys.executable, "-m", "tmca", *words], check=True, capture_output=True, text=True).stdout


class Row(NamedTuple):
    """A task.

    Args:
        what: is decoded.
        goals: by the names of figures.
        measure: gives the figures.
        before: the same of the package of another commit, where it could do the task.
        over_before: goals of figures over the first one of ``before``.
        why: goals are not reached.
    """

    what: str
    goals: Found
    measure: Callable[[], Found]
    before: Callable[[], Found] | None = None
    over_before: Found | None = None
    why: str = ""


_EVERY_BLOCK = """Every block has a matrix of its own. Variances of {blocks} blocks of {measurements} measurements
  take {operations} operations, at the rate of the products in the first row; estimates alone do not need them.
  Tried: one estimate of the whole frame by conjugate gradients, which has not converged after 1 200 steps (circulant
  preconditioner) or 100 (overlapping blocks)."""
_ADMM = """A hundred steps, each of a dozen passes over the cube and its gradients. Tried: a start from Tikhonov's
  estimate saves 20 steps and costs 15; a linearised data step has not converged after 160; MKL's transforms are no
  faster. Cosine transforms were replaced, and arrays halved."""
_MEMORY = "Bound by memory, see the row of the machine. Commit 34e6332d took {seconds} s where that is faster."
ROWS: dict[str, Row] = {
    "machine": Row("products of 2 000×2 000 matrices, copies of 200 MB, float32", {}, machine),
    "tiled": Row(
        "256×256×12, tiles of 32, LMMSE with deviation",
        {"next": 0.08, "preparing": 3.0, "largest difference": 1e-4},
        lambda: prepared(spectral(TILED), "lmmse", **WITH_DEVIATION),
        lambda: unprepared(spectral(TILED), "lmmse", **WITH_DEVIATION),
        why="Preparing solves every block of a tile once, and multiplies the blend out for every phase of it.",
    ),
    "fast": Row(
        "the same, fast bank",
        {"next": 0.04, "loss, dB": 0.1},
        fast,
        why="""Half of it are products in half precision, the rest gathers measurements, lays pixels, and calibrates the
  deviation.""",
    ),
    "bank": Row("the same, from a bank that another process stored", {"first": 0.3}, from_bank),
    "untiled": Row(
        "256×256×12, codes that do not repeat, LMMSE with deviation",
        {"first": 1.5, "first, estimate alone": 1.5, "next": 0.5},
        lambda: with_and_without(spectral(RANDOM), "lmmse"),
        lambda: unprepared(spectral(RANDOM), "lmmse", **WITH_DEVIATION),
        why=_EVERY_BLOCK.format(blocks=608, measurements=300, operations="2·10¹¹"),
    ),
    "large": Row(
        "660×660×28, one mask, 2 px a band, LMMSE with deviation",
        {"first": 25.0, "first, estimate alone": 25.0, "next": 8.0, "peak, GB": 4.0},
        lambda: with_and_without(large(), "lmmse"),
        lambda: unprepared(large(), "lmmse", 1, **WITH_DEVIATION),
        why=_EVERY_BLOCK.format(blocks="3 740", measurements=376, operations="5·10¹²")
        + " Blocks have four rows, those of before had two: 0.5 dB more.",
    ),
    "mixture": Row(
        "256×256×12, tiles of 32, mixture with deviation",
        {"next": 1.0},
        lambda: prepared(spectral(TILED), "mixture", **WITH_DEVIATION),
        lambda: unprepared(spectral(TILED), "mixture", 1, **WITH_DEVIATION),
        why=_MEMORY.format(seconds="0.83"),
    ),
    "light field": Row(
        "270×480×25 views, tiles of 16, LMMSE with deviation",
        {"next": 0.1},
        lambda: prepared(light_field(), "lmmse", **WITH_DEVIATION),
        lambda: unprepared(light_field(), "lmmse", **WITH_DEVIATION),
        why=_MEMORY.format(seconds="0.089"),
    ),
    "likelihood": Row(
        "spectral-depth 256×256×25, patch likelihood",
        {"next": 0.5, "next over floor": 1.3},
        likelihood,
        lambda: unprepared(spectral_depth(), "likelihood", 1),
        why=_MEMORY.format(seconds="0.42"),
    ),
    "two buckets": Row(
        "256×256×12, tiles of 32, two buckets, LMMSE with deviation", {"next over one bucket": 2.5}, two_buckets
    ),
    "space-time": Row(
        "256×256×12, tiles of 32, two buckets, four frames",
        {},
        lambda: prepared(spectral(TWO_BUCKETS), "space-time-lmmse"),
    ),
    "admm": Row(
        "256×256×12, ADMM-TV joint",
        {"frame": 0.6},
        lambda: unprepared(spectral(RANDOM), "admm-tv-joint"),
        lambda: unprepared(spectral(RANDOM), "admm-tv-joint"),
        why=_ADMM,
    ),
    "admm, large": Row(
        "660×660×28, ADMM-TV joint",
        {"frame": 20.0},
        lambda: unprepared(large(), "admm-tv-joint"),
        lambda: unprepared(large(), "admm-tv-joint", 1),
        why=_ADMM,
    ),
    "training": Row(
        "a training step from the LMMSE, 16 patches of 64×64",
        {},
        training,
        training_before,
        {"cached": 0.25, "learned": 1.5},
        """With first estimates that are computed once, a step is the network alone. Where codes learn, gradients pass
  through every block. Tried: matrices that are held for ten steps, without their gradients
  ([what that gives](../training.md#codes)).""",
    ),
    "operators": Row(
        "spectral camera, K = 8, over a copy of the cube",
        {f"{name} at {size}": 2.5 for size in ("8×12×128×128", "28×256×256") for name in ("forward", "adjoint")},
        operators,
        operators,
        why="""The copy writes into memory that is already allocated; an operator asks for new memory, which alone
  takes one to two copies. The passes are bound by instructions on this machine, not by memory. Tried: huge pages.""",
    ),
    "live": Row(
        "`tmca live`, simulated bench, 256×256×12, recorded",
        {"estimates a second": 10.0},
        live,
        why="Bench, decoder and recording share one core.",
    ),
}
"""By short name."""
LARGER_IS_BETTER = frozenset({"estimates a second"})
