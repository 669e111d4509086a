"""A whole training run in a folder: set up, trained or resumed; the same for every camera."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from tmca.errors import SettingError
from tmca.training.folder import held, open_run
from tmca.training.loop import Progress, Run
from tmca.training.patches import Load, Patch
from tmca.training.precision import Precision, choose_precision, mixed_precision
from tmca.training.scenes import SceneLists, scene_lists
from tmca.training.settings import TrainSettings
from tmca.training.starts import KeptStarts, Pool
from tmca.training.system import System

if TYPE_CHECKING:
    from lightning_fabric import Fabric


@dataclass
class Prepared:
    """What a run needs of the camera that it trains.

    Args:
        system: camera and decoder.
        patch: (step, index) → patch.
        keep: writes the weights, told the best validation figures.
        pool: patches whose first estimates are worth keeping.
    """

    system: System
    patch: Callable[[int, int], Patch]
    keep: Callable[[dict[str, Any]], None]
    pool: tuple[Pool, KeptStarts] | None = None


Prepare = Callable[[Any, Path, Load, SceneLists, "Fabric"], Prepared]
"""From settings, folder, reader, scenes and engine to what is trained."""


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


def train(
    prepare: Prepare,
    settings: TrainSettings,
    folder: Path,
    load: Load,
    *,
    accelerator: str = "auto",
    processes: int = 1,
    nodes: int = 1,
    progress: Progress | None = None,
) -> Trained:
    """Train a camera's codes and decoder, or go on with a run that was stopped.

    Args:
        prepare: sets up camera, decoder and patches.
        settings: of the run.
        folder: of the run: ``run.json``, ``log.csv``, ``prior.nc``, ``checkpoints/``, ``weights.safetensors``.
        load: from a scene's name to the scene at the camera's bands or views.
        accelerator: ``"cpu"``, ``"cuda"`` or ``"auto"``.
        processes: on each machine; more than one in all must be started by ``torchrun``.
        nodes: machines, which share the run's folder.
        progress: called after every step, in the first process.

    Raises:
        OutputError: the folder holds another run.
        SettingError, DataError: impossible settings or scenes.
        TrainingError: a loss that is not finite.
    """
    lists = scene_lists(settings.data, settings.seed)
    precision = choose_precision(settings.precision, accelerator)
    fabric = _engine(settings, precision, accelerator, processes, nodes)
    used = settings.model_copy(update={"precision": precision})
    with held(folder) if fabric.is_global_zero else nullcontext():
        if fabric.is_global_zero:
            open_run(folder, settings, lists)
        fabric.barrier()
        torch.manual_seed(settings.seed)
        ready, steps = prepare(used, folder, load, lists, fabric), steps_of(settings, len(lists.train))
        told = progress if fabric.is_global_zero else None
        run = Run(ready.system, ready.patch, used, steps, folder, fabric, ready.keep, told, ready.pool)
        best = run.train()
        if ready.pool:
            ready.pool[1].forget()
        return Trained(folder / "weights.safetensors", best, steps, run.cpu_seconds)


def steps_of(settings: TrainSettings, scenes: int) -> int:
    """Optimiser steps of a run: as given, or those of its epochs."""
    data = settings.data
    epoch = max(1, -(-scenes * data.patches_per_scene // data.batch))
    return settings.optimiser.steps or settings.optimiser.epochs * epoch


def card_of(settings: TrainSettings, lists: SceneLists, best: dict[str, Any], system: System) -> dict[str, Any]:
    """How weights were trained and how good they are, JSON values."""
    train, validation = ([Path(name).name for name in names] for names in (lists.train, lists.validation))
    trained = {"training": settings.model_dump(), "scenes": train, "validation": validation}
    return {**trained, "best": best, **system.figures()}


def _engine(settings: TrainSettings, precision: Precision, accelerator: str, processes: int, nodes: int) -> Fabric:
    import logging
    import warnings

    from lightning_fabric import Fabric

    logging.getLogger("lightning_fabric").setLevel(logging.WARNING)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            fabric = Fabric(
                accelerator=accelerator, devices=processes, num_nodes=nodes,
                strategy="ddp" if processes * nodes > 1 else "auto",
                plugins=[mixed_precision(accelerator)] if precision == "bf16-mixed" else [],
            )  # fmt: skip
        except (ValueError, RuntimeError) as error:  # Fabric has no error of its own for a device that is not there
            raise SettingError("--accelerator", repr(accelerator), "one of this machine", str(error)) from None
        fabric.launch()
    if settings.data.batch % fabric.world_size:
        raise SettingError("data.batch", str(settings.data.batch), f"a multiple of the {fabric.world_size} processes")
    return fabric
