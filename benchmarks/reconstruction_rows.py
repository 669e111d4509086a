"""What ``benchmarks/reconstruction.py`` measures: cameras, what decoders learn before any frame, and decoders.

Every camera takes a rendered scene, mirrored where the frame is larger than the photograph, with read noise of 0.01.
Networks are untrained: they are as fast as trained ones of their size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera, SpectralDepthCamera
from tmca.data import rendered_light_field, rendered_scene, split_rendered_light_fields
from tmca.data.in_memory import as_tensors
from tmca.decoders import (
    DECODERS,
    PatchLikelihood,
    Weights,
    build_network,
    decode,
    decoders_for,
    make_decoder,
)
from tmca.decoders.nets.build import build_depth_network
from tmca.decoders.nets.tiles import CollapsedNetwork, TwoHeadedNetwork
from tmca.decoders.nets.two_headed import DEPTH_STARTS
from tmca.errors import SettingError
from tmca.evaluation.study import read_study
from tmca.lab.deploy import FORMATS, export_decoder
from tmca.lab.loading import load_exported
from tmca.operators import TapOperator
from tmca.optics import DepthPlanes
from tmca.priors import PatchDictionary, find_prior, learn_prior
from tmca.sensor import Sensor
from tmca.training import TRAININGS

NETWORKS = {name: network.decoder for name, network in read_study("light-field").networks.items()}
NETWORKS["thesis"] = TRAININGS["light-field"].presets["thesis"]["decoder"]

SIZES = {
    "spectral": "256x256x12",
    "spectral, TSA-Net": "660x660x28",
    "light field": "270x480x5",
    "spectral-depth": "256x256x25",
    "pixel shutter": "256x256x256",
}
"""Rows and columns of the scene, and bands, views along each axis, or slots."""
NOISE = 0.01
_PHOTOGRAPH, _EXAMPLES = (256, 256), (128, 160)
_TSA_WAVES, _TSA_STEP = (453.3e-9, 648.1e-9), 2.0
_SPECTRAL_NETWORKS = {
    "network, unrolled from lmmse": {"kind": "unrolled", "start": "lmmse"},
    "network, unrolled from dagger": {"kind": "unrolled", "start": "dagger"},
    "network, unrolled from tikhonov": {"kind": "unrolled", "start": "tikhonov"},
    "network, U-Net from dagger": {"kind": "unet", "start": "dagger"},
}
_EXPORTED = "network, unrolled from dagger"
_PREPARED = ", prepared"
Frame = Callable[[Tensor], object]
"""Decodes a snapshot."""


@dataclass
class Case:
    """A camera before a scene.

    Args:
        kind: of the camera, a key of ``SIZES``.
        camera: it.
        scene: arguments of the camera: cube or light field, and depth, with a batch of one.
        folder: of what is learned.
        threads: of the processor.
    """

    kind: str
    camera: Any
    scene: tuple[Tensor, ...]
    folder: Path
    threads: int = 1

    @torch.no_grad()
    def snapshot(self, seed: int) -> Tensor:
        """A frame with noise of this seed."""
        found: Tensor = self.camera(*self.scene, generator=seed)
        return found

    @torch.no_grad()
    def there_and_back(self) -> None:
        """One pass of the operator forward, and one of its adjoint."""
        self.camera.A_adjoint(self.camera.A(*self.scene), *self.scene[1:])

    @property
    def device(self) -> torch.device:
        return self.scene[0].device


def case_of(kind: str, size: str, folder: Path, device: str = "cpu", threads: int = 1) -> Case:
    """The camera of a kind, of this size, before its scene."""
    rows, columns, channels = (int(part) for part in size.split("x"))
    makers = {"light field": _light_field, "spectral-depth": _spectral_depth, "pixel shutter": _pixel_shutter}
    make = makers.get(kind, _spectral)
    camera, scene = make(kind, (rows, columns), channels)
    return Case(kind, camera.to(device), tuple(part.to(device) for part in scene), folder, threads)


def _spectral(kind: str, size: tuple[int, int], bands: int) -> tuple[SpectralCamera, tuple[Tensor, ...]]:
    """The thesis' camera with random codes, or one as TSA-Net's prototype: one mask, two pixels a band."""
    sensor = Sensor(read_noise=NOISE)
    if kind == "spectral":
        camera = SpectralCamera(bands=bands, size=size, slots=8, sensor=sensor)
    else:
        waves = np.linspace(*_TSA_WAVES, bands).tolist()
        camera = SpectralCamera(waves, size, 1, shutter="open", dispersion=_TSA_STEP, sensor=sensor)
    scene = rendered_scene("coffee", wavelengths=camera.wavelengths, size=_PHOTOGRAPH)
    return camera, (_laid(scene["radiance"].values, size),)


def _light_field(kind: str, size: tuple[int, int], views: int) -> tuple[LightFieldCamera, tuple[Tensor, ...]]:
    camera = LightFieldCamera(views, size, 8, period=16, sensor=Sensor(read_noise=NOISE))
    scene = rendered_light_field("coffee", views=views, size=size)["light_field"]
    return camera, (torch.from_numpy(scene.values.copy())[None],)


def _pixel_shutter(kind: str, size: tuple[int, int], slots: int) -> tuple[SpectralCamera, tuple[Tensor, ...]]:
    """Every pixel open in one of the slots, before a scene that stands still."""
    chosen = torch.randint(slots, size, generator=torch.Generator().manual_seed(0))
    shutter = (chosen == torch.arange(slots)[:, None, None]).float()
    camera = SpectralCamera(
        [550e-9], size, slots, aperture="open", shutter=shutter, exposure="per-slot", dispersion=0.0,
        sensor=Sensor(read_noise=NOISE),
    )  # fmt: skip
    scene = rendered_scene("coffee", wavelengths=camera.wavelengths, size=_PHOTOGRAPH)
    return camera, (_laid(scene["radiance"].values, size),)


def _spectral_depth(kind: str, size: tuple[int, int], bands: int) -> tuple[SpectralDepthCamera, tuple[Tensor, ...]]:
    """The thesis' camera; of other numbers of bands with its wavelengths' ends."""
    waves = tuple(np.linspace(440e-9, 680e-9, bands).tolist())
    camera = SpectralDepthCamera.from_preset("thesis", bands=waves, size=size, sensor=Sensor(read_noise=NOISE))
    scene = rendered_scene("coffee", wavelengths=waves, size=_PHOTOGRAPH)
    depth = _within(as_tensors(scene)[1], camera.planes)
    return camera, (_laid(scene["radiance"].values, size), _laid(depth[0].numpy(), size))


def _within(depth: Tensor, planes: DepthPlanes) -> Tensor:
    """Depth moved into the range of the planes, evenly in inverse depth."""
    inverse = depth.nan_to_num(float(depth.nanmean())).reciprocal()
    share = (inverse - inverse.min()) / (inverse.max() - inverse.min())
    return (1 / planes.far + share * (1 / planes.near - 1 / planes.far)).reciprocal()


def _laid(values: np.ndarray, size: tuple[int, int]) -> Tensor:
    """(1, L, H, W) of a picture (L, h, w), mirrored over and over where it is smaller."""
    room = [(0, max(0, wanted - own)) for own, wanted in zip(values.shape[1:], size, strict=True)]
    laid = np.pad(values, [(0, 0), *room], mode="symmetric")[:, : size[0], : size[1]]
    return torch.from_numpy(np.ascontiguousarray(laid, dtype=np.float32))[None]


def prepare(case: Case, what: str) -> None:
    """Learn or make what decoders build on, and keep it; rendered priors keep themselves (``TMCA_CACHE``)."""
    if what.startswith("export"):
        _export(case, what.removeprefix("export "))
    elif case.kind == "light field" and what != "prior":
        _learn_views(case, what)
    else:
        find_prior(case.camera, None, "mixture" if what == "mixture" else "gaussian")


def _learn_views(case: Case, what: str) -> None:
    names = sorted(split_rendered_light_fields()["train"])
    views = case.camera.views[0]
    fields = [rendered_light_field(name, views=views, size=_EXAMPLES)["light_field"] for name in names]
    learn_prior(fields, case.camera, what).save(case.folder / f"{what}.nc", overwrite=True)


def _export(case: Case, format: str) -> None:
    """An untrained network of this camera as a program of its own."""
    camera, folder = case.camera, case.folder / f"exported-{format}"
    network = _network(case, _SPECTRAL_NETWORKS[_EXPORTED], bands=camera.bands)
    file = Weights.of(network.cpu(), camera.cpu()).save(case.folder / f"{format}.safetensors", overwrite=True)
    export_decoder(file, folder, (format,), noise=NOISE, overwrite=True)


def decoders(kind: str) -> list[str]:
    """Names of the decoders of a camera."""
    if kind == "spectral-depth":
        return [
            "likelihood",
            f"likelihood{_PREPARED}",
            *(f"network, two-headed from {start}" for start in DEPTH_STARTS),
        ]
    if kind == "pixel shutter":
        return list(decoders_for("spectral", moving=True))
    plain = [name for name in decoders_for("light-field" if kind == "light field" else "spectral") if name != "network"]
    plain[1:1] = ["lmmse --no-uncertainty", f"lmmse{_PREPARED}"]
    if kind == "light field":
        return [*plain, *(f"network, {name}" for name in NETWORKS)]
    return [*plain, *_SPECTRAL_NETWORKS, *(f"{_EXPORTED}, {name} export" for name in FORMATS)]


def decoder_of(case: Case, name: str) -> Frame:
    """What turns a frame into the scene, made of what was learned."""
    if name.endswith(_PREPARED):
        return _prepared(case, name.removesuffix(_PREPARED))
    if case.kind == "spectral-depth":
        return _depth_decoder(case, name)
    if case.kind == "pixel shutter":
        return lambda values: decode(Snapshot(values, case.camera), name, frames=16)
    if name.endswith(" export"):
        return _exported(case, name.removesuffix(" export").rpartition(", ")[2])
    if name.startswith("network"):
        return _by_network(case, name)
    method, _, plain = name.partition(" ")
    cls, how = DECODERS[method], dict[str, Any]()
    if cls.deviation:
        how["uncertainty"] = not plain
    if cls.prior_kind == "dictionary":
        how["prior"] = PatchDictionary.load(case.folder / "dictionary.nc")
    elif cls.prior_kind is not None:
        how["prior"] = _prior(case, cls.prior_kind == "mixture")
    return lambda values: decode(Snapshot(values, case.camera), method, **how)


def _prepared(case: Case, name: str) -> Frame:
    """A decoder that computed before the first frame what all frames have in common."""
    decoder = make_decoder(name, case.camera.kind, {"uncertainty": True} if DECODERS[name].deviation else {})
    return decoder.prepare(case.camera, _prior(case, False))


def _prior(case: Case, mixture: bool) -> Any:
    given = case.folder / "mixture.nc" if mixture and case.kind == "light field" else None
    return find_prior(case.camera, given, "mixture" if mixture else "gaussian")


def _network(case: Case, settings: dict[str, Any], **own: Any) -> Any:
    torch.manual_seed(0)
    return build_network(**settings, **own).eval().to(case.device)


def _by_network(case: Case, name: str) -> Frame:
    camera = case.camera
    if case.kind == "light field":
        settings = NETWORKS[name.removeprefix("network, ")]
        network = _network(case, settings, bands=camera.views[0] ** 2, views=camera.views)
    else:
        network = _network(case, _SPECTRAL_NETWORKS[name], bands=camera.bands)
    prior = _prior(case, False) if network.start == "lmmse" else None
    return lambda values: CollapsedNetwork(network, TapOperator(camera.taps()), camera.noise, prior)(values)


def _depth_decoder(case: Case, name: str) -> Frame:
    prior = None if name.endswith("snapshot") else find_prior(case.camera)
    if prior is not None and name == "likelihood":
        likelihood = PatchLikelihood(prior, case.camera)
        return lambda values: likelihood(values, planes=False)
    torch.manual_seed(0)
    network = build_depth_network({"start": name.split()[-1]}, case.camera).to(case.device)
    return TwoHeadedNetwork(network, case.camera, prior)


def _exported(case: Case, format: str) -> Frame:
    """A file of ``_export`` as a function, on as many threads as are asked for."""
    file = case.folder / f"exported-{format}" / FORMATS[format]
    if not file.is_file():
        raise SettingError(format, "no export", "one", "see its preparation")
    if format != "onnx":
        program = load_exported(file)
        return lambda values: program(values)
    import onnxruntime

    settings = onnxruntime.SessionOptions()
    settings.intra_op_num_threads = case.threads
    session = onnxruntime.InferenceSession(str(file), settings, providers=["CPUExecutionProvider"])
    return lambda values: session.run(None, {"snapshot": values.numpy()})


def needed(kind: str, name: str) -> str | None:
    """The preparation that a decoder builds on."""
    name = name.removesuffix(_PREPARED)
    if name.endswith(" export"):
        return f"export {name.removesuffix(' export').rpartition(', ')[2]}"
    first = name.partition(" ")[0]
    if first in ("mixture", "dictionary", "dictionary-omp"):
        return first.removesuffix("-omp")
    light_field_start = NETWORKS.get(name.removeprefix("network, "), {}).get("start", "")
    wants = first.startswith("lmmse") or name.endswith(("lmmse", "likelihood")) or light_field_start == "lmmse"
    return "prior" if wants else None
