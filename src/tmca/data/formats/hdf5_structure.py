"""What in HDF5 files leads the library astray: where it would step for ever, crash, ask for all memory, or read others.

See the "HDF5 File Format Specification", levels 0A (superblock), 1A (B-trees) and 1E (global heap), and "HDF5 Dimension
Scale Specification".
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import h5py

_LOOKED_AT = 2**18
"""Bytes at either end of a file, where writers put what describes its data."""
_HDF5, _FIRST_BLOCK, _LAST_BLOCK = b"\x89HDF\r\n\x1a\n", 512, 2**16
"""Signature of a superblock: at the beginning, or where a power of two of bytes of something else lie before it."""
_TREE, _NODE = re.compile(b"TREE"), 8
"""Signature of a node of a tree, and the bytes of it before the addresses of its siblings."""
_HEAP, _HEAD, _OBJECT = re.compile(rb"GCOL\x01\x00\x00\x00"), 16, struct.Struct("<HHIQ")


def misleading(path: Path) -> str:
    """What in the bytes of a file is astray, in words; nothing where all is well.

    Only the first and last 256 kB are looked at.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        ends = {0: file.read(_LOOKED_AT)}
        if size > _LOOKED_AT:
            behind = max(_LOOKED_AT, size - _LOOKED_AT)
            file.seek(behind)
            ends[behind] = file.read()
    start = _superblock(ends[0])
    if start is not None and _names_driver(ends[0], start):
        return "a damaged superblock"
    if start is not None and _goes_round(ends, start):
        return "a damaged tree of names or chunks"
    stuck = any(_stuck(end, place.start()) for end in ends.values() for place in _HEAP.finditer(end))
    return "a damaged heap of texts and references" if stuck else ""


def _superblock(data: bytes) -> int | None:
    """Where it begins; None without one."""
    start = 0
    while data[start : start + len(_HDF5)] != _HDF5:
        start = 2 * start or _FIRST_BLOCK
        if start > _LAST_BLOCK:
            return None
    return start


def _names_driver(data: bytes, start: int) -> bool:
    """Whether a superblock of version 0 or 1 names a block about a driver, which files in one piece do not have: the
    library would take its size from anywhere."""
    version, size = data[start + 8], data[start + 13]
    place = start + 24 + 4 * version + 3 * size  # behind the addresses of base, free space and end
    return version < 2 and data[place : place + size] != b"\xff" * size


def _goes_round(ends: Mapping[int, bytes], start: int) -> bool:
    """Whether nodes of a tree of version 1 follow each other in a circle: the library goes from each to its right
    sibling as long as there is one."""
    version = ends[0][start + 8]
    size = ends[0][start + (13 if version < 2 else 9)]
    right: dict[int, int] = {}
    for offset, data in ends.items():
        for place in (found.start() for found in _TREE.finditer(data)):
            sibling = data[place + _NODE + size : place + _NODE + 2 * size]
            right[offset + place - start] = int.from_bytes(sibling, "little")
    settled: set[int] = set()
    for node in right:
        row: set[int] = set()
        while node in right and node not in settled:
            if node in row:
                return True
            row.add(node)
            node = right[node]
        settled |= row
    return False


def _stuck(data: bytes, start: int) -> bool:
    """Whether a heap has free space (index 0) without a size, over which the library steps on the spot, or an object
    that ends behind the heap, where it may count backwards; objects are walked as the library does: free space counts
    its head, the others do not."""
    if start + _HEAD > len(data):
        return False
    end = start + int.from_bytes(data[start + 8 : start + _HEAD], "little")
    place = start + _HEAD
    while place + _OBJECT.size <= min(len(data), end):
        index, _, _, size = _OBJECT.unpack_from(data, place)
        step = size if index == 0 else _OBJECT.size + size + -size % 8
        if step == 0 or place + step > end:
            return True
        place += step
    return False


def lies_elsewhere(file: h5py.File, datasets: Mapping[str, h5py.Dataset]) -> str:
    """Name of the first entry of a file that lies in another one: a link out of it, or a dataset whose numbers are
    there; nothing where all of it is here."""
    from h5py import h5d, h5l

    outside = file.id.links.visit(lambda name, link: name if link.type >= h5l.TYPE_EXTERNAL else None, info=True)
    if outside is not None:
        return str(outside.decode("utf-8", "replace"))
    for name, item in datasets.items():
        how = item.id.get_create_plist()
        virtual = range(how.get_virtual_count()) if how.get_layout() == h5d.VIRTUAL else ()
        if how.get_external_count() or any(how.get_virtual_filename(part) != "." for part in virtual):
            return name
    return ""


def damaged_scales(dataset: h5py.Dataset) -> str:
    """Name of the attribute that ties a dataset to its axes and is of another type than the library takes it for, which
    would write over its own memory; nothing where all is well."""
    from h5py import h5a

    for name, fits in ((b"DIMENSION_LIST", _lists_scales), (b"REFERENCE_LIST", _lists_places)):
        if h5a.exists(dataset.id, name):
            attribute = h5a.open(dataset.id, name)
            if len(attribute.shape) != 1 or not fits(attribute, dataset):
                return name.decode()
    return ""


def _lists_scales(attribute: Any, dataset: h5py.Dataset) -> bool:
    """Whether it holds a list of references for each axis."""
    from h5py import h5t

    kind = attribute.get_type()
    lists = isinstance(kind, h5t.TypeVlenID) and isinstance(kind.get_super(), h5t.TypeReferenceID)
    return lists and attribute.shape == (dataset.ndim,)


def _lists_places(attribute: Any, dataset: h5py.Dataset) -> bool:
    """Whether it holds references with the number of an axis."""
    from h5py import h5t

    kind = attribute.get_type()
    pairs = isinstance(kind, h5t.TypeCompoundID) and kind.get_nmembers() == 2
    return pairs and isinstance(kind.get_member_type(0), h5t.TypeReferenceID)
