"""Checkpoints: a folder per checkpoint with ``state.safetensors`` and ``state.json``, written whole or not at all."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any
from warnings import warn

from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn
from torch.optim import Optimizer

from tmca.data import atomic_path, make_folder, write_json
from tmca.errors import DataError

_NEWEST = 2
"""Checkpoints that a run has at most."""
_TENSORS, _STATE = "state.safetensors", "state.json"


class DamagedFile(UserWarning):
    """A file that was passed over."""


def save_checkpoint(
    folder: Path, step: int, system: nn.Module, optimizers: dict[str, Optimizer], state: dict[str, Any]
) -> Path:
    """Write ``folder/NNNNNNN`` and delete all but the newest two.

    Args:
        folder: of the run's checkpoints.
        step: steps done.
        system: camera and decoder.
        optimizers: by name.
        state: JSON values beside the tensors.

    Raises:
        OutputError: the disk is full, or the folder cannot be written.
    """
    make_folder(folder)
    tensors = {f"system.{name}": value for name, value in system.state_dict().items()}
    for name, optimizer in optimizers.items():
        tensors |= {f"optimizer.{name}.{key}": value for key, value in _flat(optimizer).items()}
    with atomic_path(folder / f"{step:07d}", overwrite=True) as temporary:
        temporary.mkdir()
        copies = {name: value.detach().cpu().contiguous().clone() for name, value in tensors.items()}
        save_file(copies, temporary / _TENSORS)
        write_json({"step": step, **state}, temporary / _STATE)
    for old in _checkpoints(folder)[:-_NEWEST]:
        shutil.rmtree(old, ignore_errors=True)
    return folder / f"{step:07d}"


def latest_checkpoint(folder: Path) -> Path | None:
    """The newest checkpoint of a run, or None. What a killed process left half-written does not count."""
    return next(reversed(_checkpoints(folder)), None)


def load_latest(folder: Path, system: nn.Module, optimizers: dict[str, Optimizer]) -> dict[str, Any] | None:
    """Bring a run to its newest checkpoint, or the one before where a power cut damaged it.

    Returns:
        Its JSON values; None without any checkpoint.

    Raises:
        DataError: none of them can be read, or they belong to another camera or decoder.

    Warns:
        DamagedFile: a checkpoint that was passed over.
    """
    damaged = None
    for path in reversed(_checkpoints(folder)):
        if damaged is not None:
            warn(f"{damaged}; going on from the one before", DamagedFile, stacklevel=2)
        try:
            tensors, state = load_file(path / _TENSORS), json.loads((path / _STATE).read_text())
        except (OSError, SafetensorError, json.JSONDecodeError) as error:
            damaged = DataError(path, f"an unreadable checkpoint ({error})", "one that is whole")
            continue
        _restore(path, tensors, system, optimizers)
        return dict(state)
    if damaged is not None:
        raise damaged
    return None


def _checkpoints(folder: Path) -> list[Path]:
    """Oldest first."""
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if path.name.isdigit() and (path / _STATE).is_file())


def _flat(optimizer: Optimizer) -> dict[str, Tensor]:
    """State of every parameter, by its place and name; Adam's are all tensors."""
    state = optimizer.state_dict()["state"]
    return {f"{place}.{name}": value for place, values in state.items() for name, value in values.items()}


def _restore(path: Path, tensors: dict[str, Tensor], system: nn.Module, optimizers: dict[str, Optimizer]) -> None:
    try:
        system.load_state_dict(_under("system.", tensors))
    except RuntimeError as error:
        found = f"the state of another camera or decoder ({error})"
        raise DataError(path, found, "this run's", "delete the checkpoint") from error
    for name, optimizer in optimizers.items():
        state: dict[int, dict[str, Tensor]] = {}
        for key, value in _under(f"optimizer.{name}.", tensors).items():
            place, part = key.split(".", 1)
            state.setdefault(int(place), {})[part] = value
        optimizer.load_state_dict({"state": state, "param_groups": optimizer.state_dict()["param_groups"]})


def _under(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
