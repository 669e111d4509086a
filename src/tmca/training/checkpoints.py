"""Checkpoints: a folder per checkpoint with ``state.safetensors`` and ``state.json``, written whole or not at all."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any
from warnings import warn

from pydantic import Field
from safetensors.torch import load_file, save_file
from torch import Tensor, nn
from torch.optim import Optimizer

from tmca.attributes import OpenAttributes, read_json
from tmca.data import atomic_path, make_folder, write_json
from tmca.data.formats.stored import whole_file
from tmca.errors import DataError
from tmca.stored_numbers import check_finite

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
    _delete_old(folder)
    return folder / f"{step:07d}"


def _delete_old(folder: Path) -> None:
    for old in _checkpoints(folder)[:-_NEWEST]:
        shutil.rmtree(old, ignore_errors=True)


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
    _delete_old(folder)  # where a run was killed before it did
    for path in reversed(_checkpoints(folder)):
        if damaged is not None:
            warn(f"{damaged}; going on from the one before", DamagedFile, stacklevel=2)
        try:
            state, tensors = read_json(path / _STATE, State), _tensors(path / _TENSORS)
        except DataError as error:
            damaged = error
            continue
        _restore(path, tensors, system, optimizers)
        return state.model_dump()
    if damaged is not None:
        raise damaged
    return None


class BestStep(OpenAttributes):
    """The best validation; without one, and where it is not finite, figures are None."""

    score: float | None
    step: int = Field(ge=0)


class State(OpenAttributes):
    """JSON values beside the tensors."""

    step: int = Field(ge=0)
    best: BestStep
    losses: list[float | None]
    cpu_seconds: float = Field(default=0.0, ge=0)


def _tensors(file: Path) -> dict[str, Tensor]:
    """Tensors, none of which holds NaN.

    Raises:
        DataError: a damaged file.
    """
    with whole_file(file, "checkpoint", "delete it"):
        tensors: dict[str, Tensor] = load_file(file)
    for name, values in tensors.items():
        if values.is_floating_point():
            check_finite(values.float().numpy(), file, name[:60], "delete it")
    return tensors


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
        for name, optimizer in optimizers.items():
            _restore_optimizer(optimizer, _under(f"optimizer.{name}.", tensors))
    except (RuntimeError, ValueError) as error:
        found = f"the state of another camera or decoder ({str(error)[:300]})"
        raise DataError(path, found, "this run's", "delete the checkpoint") from error


def _restore_optimizer(optimizer: Optimizer, tensors: dict[str, Tensor]) -> None:
    """Raises ValueError for the state of other parameters."""
    parameters = [one for group in optimizer.param_groups for one in group["params"]]
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in tensors.items():
        place, _, part = key.partition(".")
        if not (
            place.isdecimal() and int(place) < len(parameters) and value.shape in ((), parameters[int(place)].shape)
        ):
            raise ValueError(f"{key} of the optimizer")
        state.setdefault(int(place), {})[part] = value
    if len({frozenset(values) for values in state.values()}) > 1:
        raise ValueError("parts of the optimizer's state are missing")
    optimizer.load_state_dict({"state": state, "param_groups": optimizer.state_dict()["param_groups"]})


def _under(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
