"""`tmca.train`: a run of any camera from names and dotted settings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tmca.arguments import Count, Kind, Names, checked
from tmca.progress import Asked, counting
from tmca.training.camera_training import training_settings
from tmca.training.run import Trained
from tmca.training.run import train as run


@checked
def train(
    camera: Kind = "spectral",
    *,
    out: str | Path,
    scenes: Names | None = None,
    validation: Names | None = None,
    preset: str | None = None,
    config: str | Path | None = None,
    settings: Mapping[str, Any] | None = None,
    progress: Asked = None,
    accelerator: str = "auto",
    processes: Count = 1,
    nodes: Count = 1,
) -> Trained:
    """Train a camera's codes and its decoder together; the same call goes on with a run that was stopped.

    Args:
        camera: kind of the camera, such as ``SpectralCamera.kind``.
        out: folder of the run: ``weights.safetensors``, ``log.csv``, checkpoints.
        scenes: to learn from, files, rendered scenes, or split files; those of the preset if None.
        validation: the same, for choosing the best step.
        preset: ``"quick"`` or ``"thesis"``.
        config: YAML of settings, which replace the preset's.
        settings: dotted names and values, such as ``{"camera.slots": 4}``, which replace both.
        progress: called after every step with (done, all, text); True for a bar, False for none; None for one that is
            shown after a second in a terminal or a notebook.
        accelerator: ``"cpu"``, ``"cuda"`` or ``"auto"``.
        processes: on each machine; more than one in all must be started by ``torchrun``.
        nodes: machines, which share the run's folder.

    Raises:
        SettingError, DataError, OutputError: impossible settings or scenes, or the folder of another run.
    """
    named = {"data.train": scenes, "data.validation": validation}
    changes = {**(settings or {}), **{name: list(value) for name, value in named.items() if value is not None}}
    engine: dict[str, Any] = {"accelerator": accelerator, "processes": processes, "nodes": nodes}
    chosen = training_settings(camera, preset, config, changes)
    with counting(progress, f"train {Path(out).name}") as report:
        return run(chosen, Path(out), progress=report, **engine)
