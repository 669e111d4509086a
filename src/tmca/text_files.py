"""Text files of a bounded size: everything that can be wrong with one is told in one line."""

from __future__ import annotations

from pathlib import Path
from stat import S_ISDIR, S_ISREG

from tmca.errors import DataError

LONGEST = 64 * 2**20
"""Bytes of a file; ours are below a megabyte."""


def read_text(
    path: str | Path,
    expected: str = "a text file",
    remedy: str = "fetch or write it again",
    *,
    longest: int = LONGEST,
    missing: str = "check the path",
    lenient: bool = False,
) -> str:
    """A text in UTF-8, with a byte-order mark or without.

    Args:
        path: the file.
        expected: what it should hold, with its article, for the message.
        remedy: for a file that is too large.
        longest: bytes that it may have.
        missing: what to do where there is none.
        lenient: take it in any encoding; letters that are not UTF-8 are replaced.

    Raises:
        DataError: missing, unreadable, no file, larger, or no text.
    """
    path = Path(path)
    try:
        about = path.stat()
        if not S_ISREG(about.st_mode):
            raise DataError(path, "a folder" if S_ISDIR(about.st_mode) else "no regular file", expected)
        if about.st_size > longest:
            found = f"{about.st_size / 2**20:.0f} MB"
            raise DataError(path, found, f"{expected}, of at most {longest // 2**20} MB", remedy)
        data = path.read_bytes()
    except FileNotFoundError:
        raise DataError(path, "no such file", expected, missing) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        found = f"a file that cannot be read ({reason})"
        raise DataError(path, found, expected, "check its name and permissions") from None
    return data.decode("utf-8-sig", "replace") if lenient else _decoded(data, path, expected)


def _decoded(data: bytes, path: Path, expected: str) -> str:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        wide = data[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in data
        encoding = "UTF-16 or binary data" if wide else "bytes that are not UTF-8 (Latin-1 perhaps)"
        raise DataError(path, encoding, f"{expected}, as UTF-8 text", "save it as UTF-8")
    return text
