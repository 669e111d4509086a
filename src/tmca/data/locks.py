"""Locks that the system lets go of, whatever ends the process that holds them."""

from __future__ import annotations

import errno
import fcntl
import os
from pathlib import Path
from typing import TextIO

LOCK = ".lock"
"""Name of the file in a folder; one that a killed process left behind holds nobody back."""
_NONE_HERE = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS)


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
        raise NoLocks(*error.args) if error.errno in _NONE_HERE else error from None
    if os.fstat(handle.fileno()).st_nlink == 0:  # taken away by the process that ended in this moment
        handle.close()
        return None
    return handle
