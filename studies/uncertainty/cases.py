"""What the deviation is calibrated on and measured with: cameras, scenes and decoders, for every kind of camera."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

import tmca
from tmca.applications import application_of
from tmca.applications.spectral_depth import reading_range
from tmca.data import read_split
from tmca.data.depth_scenes import load_any_depth_scene, middle_of
from tmca.decoders import make_decoder
from tmca.decoders.certainty import inverse_deviation
from tmca.priors import learn_prior

TILED = {"aperture": "random", "period": 32}
STATIC = {"slots": 1, "aperture": "static", "shutter": "open", "period": 32}
SHOT = tmca.Sensor(full_well=10_000, read_noise_electrons=3)
LEARNED = ("beads", "clay", "fake_and_real_food", "feathers", "flowers", "thread_spools")
"""Scenes of ``cave_train`` from which the second prior of spectral cameras is learned."""


def sensor(noise: float) -> tmca.Sensor:
    return tmca.Sensor(read_noise=noise)


def random(slots: int, noise: tmca.Sensor, **more: Any) -> dict[str, Any]:
    return {"slots": slots, "shutter": "random", **TILED, "sensor": noise, **more}


def balanced(slots: int, noise: tmca.Sensor, **more: Any) -> dict[str, Any]:
    return {"slots": slots, "shutter": "balanced", "buckets": 2, **TILED, "sensor": noise, **more}


def masks(slots: int, noise: tmca.Sensor, **more: Any) -> dict[str, Any]:
    shutter = "open" if slots == 1 else "one-hot"
    return {"slots": slots, "shutter": shutter, "filters": "clear", "sensor": noise, **more}


@dataclass(frozen=True)
class Kind:
    """One kind of camera.

    Args:
        decoders: names.
        size: of the frames; of a smaller scene its own.
        fitted: cameras by name, for the fit, each with a seed of its own.
        measured: the camera of the issue's figures, and one unlike those of the fit.
        scenes: for the fit; none of them is learned from, nor measured.
        tests: for the measurement.
    """

    decoders: tuple[str, ...]
    size: tuple[int, int]
    fitted: Mapping[str, dict[str, Any]]
    measured: Mapping[str, dict[str, Any]]
    scenes: tuple[str, ...]
    tests: tuple[str, ...]


KINDS = {
    "spectral": Kind(
        ("lmmse", "lmmse-adapted", "mixture"),
        (256, 256),
        {
            "static, σ = 0.001": {**STATIC, "sensor": sensor(0.001)},
            "static, σ = 0.01": {**STATIC, "sensor": sensor(0.01)},
            "K = 2, σ = 0.03": random(2, sensor(0.03)),
            "K = 4 one-hot, σ = 0.003": random(4, sensor(0.003), shutter="one-hot"),
            "K = 8, σ = 0.001": random(8, sensor(0.001)),
            "K = 8, σ = 0.01": random(8, sensor(0.01)),
            "K = 8, 10 000 e⁻, 3 e⁻": random(8, SHOT),
            "two buckets, K = 4, σ = 0.003": balanced(4, sensor(0.003)),
            "two buckets, K = 8, σ = 0.03": balanced(8, sensor(0.03)),
        },
        {
            "K = 8, σ = 0.01": random(8, sensor(0.01), seed=100),
            "left out: two buckets, K = 6, 35 % open, σ = 0.005": balanced(6, sensor(0.005), duty=0.35, seed=101),
        },
        ("cave_val",),
        ("cave_test",),
    ),
    "light-field": Kind(
        ("lmmse",),
        (192, 256),
        {
            "static, σ = 0.001": {"slots": 1, "shutter": "open", "sensor": sensor(0.001)},
            "static, σ = 0.01": {"slots": 1, "shutter": "open", "sensor": sensor(0.01)},
            "K = 4 one-hot, σ = 0.003": {"slots": 4, "shutter": "one-hot", "sensor": sensor(0.003)},
            "K = 8, σ = 0.01": {"slots": 8, "shutter": "random", "sensor": sensor(0.01)},
            "K = 8, 10 000 e⁻, 3 e⁻": {"slots": 8, "shutter": "random", "sensor": SHOT},
            "K = 8 one-hot, σ = 0.03": {"slots": 8, "shutter": "one-hot", "sensor": sensor(0.03)},
        },
        {
            "K = 8, σ = 0.01": {"slots": 8, "shutter": "random", "sensor": sensor(0.01), "seed": 100},
            "left out: K = 6, σ = 0.005": {"slots": 6, "shutter": "random", "sensor": sensor(0.005), "seed": 101},
        },
        ("light_field_train", "chelsea"),
        ("light_field_test", "coffee", "motorcycle"),
    ),
    "spectral-depth": Kind(
        ("likelihood",),
        (96, 128),
        {
            "one mask, σ = 0.002": masks(1, sensor(0.002)),
            "one mask, σ = 0.01": masks(1, sensor(0.01)),
            "K = 4, σ = 0.002": masks(4, sensor(0.002)),
            "K = 4, σ = 0.01": masks(4, sensor(0.01)),
            "K = 4, 10 000 e⁻, 3 e⁻": masks(4, SHOT),
        },
        {
            "K = 4, σ = 0.002": masks(4, sensor(0.002), seed=100),
            "left out: K = 2, σ = 0.005": masks(2, sensor(0.005), seed=101),
        },
        ("spectral_depth_train",),
        ("spectral_depth_test", "spectral_test"),
    ),
}


@dataclass(frozen=True)
class Case:
    """An estimate, its predicted deviation and its absolute errors: light (1, …, H, W), or inverse depth (1, 1, H, W).

    Args:
        prior: what it was learned from, in a word.
        scale: from these units to those of the estimate: for inverse depth, the squared estimate.
        known: where the truth is known.
    """

    kind: str
    decoder: str
    camera: str
    prior: str
    scene: str
    values: Tensor
    deviation: Tensor
    errors: Tensor
    scale: Tensor
    known: Tensor


def scenes_of(names: Sequence[str], data: Path) -> list[str]:
    """Rendered scenes by name, and those of splits below the folder of the data."""
    splits = [data / "splits" / f"{name}.txt" for name in names]
    found = [read_split(file) if file.exists() else [name] for name, file in zip(names, splits, strict=True)]
    return [str(scene) for some in found for scene in some]


def cases(kind: str, data: Path, *, measured: bool = False, decoders: Sequence[str] = ()) -> Iterator[Case]:
    """All of a kind, for the fit or the measurement."""
    what = KINDS[kind]
    names = scenes_of(what.tests if measured else what.scenes, data)
    for seed, (name, settings) in enumerate((what.measured if measured else what.fitted).items()):
        camera_of = {"seed": seed + 1, **settings}
        for decoder in decoders or what.decoders:
            yield from _of_camera(kind, decoder, name, camera_of, names, data)


def _of_camera(
    kind: str, decoder: str, name: str, settings: Mapping[str, Any], names: Sequence[str], data: Path
) -> Iterator[Case]:
    """Of all scenes; those of one size share what is prepared."""
    size, prepared = KINDS[kind].size, dict[tuple[Any, str], Any]()
    for scene in names:
        labelled = read(kind, scene, size)
        shape = (labelled.sizes["y"], labelled.sizes["x"])
        camera = camera_at(kind, shape, settings)
        for prior in ("rendered", "CAVE") if kind == "spectral" else ("rendered",):
            if (shape, prior) not in prepared:
                prepared[shape, prior] = prepare(camera, decoder, prior, data)
            one = prepared[shape, prior]
            yield _case((kind, decoder, name, prior, Path(scene).stem), one, labelled)


def read(kind: str, scene: str, size: tuple[int, int]) -> Any:
    """A scene, cut to no more than a size."""
    if kind == "spectral":
        return tmca.read(scene)
    if kind == "light-field":
        files = {"scale": 2} if Path(scene).exists() else {}
        views = tmca.read(scene, kind="light-field", **files)
        rows, columns = (min(there, most) for there, most in zip(views.shape[-2:], size, strict=True))
        return middle_of(views, (rows, columns), scene)
    camera = tmca.SpectralDepthCamera.from_preset("quick", size=size)
    known = load_any_depth_scene(scene, **reading_range(camera), side=256, placed="random", from_rgb=True)
    return middle_of(known, size, scene)


def camera_at(kind: str, size: tuple[int, int], settings: Mapping[str, Any]) -> Any:
    if kind == "spectral":
        return tmca.SpectralCamera(12, size, **settings)
    if kind == "light-field":
        return tmca.LightFieldCamera(5, size, period=16, **settings)
    return tmca.SpectralDepthCamera.from_preset("quick", size=size, **settings)


_PRIORS = dict[tuple[str, str], Any]()


def prepare(camera: Any, decoder: str, prior: str, data: Path) -> Any:
    """A decoder made ready that gives its deviation as it predicts it."""
    how = {"uncertainty": True} if camera.kind != "spectral-depth" else {}
    made = make_decoder(decoder, camera.kind, {**how, "calibrated": False})
    if prior == "rendered":
        return made.prepare(camera)
    kind = str(made.prior_kind)
    key = kind, str(camera.buckets)
    if key not in _PRIORS:
        scenes = [camera.fitted(tmca.read(data / "hsi" / "cave_256" / f"{name}.mat")) for name in LEARNED]
        _PRIORS[key] = learn_prior(scenes, camera, kind)
    return made.prepare(camera, _PRIORS[key])


def _case(names: tuple[str, ...], prepared: Any, labelled: Any) -> Case:
    camera, application = prepared.camera, application_of(prepared.camera)
    snapshot = tmca.simulate(labelled, camera, seed=3, progress=False)
    found = prepared(snapshot)
    light, *depth = application.tensors(application.fitted(application.scene(labelled, camera), camera, names[-1]))
    if not depth:
        everywhere = torch.ones_like(light)
        return Case(*names, found.values, found.deviation, (found.values - light).abs(), everywhere, everywhere > 0)
    scale = found.depth.square()
    errors, known = (found.depth - depth[0]).abs() / scale, camera.planes.within(depth[0])
    return Case(*names, 1 / found.depth, inverse_deviation(found), errors, scale, known)
