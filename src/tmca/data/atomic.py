"""Written whole or not at all: in a hidden folder beside the place, then renamed; what killed processes left is swept.

The folder is ``.NAME.<12 digits>.tmp``. Its writer holds a lock in it, so whoever writes into the same place next
knows whether it is in use, and deletes it if not.
"""

from __future__ import annotations

import errno
import os
import re
import secrets
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

from tmca.data.folders import LOCK, NoLocks, lock, output_error
from tmca.errors import OutputError

_PATIENCE, _QUIET = 1.0, 0.3
"""Seconds: for which a deletion is tried, and of silence after which the threads of a failed writer have ended."""
_LEFT, _OLD = re.compile(r"\..+\.[0-9a-f]{12}\.tmp"), ".old"
_NOREPLACE, _EXCHANGE, _HERE = 1, 2, -100
"""Of Linux: flags of ``renameat2``, and ``AT_FDCWD``."""


@contextmanager
def atomic_path(path: str | Path, *, overwrite: bool = False) -> Iterator[Path]:
    """A path of the same name in a temporary folder beside ``path``, renamed to it when the block ends well.

    It may become a file or a folder, and is removed when the block does not end well. What was at ``path`` stays whole
    until the new one is complete; without ``overwrite`` what appeared there meanwhile stays as well.

    Raises:
        OutputError: ``path`` exists and ``overwrite`` is False, its folder is missing or cannot be written,
            or the disk is full.
    """
    path = Path(path)
    check_target(path, overwrite)
    try:
        with _workshop(path) as folder:
            temporary = folder / path.name
            with _named(folder, path.parent):
                yield temporary
            if not temporary.exists():
                raise OutputError(path, "nothing written", "a complete file")
            check_target(path, overwrite)
            _flush_all(temporary)
            _place(temporary, path, overwrite)
    except OSError as error:
        raise output_error(path, error) from error


@contextmanager
def _named(folder: Path, place: Path) -> Iterator[None]:
    """What cannot be written in a temporary folder is told by the name that it was to have."""
    try:
        yield
    except OutputError as error:
        where = Path(error.where)
        if not where.is_relative_to(folder):
            raise
        raise OutputError(place / where.relative_to(folder), error.found, error.expected, error.remedy) from error


_OVERWRITE = "--overwrite (in Python overwrite=True)"


def check_target(path: str | Path, overwrite: bool = False) -> None:
    """Say before long work that its output could not be written.

    Raises:
        OutputError: no such folder, a file in its place, or the file exists and ``overwrite`` is False.
    """
    path = Path(path)
    if file := next((place for place in path.parents if place.is_file()), None):
        raise OutputError(path, f"{file}, a file", "a folder", "choose another name")
    if not path.parent.is_dir():
        raise OutputError(path, "no such folder " + str(path.parent), "an existing folder", "create it first")
    if path.exists() and not overwrite:
        raise OutputError(path, "an existing output", "a new name", f"choose another, or pass {_OVERWRITE}")


@contextmanager
def _workshop(path: Path) -> Iterator[Path]:
    """A folder of this process beside ``path``, gone when the block ends; those of dead processes are swept first."""
    sweep(path.parent)
    handle: TextIO | None = None
    while handle is None:
        folder = path.with_name(f".{path.name}.{secrets.token_hex(6)}.tmp")
        folder.mkdir()
        try:
            handle = lock(folder / LOCK)
        except FileNotFoundError:  # swept in this moment
            continue
        except NoLocks:
            break
        except OSError:
            folder.rmdir()
            raise
    failed = True
    try:
        yield folder
        failed = False
    finally:
        _remove(folder, _QUIET if failed and (folder / path.name).is_dir() else 0.0)
        if handle is not None:
            handle.close()


def sweep(folder: Path) -> None:
    """Delete what killed processes left half-written; an old folder that one had set aside comes back first."""
    for left in [folder / name for name in os.listdir(folder) if _LEFT.fullmatch(name)]:
        with suppress(OSError):
            handle = lock(left / LOCK)
            if handle is None:
                continue
            with handle:
                path = folder / left.name[1 : -len(".0123456789ab.tmp")]
                if (left / _OLD).exists() and not path.exists():
                    os.replace(left / _OLD, path)
                _remove(left)


def sweep_all(folder: Path) -> None:
    """Sweep a folder and the folders in it."""
    sweep(folder)
    for place in folder.iterdir():
        if place.is_dir() and not place.name.startswith("."):
            sweep(place)


def _place(temporary: Path, path: Path, overwrite: bool) -> None:
    """Rename to where it belongs; an old folder changes places with the new one."""
    if path.is_dir() and not temporary.is_dir():
        raise OutputError(path, "an existing folder", "a file or a new name", "choose another name")
    if not overwrite:
        if not _renamed(temporary, path, _NOREPLACE):
            os.replace(temporary, path)
    elif not path.is_dir():
        os.replace(temporary, path)
    elif not _renamed(temporary, path, _EXCHANGE):
        old = temporary.with_name(_OLD)
        os.replace(path, old)
        try:
            os.replace(temporary, path)
        except OSError:
            os.replace(old, path)
            raise
    _flush_folder(path.parent)


def _renamed(source: Path, target: Path, flag: int) -> bool:
    """Rename as ``renameat2`` of Linux does; False where system or disk do not have it.

    Raises:
        OutputError: the target exists and must not be replaced.
        OSError: it cannot be done.
    """
    import ctypes

    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if rename is None:
        return False
    if rename(_HERE, os.fsencode(source), _HERE, os.fsencode(target), flag) == 0:
        return True
    code = ctypes.get_errno()
    if code in (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP):
        return False
    if code == errno.EEXIST:
        check_target(target)
    raise OSError(code, os.strerror(code), str(target))


def _flush_all(temporary: Path) -> None:
    """Bring the bytes to the disk before the rename: a power cut leaves the old file or the new one."""
    for file in [temporary] if temporary.is_file() else [f for f in temporary.rglob("*") if f.is_file()]:
        with file.open("rb+") as handle:
            os.fsync(handle.fileno())


def _flush_folder(folder: Path) -> None:
    """Bring a rename to the disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _remove(temporary: Path, quiet: float = 0.0) -> None:
    """Delete a file or folder until it stays away for ``quiet`` seconds: a writer's own threads (Zarr's) may go on
    putting files there after it failed."""
    begun = seen = time.monotonic()
    while time.monotonic() < begun + _PATIENCE + 10 * quiet:
        if temporary.is_dir():
            shutil.rmtree(temporary, ignore_errors=True)
            seen = time.monotonic()
        else:
            temporary.unlink(missing_ok=True)
        if not temporary.exists() and time.monotonic() >= seen + quiet:
            return
        time.sleep(0.05)
