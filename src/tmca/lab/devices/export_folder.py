"""The folder of an export: written whole or not at all, and nobody else's files are replaced."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tmca.errors import OutputError
from tmca.lab.devices.descriptions import PLANES
from tmca.lab.devices.manifest import NAME

TABLE, RESPONSE, OVERVIEW = "zernike.csv", "response.csv", "overview.png"
_PLANES = "|".join(sorted(set(PLANES.values())))
_OWN = re.compile(rf"{NAME}|{OVERVIEW}|({_PLANES})(/(\1_\d+\.png|{TABLE}|{RESPONSE}))?")
"""Names within an export."""


def check_free(folder: Path, overwrite: bool) -> None:
    """Raises OutputError where something is in an export's place: another one, or with ``overwrite`` files that are no
    part of it, such as captures."""
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return
    if not (folder / NAME).is_file():
        raise OutputError(folder, "something that is no export", "a new folder", "choose another")
    if not overwrite:
        raise OutputError(folder, "an export", "a new folder", "choose another, or pass --overwrite")
    inside = sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*"))
    if strangers := [name for name in inside if not _OWN.fullmatch(name)]:
        found = f"{strangers[0]}, which is no part of the export"
        raise OutputError(
            folder, found, "nothing else where an export is replaced", "move it, or choose another folder"
        )


@contextmanager
def written_whole(folder: Path) -> Iterator[Path]:
    """A folder beside this one, which takes its place when all is written.

    Raises:
        OutputError: no folder can be written there.
    """
    place = folder.absolute()
    temporary = place.with_name(f".{place.name}.part")
    shutil.rmtree(temporary, ignore_errors=True)
    try:
        temporary.mkdir(parents=True)
        yield temporary
        _put(temporary, place)
    except OSError as error:
        found = f"no folder can be written ({error.strerror})"
        raise OutputError(folder, found, "a folder", "choose another") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _put(temporary: Path, place: Path) -> None:
    if not (place.exists() and place.samefile(Path.cwd())):
        if place.exists():
            shutil.rmtree(place)
        temporary.rename(place)
        return
    for old in place.iterdir():  # whoever stands in it goes on standing in it
        shutil.rmtree(old) if old.is_dir() else old.unlink()
    for part in sorted(temporary.iterdir(), key=lambda file: file.name == NAME):
        part.rename(place / part.name)
