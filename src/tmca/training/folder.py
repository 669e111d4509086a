"""The folder of a run: whose run it is, and what it was told."""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tmca.data import make_folder, write_json
from tmca.errors import DataError, OutputError
from tmca.training.scenes import SceneLists
from tmca.training.settings import TrainSettings

_ABOUT, _LOCK = "run.json", ".lock"


def open_run(folder: Path, settings: TrainSettings, lists: SceneLists) -> None:
    """Make the folder of a new run, or make sure that it is this run's.

    Raises:
        OutputError: it holds another run, or files of something else.
        DataError: its description cannot be read.
    """
    described = {"settings": settings.model_dump(mode="json"), "scenes": vars(lists)}
    about = folder / _ABOUT
    if about.exists():
        _same(about, json.loads(json.dumps(described)))
        return
    if folder.exists() and any(folder.iterdir()):
        raise OutputError(folder, "a folder with other files", "an empty or new one", "choose another --out")
    make_folder(folder)
    write_json(described, about)


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Keep other processes out of a run's folder; the system lets go of it whatever ends this one.

    Raises:
        OutputError: a run is going on in it.
    """
    with (folder / _LOCK).open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise OutputError(folder, "a run that is going on", "none", "wait for it or choose another --out") from None
        yield


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
