"""The folder of a run: whose run it is, and that no other process uses it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tmca.attributes import NamedJson, read_json
from tmca.data import held_folder, write_json
from tmca.data.atomic import sweep_all
from tmca.data.folders import LOCK
from tmca.errors import OutputError, TmcaError
from tmca.training.checkpoints import latest_checkpoint
from tmca.training.scenes import SceneLists
from tmca.training.settings import RunSettings

WEIGHTS = "weights.safetensors"
_ABOUT = "run.json"
_MADE = ("log.csv", "prior.nc", "cubes", "starts", "checkpoints", WEIGHTS)


def open_run(folder: Path, settings: RunSettings, lists: SceneLists) -> None:
    """Say whose run a folder is, or make sure that it is this run's; call it while the folder is ``locked``.

    A run that never came to a checkpoint has nothing to lose: another one takes its place.

    Raises:
        OutputError: it holds another run.
        DataError: its description cannot be read.
    """
    described = {"settings": settings.model_dump(mode="json"), "scenes": vars(lists)}
    sweep_all(folder)
    about = folder / _ABOUT
    if about.exists() and latest_checkpoint(folder / "checkpoints") is not None:
        _check_same(about, json.loads(json.dumps(described)))
        return
    _delete(folder / name for name in _MADE)
    write_json(described, about, overwrite=True)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other processes out of a run's folder; the system lets go of it whatever ends this one.

    Where an error ends a run that has neither checkpoint nor weights, nothing of it stays.

    Raises:
        OutputError: a run is going on in it, or it holds files of something else.
    """
    if folder.exists() and not (folder / _ABOUT).exists() and not all(map(_left_by_run, folder.iterdir())):
        raise OutputError(folder, "a folder with other files", "an empty or new one", "choose another --out")
    with held_folder(folder), _emptied(folder):
        yield


@contextmanager
def _emptied(folder: Path) -> Iterator[None]:
    """Delete what a run has made where an error ends it before its first checkpoint."""
    try:
        yield
    except TmcaError:
        if latest_checkpoint(folder / "checkpoints") is None and not (folder / WEIGHTS).exists():
            _delete(folder / name for name in (*_MADE, _ABOUT))
        raise


def _left_by_run(path: Path) -> bool:
    """Whether a file is what a run that was killed in its first moments leaves."""
    return path.name == LOCK or (path.name.startswith(f".{_ABOUT}.") and path.suffix == ".tmp")


def _delete(paths: Iterable[Path]) -> None:
    for path in paths:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def _check_same(about: Path, described: dict[str, Any]) -> None:
    before = _flat(read_json(about, NamedJson))
    now = _flat(described)
    for name in sorted(before.keys() | now.keys()):
        if before.get(name) != now.get(name):
            values = f"{before.get(name)!s:.80}, now {now.get(name)!s:.80}"
            found = f"another run ({name.removeprefix('settings.')[:80]} = {values})"
            remedy = "choose another --out, or the old settings"
            raise OutputError(about, found, "the same settings to resume it", remedy)


def _flat(value: Any, name: str = "") -> dict[str, Any]:
    """Values of nested dictionaries by dotted names."""
    if not isinstance(value, dict):
        return {name: value}
    return {n: v for key, part in value.items() for n, v in _flat(part, f"{name}.{key}".strip(".")).items()}
