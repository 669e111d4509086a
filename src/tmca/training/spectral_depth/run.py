"""The spectral-depth camera in a training run: scenes go in, weights come out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.data import make_folder
from tmca.decoders import Weights
from tmca.decoders.nets.build import build_depth_network
from tmca.decoders.nets.two_headed import TwoHeadedUNet
from tmca.errors import DataError
from tmca.optics import check_mask
from tmca.priors import GaussianPrior, block_of, find_prior, learn_prior
from tmca.priors.spectral_depth import needed_block
from tmca.sensor import Sensor
from tmca.training.faults import DrawnFaults
from tmca.training.patches import CubeStore, Load
from tmca.training.run import Prepared, Trained, card_of, steps_of, train
from tmca.training.scenes import RENDERED, SceneLists
from tmca.training.spectral_depth.camera import training_camera
from tmca.training.spectral_depth.patches import DepthPatchSource
from tmca.training.spectral_depth.settings import SpectralDepthTrainSettings
from tmca.training.spectral_depth.system import DepthSystem
from tmca.training.spectral_depth.windows import SIDE
from tmca.training.starts import KeptStarts, Pool

if TYPE_CHECKING:
    import xarray as xr
    from lightning_fabric import Fabric
_CHECKS = 4
"""Crops of every validation scene."""


def channels_of(scene: xr.Dataset, camera: SpectralDepthCamera) -> NDArray[np.float32]:
    """(L + 1, H, W): cube, and inverse depth as a share of the range, NaN where it is unknown or outside."""
    depth, planes = torch.from_numpy(np.array(scene["depth"].values, dtype=np.float64)), camera.planes
    place = torch.where(planes.within(depth), planes.share_of(depth), torch.full_like(depth, torch.nan))
    return np.concatenate((scene["radiance"].values, place.numpy()[None])).astype(np.float32)


def train_spectral_depth(settings: SpectralDepthTrainSettings, folder: Path, load: Load, **how: Any) -> Trained:
    """Train a spectral-depth camera's codes and decoder; ``train`` says what the other arguments are.

    Args:
        settings: of the run.
        folder: of the run.
        load: from a scene's name to a dataset of ``radiance`` (wavelength, y, x) and ``depth`` (y, x) at the camera's
            bands and depth range.
        how: see ``train``.

    Warns:
        StrayLight, Undersampled: learned masks send light beside their windows, or are steeper than their pixels.
    """
    found = train(_prepare, settings, folder, load, **how)
    if "mask" in settings.camera.learn:
        check_mask(Weights.load(found.weights).camera.point_spread)
    return found


def _prepare(
    settings: SpectralDepthTrainSettings, folder: Path, load: Load, lists: SceneLists, fabric: Fabric
) -> Prepared:
    camera = training_camera(settings)
    network = _network(settings, camera)
    by_likelihood = bool(camera.learnable and settings.optimiser.likelihood_weight)
    wanted = network.start == "likelihood" or by_likelihood
    prior = _prior(network, camera, folder, load, lists, fabric) if wanted else None

    def channels(name: str) -> NDArray[np.float32]:
        return channels_of(load(name), camera)  # type: ignore[arg-type]

    margin = (camera.size[0] - settings.data.patch) // 2
    validation = [crop for name in lists.validation for crop in _crops(name, channels(name), camera.size[0])]
    system = DepthSystem(
        camera, network, [Sensor(**noise.model_dump()) for noise in settings.noise], prior, validation,
        margin=margin, faults=DrawnFaults(settings.faults), seed=settings.seed,
        **settings.optimiser.model_dump(include={"loss", "depth_weight", "likelihood_weight", "likelihood_every"}),
    )  # fmt: skip
    data, store = settings.data, CubeStore(lists.train, channels, make_folder(folder / "cubes"))
    patches = DepthPatchSource(store, camera.size[0], settings.seed, data.brightness, data.tint, data.redrawn)

    def keep(best: dict[str, Any]) -> None:
        named = "" if network.start != "likelihood" else "rendered" if lists.prior == RENDERED else "prior.nc"
        camera.filters.relax(False)
        found = Weights.of(network, camera, named, card_of(settings, lists, best, system))
        found.save(folder / "weights.safetensors", overwrite=True)

    return Prepared(system, patches, keep, _pool(settings, system, patches, len(lists.train), folder))


def _network(settings: SpectralDepthTrainSettings, camera: SpectralDepthCamera) -> TwoHeadedUNet:
    network = build_depth_network(settings.decoder, camera)
    if settings.codes.decoder is not None:
        try:
            network.load_state_dict(Weights.load(settings.codes.decoder).network.state_dict())
        except RuntimeError:
            raise DataError(
                settings.codes.decoder, "a decoder of other sizes", "the same kind and settings as in this run"
            ) from None
    return network


def _prior(
    network: TwoHeadedUNet, camera: SpectralDepthCamera, folder: Path, load: Load, lists: SceneLists, fabric: Fabric
) -> GaussianPrior:
    """The run's own prior, learned once, or that of the rendered scenes, for windows of network and codes."""
    window = max(network.window, SIDE, camera.tile_size) if camera.learnable else network.window
    file = None if lists.prior == RENDERED else folder / "prior.nc"
    if file is not None and fabric.is_global_zero and not file.exists():
        scenes = [load(name) for name in lists.prior or lists.train]
        learn_prior(scenes, camera, block=needed_block(window, camera.bench.window)).save(file)
    fabric.barrier()
    return find_prior(camera, file, block=block_of(camera, window=window))


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
