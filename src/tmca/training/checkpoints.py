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

_KEPT = 2
_TENSORS, _STATE = "state.safetensors", "state.json"


class DamagedCheckpoint(DataError):
    """A checkpoint that cannot be read."""


class DamagedFile(UserWarning):
    """A file that was passed over."""


def save_checkpoint(
    folder: Path, step: int, system: nn.Module, optimizers: dict[str, Optimizer], state: dict[str, Any]
) -> Path:
    """Write ``folder/NNNNNNN`` and delete all but the newest two.

    Args:
        folder: of the run's checkpoints.
        step: steps done.
        system: its whole state is kept.
        optimizers: by name.
        state: JSON values beside the tensors.

    Raises:
        OutputError: the disk is full, or the folder cannot be written.
    """
    make_folder(folder)
    tensors = {f"system.{name}": value.detach().cpu().contiguous() for name, value in system.state_dict().items()}
    for name, optimizer in optimizers.items():
        tensors |= {f"optimizer.{name}.{key}": value for key, value in _flat(optimizer).items()}
    with atomic_path(folder / f"{step:07d}", overwrite=True) as temporary:
        temporary.mkdir()
        save_file({name: value.clone() for name, value in tensors.items()}, temporary / _TENSORS)
        write_json({"step": step, **state}, temporary / _STATE)
    for old in _checkpoints(folder)[:-_KEPT]:
        shutil.rmtree(old, ignore_errors=True)
    return folder / f"{step:07d}"


def latest_checkpoint(folder: Path) -> Path | None:
    """The newest checkpoint of a run, or None. What a killed process left half-written does not count."""
    found = _checkpoints(folder)
    return found[-1] if found else None


def load_latest(folder: Path, system: nn.Module, optimizers: dict[str, Optimizer]) -> dict[str, Any] | None:
    """Bring a run to its newest checkpoint, or the one before where a power cut damaged it; None without any.

    Raises:
        DataError: none of them can be read, or they belong to a system of other sizes.
    """
    found = _checkpoints(folder)
    for place, path in enumerate(reversed(found), start=1):
        try:
            return load_checkpoint(path, system, optimizers)
        except DamagedCheckpoint as error:
            if place == len(found):
                raise
            warn(f"{error}; going on from the one before", DamagedFile, stacklevel=2)
    return None


def load_checkpoint(path: Path, system: nn.Module, optimizers: dict[str, Optimizer]) -> dict[str, Any]:
    """Bring a system and its optimizers to the state of a checkpoint; returns its JSON values.

    Raises:
        DamagedCheckpoint: it cannot be read.
        DataError: of a system of other sizes. The system is unchanged in both cases.
    """
    try:
        tensors = load_file(path / _TENSORS)
        state: dict[str, Any] = json.loads((path / _STATE).read_text())
    except (OSError, SafetensorError, json.JSONDecodeError) as error:
        raise DamagedCheckpoint(path, f"an unreadable checkpoint ({error})", "one that is whole") from error
    own = {name.removeprefix("system."): value for name, value in tensors.items() if name.startswith("system.")}
    _check_sizes(path, own, system.state_dict())
    system.load_state_dict(own)
    for name, optimizer in optimizers.items():
        prefix = f"optimizer.{name}."
        _restore(optimizer, {key.removeprefix(prefix): v for key, v in tensors.items() if key.startswith(prefix)})
    return state


def _checkpoints(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if path.name.isdigit() and (path / _STATE).is_file())


def _check_sizes(path: Path, found: dict[str, Tensor], expected: dict[str, Tensor]) -> None:
    for name in sorted(found.keys() | expected.keys()):
        sizes = [tuple(part[name].shape) if name in part else "nothing" for part in (found, expected)]
        if sizes[0] != sizes[1]:
            raise DataError(path, f"{sizes[0]} for {name}", f"{sizes[1]}", "it belongs to another camera or decoder")


def _flat(optimizer: Optimizer) -> dict[str, Tensor]:
    """State of every parameter, by its place and name; Adam's are all tensors."""
    state = optimizer.state_dict()["state"]
    return {
        f"{place}.{name}": value.detach().cpu().contiguous()
        for place, values in state.items()
        for name, value in values.items()
        if isinstance(value, Tensor)
    }


def _restore(optimizer: Optimizer, tensors: dict[str, Tensor]) -> None:
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in tensors.items():
        place, name = key.split(".", 1)
        state.setdefault(int(place), {})[name] = value
    groups = optimizer.state_dict()["param_groups"]
    optimizer.load_state_dict({"state": state, "param_groups": groups})
