"""Where HDF5 files keep texts and references: damage there that the HDF5 library would follow for ever."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

_LOOKED_AT = 2**18
"""Bytes at either end of a file, where writers put what describes its data."""
_SIGNATURE, _HEAD, _OBJECT = b"GCOL\x01\x00\x00\x00", 16, struct.Struct("<HHIQ")


def endless_heap(path: Path) -> bool:
    """Whether a global heap has free space of no size, over which the library steps on the spot.

    See "Disk Format: Level 1E - Global Heap" of the HDF5 file format specification. Only the first and last
    256 kB are looked at.
    """
    with path.open("rb") as file:
        ends = [file.read(_LOOKED_AT)]
        if (size := path.stat().st_size) > _LOOKED_AT:
            file.seek(max(_LOOKED_AT, size - _LOOKED_AT))
            ends.append(file.read())
    return any(_stuck(end, place) for end in ends for place in _places(end))


def _places(data: bytes) -> Iterator[int]:
    place = data.find(_SIGNATURE)
    while place >= 0:
        yield place
        place = data.find(_SIGNATURE, place + 1)


def _stuck(data: bytes, start: int) -> bool:
    """Walk the objects of a heap as the library does: its free space (index 0) counts its head, the others do not."""
    if start + _HEAD > len(data):
        return False
    end = min(len(data), start + int.from_bytes(data[start + 8 : start + _HEAD], "little"))
    place = start + _HEAD
    while place + _OBJECT.size <= end:
        index, _, _, size = _OBJECT.unpack_from(data, place)
        if index == 0 and size == 0:
            return True
        place += size if index == 0 else _OBJECT.size + size + -size % 8
    return False
