"""A training run of a camera whose slots collapse into one code: camera, network, prior, scenes, weights."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.cameras import CodedCamera
from tmca.data import make_folder
from tmca.decoders import Network, Weights, build_network
from tmca.decoders.nets.network import NEED_PRIOR
from tmca.errors import DataError, SettingError
from tmca.priors import GaussianMixturePrior, GaussianPrior, find_prior, learn_prior
from tmca.sensor import Sensor
from tmca.training.faults import DrawnFaults
from tmca.training.imaging import ImagingSystem
from tmca.training.patches import CubeStore, Load, Patch, PatchSource
from tmca.training.run import Prepared, card_of, steps_of
from tmca.training.scenes import RENDERED, SceneLists
from tmca.training.settings import TrainSettings
from tmca.training.starts import KeptStarts, Pool

if TYPE_CHECKING:
    import xarray as xr
    from lightning_fabric import Fabric


class Application(Protocol):
    """What a run asks of the camera that it trains."""

    name: str

    def camera(self, settings: Any, first: xr.DataArray) -> CodedCamera:
        """The camera with the codes that the run starts from, for scenes like the first."""

    def array(self, scene: xr.DataArray) -> NDArray[np.float32]:
        """(L, H, W) channels of a scene."""

    def views(self, camera: CodedCamera) -> tuple[int, int] | None:
        """(V, U) where the channels are views, which turn with the pixels."""


def prepare_imaging(
    application: Application, settings: TrainSettings, folder: Path, load: Load, lists: SceneLists, fabric: Fabric
) -> Prepared:
    """Camera, network, prior, scenes and patches of a run."""
    camera = application.camera(settings, load(lists.train[0]))
    network = _network(settings, camera.channels)
    prior = None
    if network.start in NEED_PRIOR:
        kind = "mixture" if network.start == "mixture" else "gaussian"
        prior = _prior(kind, fabric, folder, lists, load, camera)

    def channels(name: str) -> NDArray[np.float32]:
        return application.array(load(name))

    validation = [_middle(channels(name), settings.camera.size) for name in lists.validation]
    sensors = [Sensor(**noise.model_dump()) for noise in settings.noise]
    system = ImagingSystem(
        camera, network, sensors, prior, validation, loss=settings.optimiser.loss, codes=settings.codes,
        through_start=settings.codes.through_start, faults=DrawnFaults(settings.faults), seed=settings.seed,
    )  # fmt: skip
    store = CubeStore(lists.train, channels, make_folder(folder / "cubes"))
    patches = _patches(settings, store, application.views(camera))

    def keep(best: dict[str, Any]) -> None:
        found = weights_of(system, settings, lists, best, bool(prior))
        found.save(folder / "weights.safetensors", overwrite=True)

    return Prepared(system, patches, keep, _pool(settings, system, patches, len(lists.train), folder))


def _network(settings: TrainSettings, channels: int) -> Network:
    decoder = dict(settings.decoder)
    if "bands" in decoder:
        raise SettingError("decoder.bands", str(decoder["bands"]), "nothing: the data say it", "leave it out")
    network = build_network(decoder.pop("kind", "unrolled"), bands=channels, **decoder)
    _take_decoder(settings, network)
    return network


def _pool(
    settings: TrainSettings, system: ImagingSystem, patches: Callable[[int, int], Patch], scenes: int, folder: Path
) -> tuple[Pool, KeptStarts] | None:
    """Patches whose first estimates are worth keeping."""
    if not settings.data.pool or system.network.start not in NEED_PRIOR:
        return None
    steps = steps_of(settings, scenes)
    pool = Pool.of(settings.data.pool, settings.data.batch, len(settings.noise), settings.seed, steps)

    def compute(step: int) -> Tensor:
        every = range(pool.size)
        return system.start([patches(step, index) for index in every], step, every)

    return pool, KeptStarts(folder / "starts", compute)


def _take_decoder(settings: TrainSettings, network: torch.nn.Module) -> None:
    """Start from the decoder of an earlier run."""
    if settings.codes.decoder is None:
        return
    found = Weights.load(settings.codes.decoder)
    try:
        network.load_state_dict(found.network.state_dict())
    except RuntimeError:
        raise DataError(
            settings.codes.decoder, "a decoder of other sizes", "the same kind and settings as in this run"
        ) from None


def weights_of(
    system: ImagingSystem, settings: TrainSettings, lists: SceneLists, best: dict[str, Any], with_prior: bool
) -> Weights:
    """The present state as a decoder with its codes."""
    prior = ("rendered" if lists.prior == RENDERED else "prior.nc") if with_prior else ""
    return Weights.of(system.network, system.camera, prior, card_of(settings, lists, best, system))


def _prior(
    kind: str, fabric: Fabric, folder: Path, lists: SceneLists, load: Load, camera: CodedCamera
) -> GaussianPrior | GaussianMixturePrior:
    """The run's own prior, learned once, or that of the rendered scenes."""
    file = None if lists.prior == RENDERED else folder / "prior.nc"
    if file is not None and fabric.is_global_zero and not file.exists():
        learn_prior([load(name) for name in lists.prior or lists.train], camera, kind).save(file)
    fabric.barrier()
    return cast(GaussianPrior | GaussianMixturePrior, find_prior(camera, file, kind))


def _patches(settings: TrainSettings, store: CubeStore, views: tuple[int, int] | None) -> Callable[[int, int], Any]:
    data = settings.data
    return PatchSource(
        store, data.patch, settings.seed, brightness=data.brightness, tint=data.tint, motion=data.motion,
        slots=settings.camera.slots, views=views,
    )  # fmt: skip


def _middle(cube: NDArray[np.float32], size: tuple[int, int]) -> Tensor:
    """(L, H, W) the middle of a validation scene, no larger than the camera."""
    height, width = min(cube.shape[1], size[0]), min(cube.shape[2], size[1])
    top, left = (cube.shape[1] - height) // 2, (cube.shape[2] - width) // 2
    return torch.from_numpy(np.array(cube[:, top : top + height, left : left + width], dtype=np.float32))
