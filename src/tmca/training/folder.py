"""The folder of a run: whose run it is, and what it was told."""

from __future__ import annotations

import fcntl
import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tmca.data import make_folder, write_json
from tmca.errors import DataError, OutputError
from tmca.training.checkpoints import latest_checkpoint
from tmca.training.scenes import SceneLists
from tmca.training.settings import TrainSettings

_ABOUT, _LOCK = "run.json", ".lock"
_MADE = ("log.csv", "prior.nc", "cubes", "starts", "checkpoints", "weights.safetensors")


def open_run(folder: Path, settings: TrainSettings, lists: SceneLists) -> None:
    """Say whose run a folder is, or make sure that it is this run's; call it while the folder is ``held``.

    A run that never came to a checkpoint has nothing to lose: another one takes its place.

    Raises:
        OutputError: it holds another run.
        DataError: its description cannot be read.
    """
    described = {"settings": settings.model_dump(mode="json"), "scenes": vars(lists)}
    about = folder / _ABOUT
    _sweep(folder)
    if about.exists() and latest_checkpoint(folder / "checkpoints") is not None:
        _same(about, json.loads(json.dumps(described)))
        return
    for made in _MADE:
        _delete(folder / made)
    write_json(described, about, overwrite=True)


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Keep other processes out of a run's folder; the system lets go of it whatever ends this one.

    Raises:
        OutputError: a run is going on in it, or it holds files of something else.
    """
    if folder.exists() and not (folder / _ABOUT).exists() and any(not _own(path) for path in folder.iterdir()):
        raise OutputError(folder, "a folder with other files", "an empty or new one", "choose another --out")
    make_folder(folder)
    with (folder / _LOCK).open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise OutputError(folder, "a run that is going on", "none", "wait for it or choose another --out") from None
        yield


def _own(path: Path) -> bool:
    """Whether a file is what a run that was killed in its first moments leaves."""
    return path.name == _LOCK or (path.name.startswith(f".{Path(_ABOUT).stem}.") and ".tmp" in path.name)


def _sweep(folder: Path) -> None:
    """Delete what killed processes left half-written."""
    for left in [*folder.glob(".*.tmp*"), *folder.glob("*/.*.tmp*"), *folder.glob("*/.*.old")]:
        _delete(left)


def _delete(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _same(about: Path, described: dict[str, object]) -> None:
    try:
        before = json.loads(about.read_text(encoding="utf-8"))
    except (OSError, json.JSONDecodeError) as error:
        raise DataError(about, f"no readable description ({error})", "that of a run", "delete the folder") from error
    changed = _differences(before, described)
    if changed:
        name, old, new = changed[0]
        raise OutputError(
            about.parent, f"another run ({name} = {old}, now {new})", "the same settings to resume it",
            "choose another --out, or the old settings",
        )  # fmt: skip


def _differences(old: object, new: object, name: str = "") -> list[tuple[str, object, object]]:
    if isinstance(old, dict) and isinstance(new, dict):
        found = []
        for key in sorted(old.keys() | new.keys()):
            found += _differences(old.get(key), new.get(key), f"{name}.{key}".strip("."))
        return found
    return [] if old == new else [(name.removeprefix("settings."), old, new)]
