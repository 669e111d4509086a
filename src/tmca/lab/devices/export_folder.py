"""The folder of an export: written whole or not at all, and nobody else's files are replaced."""

from __future__ import annotations

import re
import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from tmca.errors import OutputError
from tmca.lab.devices.descriptions import PLANES
from tmca.lab.devices.manifest import NAME

TABLE, RESPONSE, OVERVIEW = "zernike.csv", "response.csv", "overview.png"
_PLANES = "|".join(sorted(set(PLANES.values())))
_OWN = re.compile(rf"{NAME}|{OVERVIEW}|({_PLANES})(/(\1_\d+\.png|{TABLE}|{RESPONSE}))?")
"""Names within an export."""
_OF_SYSTEMS = {".DS_Store", "Thumbs.db"}
"""Files that systems put into any folder that is looked at."""


def check_free(folder: Path, overwrite: bool) -> None:
    """Raises OutputError where something is in an export's place: another one, or with ``overwrite`` files that are no
    part of it, such as captures."""
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return
    if not (folder / NAME).is_file():
        raise OutputError(folder, "something that is no export", "a new folder", "choose another")
    if not overwrite:
        raise OutputError(folder, "an export", "a new folder", "choose another, or pass --overwrite")
    inside = sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.name not in _OF_SYSTEMS)
    if strangers := [name for name in inside if not _OWN.fullmatch(name)]:
        found = f"{strangers[0]}, which is no part of the export"
        raise OutputError(
            folder, found, "nothing else where an export is replaced", "move it, or choose another folder"
        )


@contextmanager
def written_whole(folder: Path) -> Iterator[Path]:
    """A folder beside this one, which takes its place when all is written; of a link, the place that it leads to.

    Raises:
        OutputError: no folder can be written there.
    """
    place = folder.resolve() if folder.is_symlink() else folder.absolute()
    temporary = place.with_name(f".{place.name}.part")
    shutil.rmtree(temporary, ignore_errors=True)
    try:
        temporary.mkdir(parents=True)
        yield temporary
        _put(temporary, place)
    except OSError as error:
        found = f"no folder can be written ({error.strerror or error})"
        raise OutputError(folder, found, "a folder", "choose another") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _put(temporary: Path, place: Path) -> None:
    """The new in the place of the old, which lies whole in a hidden folder beside it until the new is there."""
    if not place.exists():
        temporary.rename(place)
        return
    aside = place.with_name(f".{place.name}.{secrets.token_hex(6)}.old")
    moves = [(place, aside), (temporary, place)]
    if place.samefile(Path.cwd()):  # whoever stands in it goes on standing in it
        aside.mkdir()
        new = sorted(temporary.iterdir(), key=lambda file: file.name == NAME)
        moves = [(old, aside / old.name) for old in place.iterdir()] + [(part, place / part.name) for part in new]
    try:
        _moved(moves)
    except BaseException:
        with suppress(OSError):  # whatever is still in it stays
            aside.rmdir()
        raise
    shutil.rmtree(aside, ignore_errors=True)


def _moved(moves: Sequence[tuple[Path, Path]]) -> None:
    """Rename all of them, or, whatever stops it, none."""
    try:
        for there, then in moves:
            there.rename(then)
    except BaseException:  # KeyboardInterrupt too
        for there, then in reversed(moves):
            if then.exists() and not there.exists():
                then.rename(there)
        raise
