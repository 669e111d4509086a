"""The spectral-depth camera in a training run: its settings, presets, scenes and weights."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field, model_validator
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.cameras.phase_codes import read_phase_codes
from tmca.cameras.presets import SPECTRAL_DEPTH_PRESETS
from tmca.data import make_folder
from tmca.decoders.depth_weights import DepthWeights, rendered_depth_prior
from tmca.decoders.two_headed import TwoHeadedUNet, build_depth_network
from tmca.errors import DataError, SettingError, ShapeError
from tmca.optics import PhaseMaskBench, Stroke, changed_bench
from tmca.priors import GaussianPrior, load_prior
from tmca.priors.spectral_depth import learn_depth_prior
from tmca.sensor import Sensor
from tmca.training.depth_patches import DepthPatchSource
from tmca.training.depth_system import DepthSystem
from tmca.training.patches import CubeStore, Load
from tmca.training.run import Prepared, Trained, card_of, steps_of, train
from tmca.training.scenes import RENDERED, SceneLists
from tmca.training.settings import (
    DataSettings,
    LearningSettings,
    OptimiserSettings,
    Strict,
    TrainSettings,
    settings_of,
)
from tmca.training.starts import KeptStarts, Pool

if TYPE_CHECKING:
    import xarray as xr
    from lightning_fabric import Fabric

_OF_MASKS = ("mask", "bench", "stroke", "depth", "planes", "energy")
"""What is taken over of a static code that starts all slots."""
_ASKED = ("depth", "planes", "filters", "channels", "exposure", "period")
"""What a run may ask for beside codes to start from, if it is what they were made for."""
_CHECKS = 4
"""Crops of every validation scene."""


class SpectralDepthCameraSettings(Strict):
    """The spectral-depth camera of a run; names as in `SpectralDepthCamera`, what is None as in the preset, and
    so is the number of slots that is not given.

    ``size`` is that of the patches: point spread functions and tiles fit any. ``learn`` says what is learned,
    ``stroke`` (lowest and highest, metres) and ``levels`` what the device can show, ``bench`` replaces arguments of
    `PhaseMaskBench`.
    """

    preset: str = "quick"
    size: tuple[int, int] = (64, 64)
    slots: int = Field(default=4, ge=1)
    depth: tuple[float, float] | None = None
    planes: int | None = Field(default=None, ge=2)
    mask: str | None = None
    rms: float | None = Field(default=None, ge=0)
    stroke: tuple[float, float] | None = None
    levels: int | None = Field(default=None, ge=2)
    bench: dict[str, Any] = Field(default={})
    shutter: str | None = None
    filters: str | None = None
    channels: str | None = None
    period: int | None = Field(default=None, ge=1)
    exposure: Literal["equal", "per-slot"] = "equal"
    image_formation: Literal["linear", "occlusion"] = "linear"
    seed: int = 0
    learn: Literal["none"] | tuple[Literal["mask", "shutter", "filters"], ...] = "none"


class SpectralDepthDataSettings(DataSettings):
    """Scenes with depth and patches; ``DataSettings`` says what is not said here.

    Args:
        train: rendered scenes, RGB-D scenes, spectral scenes with depth, cubes, or split files (``.txt``) of them.
        from_rgb: make up spectra of measured reflectances for RGB-D scenes.
        placed: how cubes without depth are put at drawn depths, a kind of ``tmca.data.place_cube``.
        side: scenes from files are averaged down while their shorter side keeps at least this many pixels.
        redrawn: share of patches at drawn depths.
        margin: pixels of scene around every patch, whose light falls into it; None for as many as light reaches. A
            patch in the dark would show its depth by the blur of its rim.
    """

    from_rgb: bool = False
    placed: str | None = None
    side: int = Field(default=256, ge=16)
    redrawn: float = Field(default=0.5, ge=0, le=1)
    margin: int | None = Field(default=None, ge=0)
    motion: Literal[0] = 0
    batch: int = Field(default=4, ge=1)


class SpectralDepthOptimiserSettings(OptimiserSettings):
    """Length of the run, learning rates, losses; ``OptimiserSettings`` says what is not said here.

    Args:
        code_rate: of heights, in units of the larger of a micrometre and the highest, and of latent values.
        depth_weight: of the error of inverse depth, as a share of the range, beside the loss of the cube.
    """

    code_rate: float = Field(default=0.005, ge=0)
    loss: Literal["l2", "l1", "charbonnier", "log"] = "l1"
    depth_weight: float = Field(default=0.1, ge=0)


class SpectralDepthTrainSettings(TrainSettings):
    """A whole run of the spectral-depth camera."""

    camera: SpectralDepthCameraSettings = SpectralDepthCameraSettings()  # type: ignore[assignment]
    decoder: dict[str, Any] = Field(default={"kind": "two-headed"})
    data: SpectralDepthDataSettings = SpectralDepthDataSettings()
    codes: LearningSettings = LearningSettings()  # type: ignore[assignment]
    optimiser: SpectralDepthOptimiserSettings = SpectralDepthOptimiserSettings()

    @model_validator(mode="after")
    def _has_levels(self) -> SpectralDepthTrainSettings:
        if self.camera.levels is not None and self.camera.stroke is None:
            raise ValueError("camera.levels: beside camera.stroke alone")
        if (self.camera.bench or self.camera.stroke) and self.codes.start not in ("random", "one-hot"):
            raise ValueError("camera.bench, camera.stroke: nothing, codes.start brings its own")
        return self

    @model_validator(mode="after")
    def _has_depth(self) -> SpectralDepthTrainSettings:
        if self.camera.size != (self.data.patch, self.data.patch):
            raise ValueError(f"camera.size {self.camera.size}: the patches', ({self.data.patch}, {self.data.patch})")
        least = self.data.patch + 2 * (self.data.margin or 0)
        if self.data.side < least:
            raise ValueError(f"data.side {self.data.side}: at least a patch and its margin, {least} pixels")
        if self.data.bands != type(self.data).model_fields["bands"].default:
            raise ValueError("data.bands: nothing, the bands are those of camera.preset")
        return self


SPECTRAL_DEPTH_TRAININGS: dict[str, dict[str, Any]] = {
    # thesis 5.2: 25 bands, K = 4, D = 8, R = 4, patches of 256², Adam at 1e-3, everything learned end to end. Assumed,
    # as the thesis does not say: batches of 2, 200 epochs, L1 plus 0.1 times the depth error, the plain two-headed
    # U-Net, codes started at random, code rate 0.005, no noise; and what `SpectralDepthCamera` assumes.
    "thesis": {
        "camera": {"preset": "thesis", "size": [256, 256], "learn": ["mask", "shutter", "filters"]},
        "decoder": {"kind": "two-headed", "start": "snapshot", "widths": [64, 128, 256]},
        "data": {"patch": 256, "batch": 2, "side": 512, "brightness": 0.0, "tint": 0.0},
        "optimiser": {"epochs": 200},
        "codes": {"frozen": 0.0},
        "precision": "32-true",
    },
    # a step takes under a second on two cores
    "quick": {
        "camera": {"preset": "quick", "size": [64, 64], "shutter": "one-hot"},
        "decoder": {"kind": "two-headed"},
        "noise": [{"read_noise": 0.002}],
        "data": {"patch": 64, "batch": 4, "pool": 256},
        "optimiser": {"steps": 400},
    },
}


def spectral_depth_settings(
    preset: str | None = None, file: str | Path | None = None, changes: Mapping[str, Any] | None = None
) -> SpectralDepthTrainSettings:
    """Settings of a preset of ``SPECTRAL_DEPTH_TRAININGS``, replaced by a file's, replaced by single changes.

    Raises:
        SettingError: unknown preset or name, impossible value.
        DataError: the file cannot be read.
    """
    return settings_of(SpectralDepthTrainSettings, SPECTRAL_DEPTH_TRAININGS, preset, file, changes)


def training_camera(settings: SpectralDepthTrainSettings) -> SpectralDepthCamera:
    """The camera with the codes that a run starts from: the preset's, those of earlier weights, or of `tmca design`.

    It sees a patch with its margin. Codes that were designed or learned bring the camera that they were made for; those
    of one slot show their mask in every slot.

    Raises:
        SettingError, DataError: an impossible camera, or codes that do not fit it.
    """
    given = {name: value for name, value in settings.camera.model_dump().items() if value is not None}
    learn, preset = given.pop("learn"), SPECTRAL_DEPTH_PRESETS.get(settings.camera.preset, {})
    stroke, levels, bench = given.pop("stroke", None), given.pop("levels", None), given.pop("bench")
    given |= {} if stroke is None else {"stroke": Stroke(stroke[0], stroke[1], levels)}
    given |= {"bench": changed_bench(preset.get("bench", PhaseMaskBench()), bench)} if bench else {}
    if "slots" not in settings.camera.model_fields_set:
        given["slots"] = preset.get("slots", given["slots"])
    given["learnable"] = False if learn == "none" else learn
    start = settings.codes.start
    if start in ("random", "one-hot"):
        given |= {"shutter": "one-hot"} if start == "one-hot" else {}
        return SpectralDepthCamera.from_preset(given.pop("preset"), **_with_margin(given, settings))
    given |= _started(Path(start), given, settings)
    given = _with_margin(given, settings)
    try:
        return SpectralDepthCamera.from_preset(given.pop("preset"), **given)
    except ShapeError as error:
        known = f"those of a camera like {settings.camera.preset}"
        raise DataError(start, f"codes that do not fit ({error})", known, "set camera.preset") from None


def _with_margin(given: dict[str, Any], settings: SpectralDepthTrainSettings) -> dict[str, Any]:
    """Arguments of the camera with the size of a patch and its margin, of whole tiles."""
    own = {"period": 1, "bench": PhaseMaskBench(), **SPECTRAL_DEPTH_PRESETS.get(settings.camera.preset, {}), **given}
    reach, period, margin = max(own["bench"].window) // 2, own["period"], settings.data.margin
    if margin is None:
        margin = -(-reach // period) * period
    if margin % period:
        raise SettingError("data.margin", f"{margin} pixels", f"whole tiles of {period} pixels")
    return {**given, "size": tuple(side + 2 * margin for side in settings.camera.size)}


def _started(start: Path, given: dict[str, Any], settings: SpectralDepthTrainSettings) -> dict[str, Any]:
    """Arguments of the camera that show the codes of weights, or of a file of `tmca design`, with all these were for.

    Raises:
        DataError: other numbers of slots.
        SettingError: another camera is asked for than the one that the codes were made for.
    """
    found = read_phase_codes(start) if start.suffix == ".nc" else _of_weights(start)
    slots = len(found["mask"])
    if slots not in (1, given["slots"]):
        raise DataError(start, f"{slots} slots", f"1 or {given['slots']}", "set camera.slots")
    said = _OF_MASKS if slots != given["slots"] else tuple(found)
    for name in {*_ASKED} & {*said} & settings.camera.model_fields_set:
        if given.get(name) != found[name] and not isinstance(found[name], torch.Tensor):
            known = f"{found[name]}, as in {start}"
            raise SettingError(f"camera.{name}", str(given.get(name)), known, "leave it out, or start from other codes")
    taken = {name: found[name] for name in said if name in found and name not in ("mask", "slots")}
    return taken | {"mask": found["mask"].expand(given["slots"], -1, -1).clone()}


def _of_weights(start: Path) -> dict[str, Any]:
    """The same of a trained camera."""
    before = DepthWeights.load(start).camera
    heights = before.spread.heights
    found = {"mask": heights().detach(), "shutter": before.tile()[1].detach(), "bench": before.bench}
    found |= {"stroke": heights.stroke, "depth": (before.planes.near, before.planes.far), "planes": before.planes.count}
    found |= {"filters": before.filters.filters, "cells": before.filters.cells(), "period": before.period}
    return found | {"channels": before.response, "exposure": before.exposure, "energy": before.spread.energy}


def channels_of(scene: xr.Dataset, camera: SpectralDepthCamera) -> NDArray[np.float32]:
    """(L + 1, H, W): cube, and inverse depth as a share of the range, NaN where it is unknown or outside."""
    depth, planes = torch.from_numpy(np.array(scene["depth"].values, dtype=np.float64)), camera.planes
    place = torch.where(planes.known(depth), planes.share_of(depth), torch.full_like(depth, torch.nan))
    return np.concatenate((scene["radiance"].values, place.numpy()[None])).astype(np.float32)


def train_spectral_depth(settings: SpectralDepthTrainSettings, folder: Path, load: Load, **how: Any) -> Trained:
    """Train a spectral-depth camera's codes and decoder; ``train`` says what the other arguments are.

    Args:
        settings: of the run.
        folder: of the run.
        load: from a scene's name to a dataset of ``radiance`` (wavelength, y, x) and ``depth`` (y, x) at the camera's
            bands and depth range.
        how: see ``train``.
    """
    return train(_prepare, settings, folder, load, **how)


def _prepare(
    settings: SpectralDepthTrainSettings, folder: Path, load: Load, lists: SceneLists, fabric: Fabric
) -> Prepared:
    camera = training_camera(settings)
    network = _network(settings, camera)
    prior = _prior(network, camera, folder, load, lists, fabric)

    def channels(name: str) -> NDArray[np.float32]:
        return channels_of(load(name), camera)  # type: ignore[arg-type]

    margin = (camera.size[0] - settings.data.patch) // 2
    validation = [crop for name in lists.validation for crop in _crops(name, channels(name), camera.size[0])]
    system = DepthSystem(
        camera, network, [Sensor(**noise.model_dump()) for noise in settings.noise], prior, validation,
        margin=margin, loss=settings.optimiser.loss, depth_weight=settings.optimiser.depth_weight, seed=settings.seed,
    )  # fmt: skip
    data, store = settings.data, CubeStore(lists.train, channels, make_folder(folder / "cubes"))
    patches = DepthPatchSource(store, camera.size[0], settings.seed, data.brightness, data.tint, data.redrawn)

    def keep(best: dict[str, Any]) -> None:
        named = "" if prior is None else "rendered" if lists.prior == RENDERED else "prior.nc"
        camera.filters.relax(False)
        found = DepthWeights(network, camera, named, card_of(settings, lists, best, system))
        found.save(folder / "weights.safetensors", overwrite=True)

    return Prepared(system, patches, keep, _pool(settings, system, patches, len(lists.train), folder))


def _network(settings: SpectralDepthTrainSettings, camera: SpectralDepthCamera) -> TwoHeadedUNet:
    network = build_depth_network(settings.decoder, camera)
    if settings.codes.decoder is not None:
        try:
            network.load_state_dict(DepthWeights.load(settings.codes.decoder).network.state_dict())
        except RuntimeError:
            raise DataError(
                settings.codes.decoder, "a decoder of other sizes", "the same kind and settings as in this run"
            ) from None
    return network


def _prior(
    network: TwoHeadedUNet, camera: SpectralDepthCamera, folder: Path, load: Load, lists: SceneLists, fabric: Fabric
) -> GaussianPrior | None:
    """The run's own prior, learned once, or that of the rendered scenes; none for a network from the snapshot."""
    if network.start != "likelihood":
        return None
    if lists.prior == RENDERED:
        return rendered_depth_prior(camera, network.window)
    file = folder / "prior.nc"
    if fabric.is_global_zero and not file.exists():
        learn_depth_prior(
            lists.prior or lists.train, lambda name: load(name)["radiance"], network.window, camera.bench.window
        ).save(file)
    fabric.barrier()
    found = load_prior(file)
    if not isinstance(found, GaussianPrior):
        raise DataError(file, f"a {type(found).__name__}", "a Gaussian prior", "delete the run's folder")
    return found


def _crops(name: str, channels: NDArray[np.float32], side: int) -> list[Tensor]:
    """Square crops of a validation scene, spread over it."""
    height, width = channels.shape[1:]
    if min(height, width) < side:
        remedy = "use smaller patches or name another scene"
        found = f"{height}×{width} pixels"
        raise DataError(name, found, f"at least {side}×{side}, a patch and its margin, to validate on", remedy)
    steps = max(1, round(_CHECKS**0.5))
    places = [
        (round((height - side) * (i + 0.5) / steps), round((width - side) * (j + 0.5) / steps))
        for i in range(steps) for j in range(steps)
    ]  # fmt: skip
    return [torch.from_numpy(channels[:, t : t + side, x : x + side].copy()) for t, x in places]


def _pool(
    settings: SpectralDepthTrainSettings, system: DepthSystem, patches: DepthPatchSource, scenes: int, folder: Path
) -> tuple[Pool, KeptStarts] | None:
    """Patches whose first stages are worth keeping."""
    if not settings.data.pool or system.network.start != "likelihood":
        return None
    data = settings.data
    pool = Pool.of(data.pool, data.batch, len(settings.noise), settings.seed, steps_of(settings, scenes))

    def compute(step: int) -> Tensor:
        every = range(pool.size)
        return system.start([patches(step, index) for index in every], step, every)

    return pool, KeptStarts(folder / "starts", compute)
