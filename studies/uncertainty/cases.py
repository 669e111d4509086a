"""What the deviation is calibrated on and measured with: cameras, scenes and decoders, for every kind of camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from torch import Tensor

import tmca
from studies.bench import load_any_depth_scene, middle_of, reading_range, select_bands
from tmca.applications import application_of
from tmca.data import read_split
from tmca.decoders import Weights, make_decoder
from tmca.priors import block_of, learn_prior

BANDS, SIZE = 12, (256, 256)
TILED = {"aperture": "random", "period": 32}
STATIC = {"slots": 1, "aperture": "static", "shutter": "open", "period": 32}
SHOT = tmca.Sensor(full_well=10_000, read_noise_electrons=3)
LEARNED = ("beads", "clay", "fake_and_real_food", "feathers", "flowers", "thread_spools")
"""Scenes of ``cave_train`` from which the second prior of spectral cameras is learned."""

_SLOW = ("lmmse-adapted", "mixture")
"""Decoders that are measured with one camera and prior; the mixture takes minutes a frame of two buckets."""


def sensor(noise: float) -> tmca.Sensor:
    return tmca.Sensor(read_noise=noise)


def random(slots: int, noise: tmca.Sensor, **more: Any) -> dict[str, Any]:
    return {"slots": slots, "shutter": "random", **TILED, "sensor": noise, **more}


def balanced(slots: int, noise: tmca.Sensor, **more: Any) -> dict[str, Any]:
    return {"slots": slots, "shutter": "balanced", "buckets": 2, **TILED, "sensor": noise, **more}


def default(slots: int, noise: tmca.Sensor) -> dict[str, Any]:
    """A camera that comes with the package, with its codes; it alone is decoded by its network."""
    return {"default": slots, "sensor": noise}


def masks(slots: int, noise: tmca.Sensor, **more: Any) -> dict[str, Any]:
    shutter = "open" if slots == 1 else "one-hot"
    return {"slots": slots, "shutter": shutter, "filters": "clear", "sensor": noise, **more}


@dataclass(frozen=True)
class Kind:
    """One kind of camera.

    Args:
        decoders: names.
        size, cut: of the frames that are measured, and of those of the fit; of a smaller scene its own.
        fitted: cameras by name, for the fit, each with a seed of its own.
        measured: the camera of the issue's figures, and one unlike those of the fit.
        scenes: for the fit; none of them is learned from, nor measured.
        tests: for the measurement.
    """

    decoders: tuple[str, ...]
    size: tuple[int, int]
    cut: tuple[int, int]
    fitted: Mapping[str, dict[str, Any]]
    measured: Mapping[str, dict[str, Any]]
    scenes: tuple[str, ...]
    tests: tuple[str, ...]


KINDS = {
    "spectral": Kind(
        ("lmmse", "lmmse-adapted", "mixture", "network"),
        SIZE,
        (160, 192),
        {
            "static, σ = 0.001": {**STATIC, "sensor": sensor(0.001)},
            "K = 2, σ = 0.03": random(2, sensor(0.03)),
            "K = 8, σ = 0.01": random(8, sensor(0.01)),
            "two buckets, K = 4, σ = 0.003": balanced(4, sensor(0.003)),
            "default, K = 1, σ = 0.001": default(1, sensor(0.001)),
            "default, K = 1, σ = 0.01": default(1, sensor(0.01)),
            "default, K = 8, σ = 0.001": default(8, sensor(0.001)),
            "default, K = 8, σ = 0.01": default(8, sensor(0.01)),
            "default, K = 8, 10 000 e⁻, 3 e⁻": default(8, SHOT),
        },
        {
            "K = 8, σ = 0.01": random(8, sensor(0.01), seed=100),
            "left out: two buckets, K = 6, 35 % open, σ = 0.005": balanced(6, sensor(0.005), duty=0.35, seed=101),
            "default, K = 8, σ = 0.01": default(8, sensor(0.01)),
            "default, K = 1, σ = 0.005": default(1, sensor(0.005)),
        },
        ("cave_val",),
        ("cave_test",),
    ),
    "light-field": Kind(
        ("lmmse", "network"),
        (192, 256),
        (192, 256),
        {
            "static, σ = 0.001": {"slots": 1, "shutter": "open", "sensor": sensor(0.001)},
            "static, σ = 0.01": {"slots": 1, "shutter": "open", "sensor": sensor(0.01)},
            "K = 4 one-hot, σ = 0.003": {"slots": 4, "shutter": "one-hot", "sensor": sensor(0.003)},
            "K = 8, σ = 0.01": {"slots": 8, "shutter": "random", "sensor": sensor(0.01)},
            "K = 8, 10 000 e⁻, 3 e⁻": {"slots": 8, "shutter": "random", "sensor": SHOT},
            "K = 8 one-hot, σ = 0.03": {"slots": 8, "shutter": "one-hot", "sensor": sensor(0.03)},
            "default, σ = 0.001": default(8, sensor(0.001)),
            "default, σ = 0.01": default(8, sensor(0.01)),
            "default, 10 000 e⁻, 3 e⁻": default(8, SHOT),
        },
        {
            "K = 8, σ = 0.01": {"slots": 8, "shutter": "random", "sensor": sensor(0.01), "seed": 100},
            "left out: K = 6, σ = 0.005": {"slots": 6, "shutter": "random", "sensor": sensor(0.005), "seed": 101},
            "default, σ = 0.01": default(8, sensor(0.01)),
            "default, σ = 0.03": default(8, sensor(0.03)),
        },
        ("light_field_train", "chelsea"),
        ("light_field_test", "coffee", "motorcycle"),
    ),
    "spectral-depth": Kind(
        ("likelihood",),
        (96, 128),
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
    """An estimate, its predicted deviation and its absolute errors: light (1, …, H, W), or depth (1, 1, H, W), metres.

    Args:
        prior: what it was learned from, in a word.
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
    known: Tensor


def scenes_of(names: Sequence[str], data: Path) -> list[str]:
    """Rendered scenes by name, and those of splits below the folder of the data."""
    splits = [data / "splits" / f"{name}.txt" for name in names]
    found = [read_split(file) if file.exists() else [name] for name, file in zip(names, splits, strict=True)]
    return [str(scene) for some in found for scene in some]


def called(scene: str) -> str:
    """A scene in short: of a file its name and its folder's."""
    path = Path(scene)
    return "/".join(path.with_suffix("").parts[-2:])


def cases(kind: str, data: Path, *, measured: bool = False, decoders: Sequence[str] = ()) -> Iterator[Case]:
    """All of a kind, for the fit or the measurement."""
    what = KINDS[kind]
    names = scenes_of(what.tests if measured else what.scenes, data)
    for seed, (name, settings) in enumerate((what.measured if measured else what.fitted).items()):
        camera_of = {"seed": seed + 1, **settings}
        for decoder in decoders or what.decoders:
            if ("default" in settings) != (decoder == "network"):
                continue
            if (decoder in _SLOW and "left out" in name) or (decoder == "mixture" and settings.get("buckets") == 2):
                continue
            yield from _of_camera(kind, decoder, name, camera_of, names, data, measured)


def _of_camera(
    kind: str, decoder: str, name: str, settings: Mapping[str, Any], names: Sequence[str], data: Path, measured: bool
) -> Iterator[Case]:
    """Of all scenes under every prior."""
    what, prepared = KINDS[kind], dict[tuple[Any, ...], Any]()
    both = kind == "spectral" and "left out" not in name and decoder != "network"
    priors = ("rendered", "CAVE") if both else ("rendered",)
    priors = priors[-1:] if measured and decoder in _SLOW else priors
    for scene in names:
        labelled = read(kind, scene, what.size if measured else what.cut, measured=measured)
        shape = (labelled.sizes["y"], labelled.sizes["x"])
        camera = camera_at(kind, shape, settings, labelled)
        for prior in priors:
            if (shape, prior) not in prepared:
                prepared[shape, prior] = decoding(camera, decoder, prior, data)
            about = {"kind": kind, "decoder": decoder, "camera": name, "prior": prior, "scene": called(scene)}
            yield _case(about, prepared[shape, prior], camera, labelled)


def read(kind: str, scene: str, size: tuple[int, int], *, measured: bool = False) -> Any:
    """A scene, cut to no more than a size; spectra that are made up are of other materials where it is measured."""
    if kind == "spectral":
        cube: Any = tmca.read(scene)
        return middle_of(select_bands(cube, BANDS), size, scene)
    if kind == "light-field":
        files = {"scale": 2} if Path(scene).exists() else {}
        views: Any = tmca.read(scene, kind="light-field", **files)
        rows, columns = (min(there, most) for there, most in zip(views.shape[-2:], size, strict=True))
        return middle_of(views, (rows, columns), scene)
    camera = tmca.SpectralDepthCamera.from_preset("quick", size=size)
    how: dict[str, Any] = {"side": 256, "placed": "random", "from_rgb": True, **reading_range(camera)}
    known = load_any_depth_scene(scene, **how, materials="test" if measured else "train")
    return middle_of(known, size, scene)


def camera_at(kind: str, size: tuple[int, int], settings: Mapping[str, Any], scene: Any) -> Any:
    if "default" in settings:
        return Weights.find("default", settings["default"], kind).camera_for(size, sensor=settings["sensor"])
    if kind == "spectral":
        return tmca.SpectralCamera(scene["wavelength"].values.tolist(), size, **settings)
    if kind == "light-field":
        return tmca.LightFieldCamera(5, size, period=16, **settings)
    return tmca.SpectralDepthCamera.from_preset("quick", size=size, **settings)


_PRIORS = dict[tuple[Any, ...], Any]()


def decoding(camera: Any, decoder: str, prior: str, data: Path) -> Callable[[Any], Any]:
    """Snapshots to estimates whose deviation is as it is predicted; prepared where that pays for a few of them."""
    how: dict[str, Any] = {"uncertainty": True} if camera.kind != "spectral-depth" else {}
    how |= {"weights": "default"} if decoder == "network" else {}
    made = make_decoder(decoder, camera.kind, {**how, "calibrated": False})
    if prior == "rendered":
        return made.prepare(camera) if camera.kind == "spectral-depth" else made
    kind = str(made.prior_kind)
    key = kind, block_of(camera, kind)
    if key not in _PRIORS:
        scenes = [read("spectral", f"{data}/hsi/cave_256/{name}.mat", SIZE) for name in LEARNED]
        _PRIORS[key] = learn_prior(scenes, camera, kind)
    return partial(made, prior=_PRIORS[key])


def _case(about: dict[str, Any], decoded: Callable[[Any], Any], camera: Any, labelled: Any) -> Case:
    application = application_of(camera)
    found = decoded(tmca.simulate(labelled, camera, seed=3, progress=False))
    light, *depth = application.tensors(application.fitted(application.scene(labelled, camera), camera, about["scene"]))
    if not depth:
        errors = (found.values - light).abs()
        return Case(**about, values=found.values, deviation=found.deviation, errors=errors, known=errors >= 0)
    errors = (found.depth - depth[0]).abs()
    known = camera.planes.within(depth[0])
    return Case(**about, values=found.depth, deviation=found.depth_deviation, errors=errors, known=known)
