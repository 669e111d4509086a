"""Folders of outputs: made, checked before long work, and held by one process at a time.

The system lets go of locks, whatever ends the process that holds them.
"""

from __future__ import annotations

import errno
import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

from tmca.errors import OutputError

LOCK = ".lock"
"""Name of the file in a folder; one that a killed process left behind holds nobody back."""
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS)
_REASONS = {
    errno.ENOSPC: ("a full disk", "room for the file", "free some space or write elsewhere"),
    errno.EDQUOT: ("a full disk quota", "room for the file", "free some space or write elsewhere"),
    errno.EFBIG: ("a file above the size limit", "room for the file", "raise the limit or write elsewhere"),
    errno.EACCES: ("no permission to write", "a writable folder", "write elsewhere"),
    errno.EPERM: ("no permission to write", "a writable folder", "write elsewhere"),
    **dict.fromkeys((errno.EEXIST, errno.ENOTDIR), ("a file in the way", "a folder", "choose another name")),
    errno.EROFS: ("a read-only disk", "a writable folder", "write elsewhere"),
}


def cache_folder() -> Path:
    """Where what can be computed again is kept: the folder ``TMCA_CACHE``, or ``tmca`` in the user's cache folder."""
    usual = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "tmca"
    return Path(os.environ.get("TMCA_CACHE", usual))


def make_folder(path: str | Path) -> Path:
    """The folder, made with its parents where it does not exist.

    Raises:
        OutputError: a file is in its place, or it cannot be made.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise output_error(folder, error) from error
    return folder


def check_folder(path: str | Path) -> None:
    """Say before long work that a folder cannot be made or written to; nothing is left behind.

    Raises:
        OutputError: a file is in its place, or its nearest existing parent cannot be written to.
    """
    folder = Path(path).absolute()
    try:
        there = next(place for place in (folder, *folder.parents) if place.exists())
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise output_error(path, error) from error


@contextmanager
def held_folder(path: str | Path, work: str = "a run") -> Iterator[Path]:
    """The folder, made with its parents where it does not exist, out of which other processes are kept meanwhile.

    What was made of it is gone again if nothing came into it.

    Raises:
        OutputError: another process works in it, or it cannot be made or written to.
    """
    folder = Path(path)
    new_folders = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        with sole_process(make_folder(folder) / LOCK, folder, work):
            yield folder
    finally:
        for place in new_folders:
            with suppress(OSError):  # something is in it
                place.rmdir()


@contextmanager
def sole_process(file: Path, path: Path, work: str) -> Iterator[None]:
    """Keep other processes away meanwhile; on a disk without locks nobody is kept away.

    Args:
        file: of the lock, in a folder that exists; it is gone afterwards.
        path: what is worked on, for messages.
        work: what goes on there.

    Raises:
        OutputError: another process works on it, or the lock cannot be made.
    """
    try:
        handle = lock(file)
    except FileNotFoundError:  # the process that made the folder ended in this moment, and took it away
        handle = None
    except NoLocks:
        yield
        return
    except OSError as error:
        raise output_error(path, error) from error
    if handle is None:
        raise OutputError(path, f"{work} that is going on", "none", "wait for it or choose another folder")
    with handle:
        try:
            yield
        finally:
            with suppress(OSError):
                file.unlink(missing_ok=True)


def output_error(path: str | Path, error: OSError) -> OutputError:
    """What a failure to write means, and what to do about it."""
    unknown = (f"a failure to write ({error})", "a writable place", "free some space or write elsewhere")
    # numpy's tofile tells a full disk only in words, without the system's number
    code = errno.ENOSPC if error.errno is None and " requested and " in str(error) else error.errno
    found, expected, remedy = _REASONS.get(code or 0, unknown)
    return OutputError(path, found, expected, remedy)


class NoLocks(OSError):
    """A disk that knows no locks."""


def lock(file: Path) -> TextIO | None:
    """The open lock file, held until it is closed; None where another process holds it or takes it away.

    Raises:
        NoLocks: the disk has none.
        OSError: the file cannot be made.
    """
    handle = file.open("w")
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        handle.close()
        if isinstance(error, BlockingIOError):
            return None
        raise NoLocks(*error.args) if error.errno in _NO_LOCKS else error from None
    if os.fstat(handle.fileno()).st_nlink == 0:  # taken away by the process that ended in this moment
        handle.close()
        return None
    return handle
