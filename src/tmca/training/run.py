"""A whole training run in a folder: set up, trained or resumed; the same for every camera."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import torch
from numpy.typing import NDArray

from tmca.decoders import Weights
from tmca.errors import DataError
from tmca.priors import find_prior, learn_prior
from tmca.sensor import Sensor
from tmca.summaries import Summary
from tmca.training.camera_training import TRAININGS, NeededPrior, scene_reader
from tmca.training.engine import choose_precision, start_engine
from tmca.training.folder import WEIGHTS, locked, open_run
from tmca.training.log import TrainingLog
from tmca.training.loop import LOG, Progress, Run, Setup
from tmca.training.patches import CubeStore, Load
from tmca.training.pool import Pool
from tmca.training.scenes import RENDERED, SceneLists, scene_lists
from tmca.training.settings import RunSettings, TrainSettings
from tmca.training.system import TrainingSystem, starts_from_prior

if TYPE_CHECKING:
    from lightning_fabric import Fabric
    from matplotlib.figure import Figure

    from tmca.cameras import Camera

PRIOR = "prior.nc"
"""In a run's folder."""


@dataclass(repr=False)
class Trained(Summary):
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

    def camera_for(self, size: tuple[int, int] | None = None, **changes: Any) -> Camera:
        """The camera with the codes that were learned, for scenes of (H, W) pixels.

        Args:
            size: (H, W); that of the run without.
            changes: other arguments of the camera, such as ``sensor``; without noise if none is given.

        Raises:
            DataError: the weights are gone.
            ShapeError: codes that are no tile have another size.
        """
        camera: Camera = Weights.load(self.weights).camera_for(size, **changes)
        return camera

    def plot(self) -> Figure:
        """How the run went: validation, loss and light of the codes over the steps.

        Raises:
            DataError: a damaged log.
        """
        from tmca.plots.curves import training_figure

        return training_figure(TrainingLog(self.weights.parent / LOG).rows())

    def _facts(self) -> dict[str, str]:
        best = self.best
        validated = bool(best.get("step")) and np.isfinite(best.get("psnr", np.nan))
        return {
            "weights": str(self.weights),
            "steps": f"{self.steps}, {self.cpu_seconds:.0f} CPU seconds",
            "validation": f"PSNR {best['psnr']:.2f} dB at step {best['step']}" if validated else "none",
        }

    def _picture(self) -> Figure:
        return self.plot()


def train(settings: TrainSettings, folder: Path, load: Load | None = None, **how: Any) -> Trained:
    """Train a camera's codes and decoder, or go on with a run that was stopped.

    Args:
        settings: of the run, of any camera; see `training_settings`.
        folder: of the run: ``run.json``, ``log.csv``, ``prior.nc``, ``checkpoints/``, ``weights.safetensors``.
        load: from a scene's name to the scene at the camera's bands or views; `scene_reader` without.
        how: ``accelerator``, ``processes``, ``nodes``, ``progress`` and ``finish`` of `carry_out`.

    Raises:
        OutputError: the folder holds another run.
        SettingError, DataError: impossible settings or scenes.
        TrainingError: a loss that is not finite.
    """
    lists = scene_lists(settings.data, settings.seed)
    prepare = partial(set_up, folder=folder, load=load or scene_reader(settings), lists=lists)
    trained = carry_out(prepare, settings, folder, lists, settings.steps(len(lists.train)), **how)
    TRAININGS[settings.kind].check(settings, Weights.load(trained.weights))
    return trained


def carry_out(
    prepare: Callable[[Any, Fabric], Setup],
    settings: RunSettings,
    folder: Path,
    lists: SceneLists,
    steps: int,
    *,
    accelerator: str = "auto",
    processes: int = 1,
    nodes: int = 1,
    progress: Progress | None = None,
    finish: Callable[[], None] | None = None,
) -> Trained:
    """A run of any system; errors as of `train`.

    Args:
        prepare: sets up camera, decoder and patches, of the settings with their precision chosen and the engine.
        settings: of the run.
        folder: of the run.
        lists: of its scenes.
        steps: in all.
        accelerator: ``"cpu"``, ``"cuda"`` or ``"auto"``.
        processes: on each machine; more than one in all must be started by ``torchrun``.
        nodes: machines, which share the run's folder.
        progress: called after every step, in the first process.
        finish: called in the first process when the run is done, while other runs are still kept out of its folder.
    """
    precision = choose_precision(settings.precision, accelerator)
    fabric = start_engine(settings, precision, accelerator, processes, nodes)
    used = settings.model_copy(update={"precision": precision})
    with locked(folder) if fabric.is_global_zero else nullcontext():
        if fabric.is_global_zero:
            open_run(folder, settings, lists)
        fabric.barrier()
        torch.manual_seed(settings.seed)
        shown = progress if fabric.is_global_zero else None
        run = Run(prepare(used, fabric), used, steps, folder, fabric, shown)
        trained = Trained(folder / WEIGHTS, run.train(), steps, run.cpu_seconds)
        fabric.barrier()
        if finish and fabric.is_global_zero:
            finish()
        return trained


def set_up(settings: TrainSettings, fabric: Fabric, folder: Path, load: Load, lists: SceneLists) -> Setup:
    """Camera, network, prior, scenes and patches of a run.

    Raises:
        SettingError, DataError: an impossible camera, network, or scene.
    """
    training = TRAININGS[settings.kind]
    camera = training.camera(settings, lambda: load(lists.train[0]))
    network = training.network(settings, camera)
    if settings.codes.decoder is not None:
        _take_decoder(settings.codes.decoder, network)
    needed = training.needed_prior(settings, camera, network)
    prior = None if needed is None else _prior(needed, camera, folder, load, lists, fabric)

    def channels(name: str) -> NDArray[np.float32]:
        return training.channels(load(name), camera)

    validation = [part for name in lists.validation for part in training.validation(name, channels(name), camera)]
    sensors = [Sensor(**noise.model_dump()) for noise in settings.noise]
    system = training.system(settings, camera, network, sensors, prior, validation)
    patches = training.source(settings, CubeStore(lists.train, channels, folder / "cubes"), camera)
    setup = Setup(system, patches, partial(_save, settings, system, lists, folder / WEIGHTS))
    if settings.data.pool and starts_from_prior(network):
        setup.pool = _pool(settings, setup, settings.steps(len(lists.train)), folder / "starts")
    return setup


def _take_decoder(start: str, network: torch.nn.Module) -> None:
    """Start from the decoder of an earlier run."""
    try:
        network.load_state_dict(Weights.load(start).network.state_dict())
    except RuntimeError:
        wanted = "the same kind and settings as in this run"
        raise DataError(start, "a decoder of other sizes", wanted) from None


def _prior(needed: NeededPrior, camera: Any, folder: Path, load: Load, lists: SceneLists, fabric: Fabric) -> Any:
    """The run's prior, learned once, or that of the rendered scenes."""
    file = None if lists.prior == RENDERED else folder / PRIOR
    if file is not None and fabric.is_global_zero and not file.exists():
        scenes = [load(name) for name in lists.prior or lists.train]
        learn_prior(scenes, camera, needed.kind, block=needed.block).save(file)
    fabric.barrier()
    return find_prior(camera, file, needed.kind, block=needed.rendered_block)


def _pool(settings: TrainSettings, setup: Setup, steps: int, folder: Path) -> Pool:
    """Patches whose first estimates are worth caching."""
    data, system = settings.data, cast(TrainingSystem, setup.system)

    def compute(step: int, places: Any) -> torch.Tensor:
        return cast(torch.Tensor, system.start([setup.patch(step, index) for index in places], step, places))

    how = {"seed": settings.seed, "folder": folder, "compute": compute}
    return Pool.of(data.pool, data.batch, len(settings.noise), steps, **how)


def _save(settings: TrainSettings, system: TrainingSystem, lists: SceneLists, file: Path, best: dict[str, Any]) -> None:
    """Write the present state as a decoder with its codes, and how it was trained."""
    prior = "" if not starts_from_prior(system.network) else "rendered" if lists.prior == RENDERED else PRIOR
    scenes, validation = ([Path(name).name for name in names] for names in (lists.train, lists.validation))
    card = {"training": settings.model_dump(), "scenes": scenes, "validation": validation, "best": best}
    Weights.of(system.network, system.camera, prior, card | system.figures()).save(file, overwrite=True)
