"""The folder of a run: whose run it is, and what it was told."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from tmca.data import make_folder, write_json, write_text
from tmca.errors import DataError, OutputError, TmcaError
from tmca.training.checkpoints import latest_checkpoint
from tmca.training.scenes import SceneLists
from tmca.training.settings import TrainSettings

_ABOUT, _LOCK = "run.json", ".lock"
_WEIGHTS = "weights.safetensors"
_MADE = ("log.csv", "prior.nc", "cubes", "starts", "checkpoints", _WEIGHTS)


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

    Where an error ends a run that has kept neither checkpoint nor weights, the folder is left as it was found.

    Raises:
        OutputError: a run is going on in it, or it holds files of something else.
    """
    if folder.exists() and not (folder / _ABOUT).exists() and any(not _own(path) for path in folder.iterdir()):
        raise OutputError(folder, "a folder with other files", "an empty or new one", "choose another --out")
    before = _Before.of(folder)
    make_folder(folder)
    with _locked(folder):
        try:
            yield
        except TmcaError:
            if latest_checkpoint(folder / "checkpoints") is None and not (folder / _WEIGHTS).exists():
                before.put_back()
            raise


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    going_on = OutputError(folder, "a run that is going on", "none", "wait for it or choose another --out")
    with (folder / _LOCK).open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise going_on from None
        if os.fstat(file.fileno()).st_nlink == 0:  # taken away by a run that ended in this moment
            raise going_on
        yield


@dataclass(frozen=True)
class _Before:
    """What there was before a run.

    Args:
        folder: of the run.
        missing: the folder and those above it that were not there, the deepest first.
        names: of what was in it.
        about: the description in it.
    """

    folder: Path
    missing: tuple[Path, ...]
    names: frozenset[str]
    about: str | None

    @classmethod
    def of(cls, folder: Path) -> _Before:
        """What there is now."""
        missing = tuple(place for place in (folder, *folder.parents) if not place.exists())
        names = frozenset() if missing else frozenset(path.name for path in folder.iterdir())
        about = (folder / _ABOUT).read_text(encoding="utf-8", errors="replace") if _ABOUT in names else None
        return cls(folder, missing, names, about)

    def put_back(self) -> None:
        """Take away what is new; what something else holds fast stays."""
        with suppress(OSError, OutputError):
            for path in self.folder.iterdir():
                if path.name not in self.names:
                    _delete(path)
            if self.about is not None:
                write_text(self.about, self.folder / _ABOUT, overwrite=True)
            for place in self.missing:
                place.rmdir()


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
