"""What ``benchmarks/realtime.py`` measures: every row is a function that gives numbers by name, times in seconds."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from timing import Clock, peak_memory
from torch import Tensor

import tmca
from tmca.data import rendered_scene
from tmca.data.in_memory import as_tensors
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


def alone(taken: tuple[Any, Any], name: str) -> Found:
    """Seconds of a frame by a decoder that nothing is prepared for."""
    return {"next": Clock().median(lambda: decode(taken[1], name), 3)}


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
    return prepared(large(), "lmmse", uncertainty=True) | {"peak, GB": peak_memory()}


def light_field() -> Found:
    camera = tmca.LightFieldCamera(5, (270, 480), 8, period=16, sensor=SENSOR)
    return prepared(_taken(camera, tmca.read("coffee", kind="light-field")), "lmmse", uncertainty=True)


def likelihood() -> Found:
    """Beside the floor, the operator forward and back."""
    camera = tmca.SpectralDepthCamera.from_preset("thesis", sensor=SENSOR)
    scene = camera.fitted(tmca.read("coffee", kind="spectral-depth"))
    cube, depth = as_tensors(scene)

    def there_and_back() -> Tensor:
        return camera.A_adjoint(camera.A(cube, depth), depth)

    found = prepared(_taken(camera, scene), "likelihood")
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


def _scene(camera: Any) -> Tensor:
    """(1, L, H, W) coffee at a camera's bands."""
    scene: Tensor = as_tensors(camera.fitted(tmca.read("coffee")))[0]
    return scene


def live(exposures: int = 3000) -> Found:
    """Estimates a second of `tmca live` with the simulated bench and a recording, all on this core."""
    with tempfile.TemporaryDirectory() as folder:
        snapshot, export = f"{folder}/s.nc", f"{folder}/patterns"
        codes = ["--slots", "8", "--shutter", "random", "--period", "32", "--read-noise", "0.01", "--bands", "12"]
        _run("simulate", "spectral", "coffee", "--crop", "256x256", *codes, "--out", snapshot)
        _run("export", snapshot, "--device", "dli4120", "--device", "coded-exposure", "--out", export, "--no-figures")
        how = ["--scene", "coffee", "--drift", "0,1", "--no-page", "--json", "--rate", "100"]
        said = json.loads(_run("live", export, *how, "--exposures", f"{exposures}", "--record", f"{folder}/r.zarr"))
    return {"estimates a second": said["rate"], "estimates": said["estimates"], "dropped": said["dropped"]}


def _run(*words: str) -> str:
    return subprocess.run([sys.executable, "-m", "tmca", *words], check=True, capture_output=True, text=True).stdout


ROWS: dict[str, tuple[str, Found, Callable[[], Found]]] = {
    "tiled": (
        "256×256×12, tiles of 32, LMMSE with deviation",
        {"next": 0.08, "preparing": 3.0, "largest difference": 1e-4},
        lambda: prepared(spectral(TILED), "lmmse", uncertainty=True),
    ),
    "fast": ("the same, fast bank", {"next": 0.04, "loss, dB": 0.1}, fast),
    "bank": ("the same, from a bank in a file", {"first": 0.3}, from_bank),
    "untiled": (
        "256×256×12, codes that do not repeat, LMMSE with deviation",
        {"first": 1.5, "next": 0.5},
        lambda: prepared(spectral(RANDOM), "lmmse", uncertainty=True),
    ),
    "large": (
        "660×660×28, one mask, 2 px a band, LMMSE with deviation",
        {"first": 25.0, "next": 8.0, "peak, GB": 4.0},
        of_large,
    ),
    "mixture": (
        "256×256×12, tiles of 32, mixture with deviation",
        {"next": 1.0},
        lambda: prepared(spectral(TILED), "mixture", uncertainty=True),
    ),
    "light field": ("270×480×25 views, tiles of 16, LMMSE with deviation", {"next": 0.1}, light_field),
    "likelihood": ("spectral-depth 256×256×25, patch likelihood", {"next": 0.5}, likelihood),
    "two buckets": (
        "256×256×12, tiles of 32, two buckets, LMMSE with deviation",
        {},
        lambda: prepared(spectral(TWO_BUCKETS), "lmmse", uncertainty=True),
    ),
    "space-time": (
        "256×256×12, tiles of 32, two buckets, four frames",
        {},
        lambda: alone(spectral(TWO_BUCKETS), "space-time-lmmse"),
    ),
    "admm": (
        "256×256×12, ADMM-TV joint",
        {"next": 0.6},
        lambda: alone(spectral(RANDOM), "admm-tv-joint"),
    ),
    "admm, large": ("660×660×28, ADMM-TV joint", {"next": 20.0}, lambda: alone(large(), "admm-tv-joint")),
    "training": (
        "a training step from the LMMSE, 16 patches of 64×64",
        {"cached over anew": 0.25, "learned over anew": 1.5},
        training,
    ),
    "live": ("`tmca live`, simulated bench, 256×256×12, recorded", {"estimates a second": 10.0}, live),
}
"""Short name → what is decoded, the goals, and what measures it."""
