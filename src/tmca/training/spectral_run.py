"""A whole training run of the spectral camera in a folder: set up, trained or resumed, written as weights."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from tmca.cameras import SpectralCamera
from tmca.data import make_folder
from tmca.decoders.network import build_network
from tmca.decoders.neural import Weights
from tmca.decoders.start import NEED_PRIOR
from tmca.errors import DataError, SettingError
from tmca.priors import GaussianMixturePrior, GaussianPrior, learn_prior, load_prior, rendered_prior
from tmca.sensor import Sensor
from tmca.training.folder import held, open_run
from tmca.training.loop import Progress, Run
from tmca.training.patches import CubeStore, Load, Patch, PatchSource
from tmca.training.scenes import RENDERED, SceneLists, scene_lists
from tmca.training.settings import TrainSettings
from tmca.training.spectral import SpectralSystem
from tmca.training.starting_camera import starting_camera
from tmca.training.starts import KeptStarts, Pool

if TYPE_CHECKING:
    from lightning_fabric import Fabric


@dataclass
class Trained:
    """What a run leaves.

    Args:
        weights: file of the best validation, or of the last step where there was none.
        best: validation figures.
        steps: in all.
        cpu_seconds: of all the pieces that a run was stopped into, loading and set-up apart.
    """

    weights: Path
    best: dict[str, Any]
    steps: int
    cpu_seconds: float = 0.0


def train_spectral(
    settings: TrainSettings,
    folder: Path,
    load: Load,
    *,
    accelerator: str = "auto",
    processes: int = 1,
    nodes: int = 1,
    progress: Progress | None = None,
) -> Trained:
    """Train a spectral camera's codes and decoder, or go on with a run that was stopped.

    Args:
        settings: of the run.
        folder: of the run: ``run.json``, ``log.csv``, ``prior.nc``, ``checkpoints/``, ``weights.safetensors``.
        load: from a scene's name to its cube at the camera's bands.
        accelerator: ``"cpu"``, ``"cuda"`` or ``"auto"``.
        processes: on each machine; more than one in all must be started by ``torchrun``.
        nodes: machines, which share the run's folder.
        progress: told about every step, in the first process.

    Raises:
        OutputError: the folder holds another run.
        SettingError, DataError: impossible settings or scenes.
        TrainingError: a loss that is not finite.
    """
    lists = scene_lists(settings.data, settings.seed)
    fabric = _engine(settings, accelerator, processes, nodes)
    with held(folder) if fabric.is_global_zero else nullcontext():
        if fabric.is_global_zero:
            open_run(folder, settings, lists)
        fabric.barrier()
        return _train(settings, folder, load, lists, fabric, progress if fabric.is_global_zero else None)


def _train(
    settings: TrainSettings, folder: Path, load: Load, lists: SceneLists, fabric: Fabric, progress: Progress | None
) -> Trained:
    torch.manual_seed(settings.seed)
    first = load(lists.train[0])
    wavelengths = first["wavelength"].values.tolist()
    camera = starting_camera(settings, wavelengths)
    decoder = dict(settings.decoder)
    if "bands" in decoder:
        raise SettingError("decoder.bands", str(decoder["bands"]), "nothing: data.bands says it", "leave it out")
    network = build_network(decoder.pop("kind", "unrolled"), bands=camera.bands, **decoder)
    _take_decoder(settings, network)
    prior = _prior(fabric, folder, lists, load, camera, network.start) if network.start in NEED_PRIOR else None
    validation = [_middle(load(name).values, settings.camera.size) for name in lists.validation]
    sensors = [Sensor(**noise.model_dump()) for noise in settings.noise]
    system = SpectralSystem(
        camera, network, sensors, prior, validation, loss=settings.optimiser.loss, codes=settings.codes,
        through_start=settings.codes.through_start, seed=settings.seed,
    )  # fmt: skip
    patches = _patches(settings, CubeStore(lists.train, load, make_folder(folder / "cubes")))
    steps = settings.optimiser.steps or _steps_of_epochs(settings, len(lists.train))

    def keep(best: dict[str, Any]) -> None:
        weights_of(system, settings, lists, best, bool(prior)).save(folder / "weights.safetensors", overwrite=True)

    pool = _pool(settings, system, patches, steps, folder)
    run = Run(system, patches, settings, steps, folder, fabric, keep, progress, pool)
    best = run.train()
    if pool:
        pool[1].forget()
    return Trained(folder / "weights.safetensors", best, steps, run.cpu_seconds)


def _pool(
    settings: TrainSettings, system: SpectralSystem, patches: Callable[[int, int], Patch], steps: int, folder: Path
) -> tuple[Pool, KeptStarts] | None:
    """Patches whose first estimates are worth keeping."""
    if not settings.data.pool or system.network.start not in NEED_PRIOR:
        return None
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
    system: SpectralSystem, settings: TrainSettings, lists: SceneLists, best: dict[str, Any], with_prior: bool
) -> Weights:
    """The present state as a decoder with its codes."""
    camera, codes = system.camera, system.camera.multiplexed
    with torch.no_grad():
        planes = [(plane.tile() if plane.period else plane()).clone() for plane in (codes.aperture, codes.shutter)]
    kept = {
        "size": list(camera.size), "period": settings.camera.period, "exposure": camera.exposure,
        "dispersion": list(camera.dispersion.displacement), "disperser": camera.disperser,
    }  # fmt: skip
    card = {
        "training": settings.model_dump(), "scenes": list(map(_short, lists.train)),
        "validation": list(map(_short, lists.validation)), "best": best, **system.figures(),
    }  # fmt: skip
    prior = ("rendered" if lists.prior == RENDERED else "prior.nc") if with_prior else ""
    return Weights(system.network, camera.wavelengths, planes[0], planes[1], kept, prior, card)


def _short(name: str) -> str:
    return Path(name).name


def _engine(settings: TrainSettings, accelerator: str, processes: int, nodes: int) -> Fabric:
    import logging
    import warnings

    from lightning_fabric import Fabric

    logging.getLogger("lightning_fabric").setLevel(logging.WARNING)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            fabric = Fabric(
                accelerator=accelerator, devices=processes, num_nodes=nodes, precision=settings.precision,
                strategy="ddp" if processes * nodes > 1 else "auto",
            )  # fmt: skip
        except (ValueError, RuntimeError) as error:  # Fabric has no error of its own for a device that is not there
            raise SettingError("--accelerator", repr(accelerator), "one of this machine", str(error)) from None
        fabric.launch()
    if settings.data.batch % fabric.world_size:
        raise SettingError("data.batch", str(settings.data.batch), f"a multiple of the {fabric.world_size} processes")
    return fabric


def _prior(
    fabric: Fabric, folder: Path, lists: SceneLists, load: Load, camera: SpectralCamera, start: str
) -> GaussianPrior | GaussianMixturePrior:
    """The run's own prior, learned once, or that of the rendered scenes."""
    if lists.prior == RENDERED:
        return rendered_prior(camera.wavelengths, camera.dispersion.spread, mixture=start == "mixture")
    file = folder / "prior.nc"
    if fabric.is_global_zero and not file.exists():
        spread = camera.dispersion.spread
        cubes = [load(name) for name in lists.prior or lists.train]
        mixture = start == "mixture"
        learn_prior(cubes, spread=spread, mixture=mixture).save(file)
    fabric.barrier()
    return load_prior(file)


def _patches(settings: TrainSettings, store: CubeStore) -> Callable[[int, int], Any]:
    data = settings.data
    return PatchSource(
        store, data.patch, settings.seed, brightness=data.brightness, tint=data.tint, motion=data.motion,
        slots=settings.camera.slots,
    )  # fmt: skip


def _steps_of_epochs(settings: TrainSettings, scenes: int) -> int:
    data = settings.data
    return settings.optimiser.epochs * max(1, -(-scenes * data.patches_per_scene // data.batch))


def _middle(cube: Any, size: tuple[int, int]) -> Tensor:
    """(L, H, W) the middle of a validation scene, no larger than the camera."""
    height, width = min(cube.shape[1], size[0]), min(cube.shape[2], size[1])
    top, left = (cube.shape[1] - height) // 2, (cube.shape[2] - width) // 2
    return torch.from_numpy(np.array(cube[:, top : top + height, left : left + width], dtype=np.float32))
