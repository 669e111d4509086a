"""Sizes before memory: what may be loaded from a file, known before anything is allocated."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from math import inf, prod
from pathlib import Path

from tmca.errors import DataError, SettingError

VARIABLE = "TMCA_MAX_READ"
MOST = 8 * 2**30
"""Bytes that one array, or one file that is read whole, may take in memory, unless `VARIABLE` says otherwise."""
_ALWAYS = 256 * 2**20
_DENSEST = 1000
"""Compressed files do not hold more bytes of numbers than this per byte; what is below `_ALWAYS` passes anyway."""
_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12, "ki": 2**10, "mi": 2**20, "gi": 2**30, "ti": 2**40}


def stated_limit() -> int | None:
    """Bytes of the environment variable ``TMCA_MAX_READ``: a number, or one with a unit such as ``8GB``; None without.

    Raises:
        SettingError: it says something else.
    """
    text = os.environ.get(VARIABLE, "").strip()
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([kmgt]?i?)b?", text, re.IGNORECASE)
    if match and match[2].lower() in _UNITS:
        return int(float(match[1]) * _UNITS[match[2].lower()])
    if text:
        raise SettingError(VARIABLE, repr(text), "bytes, such as 8000000000 or 8GB")
    return None


def check_bytes(path: Path, what: str, count: int, most: float = MOST) -> None:
    """Raise DataError if bytes that are to be loaded are more than may be.

    The limit is `stated_limit`; without, ``most``, and no more than 1000 times what the file or folder takes on disk
    (256 MB are always allowed).

    Args:
        path: the file or folder.
        what: is to be loaded, such as ``cube (31, 512, 512) of float32``.
        count: its bytes in memory.
        most: without a stated limit.
    """
    if count <= _ALWAYS and VARIABLE not in os.environ:
        return
    limit: float | None = stated_limit()
    if limit is None:
        limit = min(most, max(_ALWAYS, _DENSEST * size_on_disk(path)))
    if count > limit:
        found = f"{what}, {_words(count)} in {_words(size_on_disk(path))} on disk"
        remedy = f"fetch it again or read less of it; if that is right, set {VARIABLE} to more bytes"
        raise DataError(path, found, f"at most {_words(limit)}", remedy)


def check_array(path: Path, name: str, shape: Sequence[int], itemsize: int, most: float = MOST) -> None:
    """As `check_bytes`, of an array of a shape and bytes an element."""
    sizes = tuple(int(size) for size in shape)
    check_bytes(path, f"{name} of shape {sizes}", prod(sizes) * itemsize, most)


def check_declared(path: Path, name: str, shape: Sequence[int], itemsize: int) -> None:
    """Raise DataError if an array declares far more than its file can hold, also where only parts of it are loaded.

    Not where ``TMCA_MAX_READ`` is set.
    """
    if VARIABLE not in os.environ:
        check_array(path, name, shape, itemsize, inf)


def size_on_disk(path: Path) -> int:
    """Bytes of a file, or of all files in a folder."""
    files = path.rglob("*") if path.is_dir() else (path,)
    return sum(file.stat().st_size for file in files if file.is_file())


def _words(count: float) -> str:
    """Bytes as people say them: ``8.6 GB``."""
    size, units = float(count), ["bytes", "kB", "MB", "GB", "TB", "PB"]
    while size >= 1000 and len(units) > 1:
        size /= 1000
        del units[0]
    return f"{size:.3g} {units[0]}"
