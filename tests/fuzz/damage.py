"""Damage to a file, drawn from a seed: bytes, tokens of texts, entries and attributes of HDF5 and safetensors."""

from __future__ import annotations

import json
import re
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Rng = np.random.Generator
_TEXTS = {".yaml", ".yml", ".hdr", ".csv", ".txt", ".cfg", ".md", ".zgroup"}
_JSON = {".json", ".zattrs", ".zarray", ".zmetadata"}
_HDF5 = {".nc", ".h5", ".mat", ".hdf5"}
_TOKENS = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?|\"[^\"]*\"|[A-Za-z_]+|[\[\]{}:,=]")
_WORDS = [
    b"-1", b"0", b"1e308", b"-1e308", b"nan", b"NaN", b"inf", b"Infinity", b"99999999", b"999999999999999999999",
    b"0.5", b'""', b"null", b"true", b"[]", b"{}", b'"x"', b"[[[1]]]", b"1e-320", b"\xff\xfe", b"\x00",
    b"../../../etc/passwd",
]  # fmt: skip
_VALUES: list[Any] = [
    0, -1, 10**12, 1e308, float("nan"), float("inf"), "", "x", "null", "[]", "{}", "NaN", b"\xff\xfe", "[1e999]",
    "../../../etc/passwd", True, np.zeros(0), np.full(3, np.nan), np.arange(5), 2**31 - 1, '{"a": [[[1]]]}',
]  # fmt: skip


def damage(path: Path, rng: Rng, whole: bool = True) -> str:
    """Damage a file in place, or one file of a folder, and say how in a few words.

    Args:
        path: of the file or folder.
        rng: draws the damage.
        whole: whether no bytes were damaged before: libraries can still open it.
    """
    file = _one(path, rng)
    if file is None:
        return "nothing left"
    if path.is_dir() and rng.random() < 0.05:
        file.unlink()
        return f"{file.name} removed"
    ways = _ways(file) if whole else [_bytes]
    way = ways[int(rng.integers(len(ways)))]
    try:
        return f"{file.name}: {way(file, rng)}"
    except (
        OSError,
        ValueError,
        TypeError,
        KeyError,
        IndexError,
        RuntimeError,
    ):  # what cannot hold that damage gets another
        return f"{file.name}: {_bytes(file, rng)}"


def _one(path: Path, rng: Rng) -> Path | None:
    files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
    return files[int(rng.integers(len(files)))] if files else None


def _ways(file: Path) -> list[Callable[[Path, Rng], str]]:
    suffix = file.suffix or file.name
    if suffix in _JSON:
        return [_entry, _entry, _token, _bytes]
    if suffix in _TEXTS:
        return [_token, _token, _token, _bytes]
    if suffix in _HDF5 and file.read_bytes()[:4] == b"\x89HDF":
        return [_attribute, _attribute, _dataset, _bytes, _bytes]
    if suffix == ".safetensors":
        return [_header, _header, _bytes]
    return [_bytes]


def _bytes(file: Path, rng: Rng) -> str:
    """Flips of bits, cuts, deletions, repeats and runs of odd bytes; more often near the beginning and the end."""
    data = bytearray(file.read_bytes())
    where = _place(len(data), rng)
    how = int(rng.integers(6))
    length = int(2 ** rng.integers(0, 9))
    if how == 0 or not data:
        for place in [where] + [_place(len(data), rng) for _ in range(int(rng.integers(3)))]:
            data[place : place + 1] = bytes([data[place] ^ (1 << int(rng.integers(8)))]) if data else b"\x00"
    elif how == 1:
        del data[where:]
    elif how == 2:
        del data[where : where + length]
    elif how == 3:
        data[where:where] = data[where : where + length]
    elif how == 4:
        data[where : where + length] = bytes([int(rng.choice([0, 255, 127, 128, 32]))]) * min(length, len(data) - where)
    else:
        data[where : where + min(length, 8)] = rng.bytes(min(length, 8, len(data) - where))
    file.write_bytes(bytes(data))
    return f"bytes {['flipped', 'cut', 'deleted', 'repeated', 'filled', 'replaced'][how]} at {where}"


def _place(size: int, rng: Rng) -> int:
    if not size:
        return 0
    near = min(size, 1024)
    offset = int(rng.integers(near))
    return int([rng.integers(size), offset, size - 1 - offset][int(rng.integers(3))])


def _token(file: Path, rng: Rng) -> str:
    """Another word in the place of a word, a number, a text or a bracket, or nothing at all."""
    data = file.read_bytes()
    tokens = list(_TOKENS.finditer(data))
    if not tokens:
        return _bytes(file, rng)
    token = tokens[int(rng.integers(len(tokens)))]
    word = _WORDS[int(rng.integers(len(_WORDS)))] if rng.random() < 0.9 else b""
    if rng.random() < 0.5 and token.group().startswith(b'"'):
        word = b'"' + word.strip(b'"') + b'"'
    file.write_bytes(data[: token.start()] + word + data[token.end() :])
    return f"{token.group()!r} → {word!r} at {token.start()}"


def _entry(file: Path, rng: Rng) -> str:
    """Another value in the place of an entry of JSON, or none, the rest as it was."""
    said = json.loads(file.read_bytes())
    holders: list[Any] = [said]
    for holder in holders:  # grows as it goes
        parts = holder.values() if isinstance(holder, dict) else holder
        holders += [part for part in parts if isinstance(part, dict | list) and part]
    holder = holders[int(rng.integers(len(holders)))]
    key = sorted(holder)[int(rng.integers(len(holder)))] if isinstance(holder, dict) else int(rng.integers(len(holder)))
    if rng.random() < 0.2:
        del holder[key]
        what = f"{key} removed"
    else:
        values = [value for value in _VALUES if not isinstance(value, bytes | np.ndarray)]
        holder[key] = [*values, [], {}, [[[1]]], None][int(rng.integers(len(values) + 4))]
        what = f"{key} = {holder[key]!r:.40}"
    file.write_text(json.dumps(said))
    return what


def _attribute(file: Path, rng: Rng) -> str:
    """An attribute of an HDF5 file gone, of another value, or with a word of its JSON changed."""
    import h5py

    with h5py.File(file, "r+") as opened:
        holders: list[Any] = [opened]
        opened.visititems(lambda _, item: holders.append(item))
        holders = [holder for holder in holders if len(holder.attrs)]
        holder = holders[int(rng.integers(len(holders)))]
        name = sorted(holder.attrs)[int(rng.integers(len(holder.attrs)))]
        if rng.random() < 0.1:
            del holder.attrs[name]
            return f"attribute {holder.name}@{name} removed"
        value = _changed(holder.attrs[name], rng)
        del holder.attrs[name]
        holder.attrs[name] = value
        return f"attribute {holder.name}@{name} = {value!r:.80}"


def _changed(value: Any, rng: Rng) -> Any:
    if isinstance(value, str) and rng.random() < 0.6:
        tokens = list(_TOKENS.finditer(value.encode()))
        if tokens:
            token = tokens[int(rng.integers(len(tokens)))]
            word = _WORDS[int(rng.integers(len(_WORDS)))]
            text = value.encode()[: token.start()] + word + value.encode()[token.end() :]
            return text.decode("utf-8", "replace").replace("\x00", "")
    return _VALUES[int(rng.integers(len(_VALUES)))]


_MOST_VALUES = 10**7
"""Of a dataset whose values are damaged: one may have been made a bomb before."""


def _dataset(file: Path, rng: Rng) -> str:
    """A dataset of an HDF5 file gone, renamed, of other values, type or shape, or of a size that no memory holds."""
    import h5py

    with h5py.File(file, "r+") as opened:
        names: list[str] = []
        opened.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        name = names[int(rng.integers(len(names)))]
        item = opened[name]
        how = int(rng.integers(8))
        if how == 0:
            del opened[name]
            return f"dataset {name} removed"
        if how == 1:
            opened.move(name, name + "x")
            return f"dataset {name} renamed"
        if how in (2, 3) and item.dtype.kind in "fiu" and 0 < item.size < _MOST_VALUES:
            odd = [np.nan, np.inf, -np.inf, 1e308, -1e30][int(rng.integers(5))]
            values = np.asarray(item[...]).copy()
            values.flat[int(rng.integers(values.size))] = odd if item.dtype.kind == "f" else 0
            if how == 3:
                values[...] = odd if item.dtype.kind == "f" else 0
            item[...] = values
            return f"dataset {name}: {'one value' if how == 2 else 'all values'} {odd}"
        attrs, shape = dict(item.attrs), item.shape
        attrs = {key: value for key, value in attrs.items() if key not in ("DIMENSION_LIST", "REFERENCE_LIST")}
        del opened[name]
        made = _other(opened, name, shape, how, rng)
        for key, value in attrs.items():
            if key not in ("CLASS", "NAME", "_Netcdf4Dimid", "_Netcdf4Coordinates"):
                made.attrs[key] = value
        return f"dataset {name} of shape {shape} → {made.shape} {made.dtype}"


def _other(opened: Any, name: str, shape: tuple[int, ...], how: int, rng: Rng) -> Any:
    if how == 4:  # a bomb: it declares much, and compresses to nothing
        return opened.create_dataset(name, (200_000,) * max(1, len(shape)), "f8", chunks=True, compression="gzip")
    if how == 5:
        return opened.create_dataset(name, data=np.array(["odd"] * 3, dtype=object), dtype="S3")
    if how == 6:
        return opened.create_dataset(name, data=np.zeros((0,) * max(1, len(shape))))
    grown = tuple(min(size, 100) + int(rng.integers(-1, 3)) for size in shape) or (2,)
    return opened.create_dataset(name, data=rng.random([max(size, 1) for size in grown]))


def _header(file: Path, rng: Rng) -> str:
    """A word of the header of a safetensors file changed, its length mended."""
    data = file.read_bytes()
    length = struct.unpack("<Q", data[:8])[0]
    head, body = data[8 : 8 + length], data[8 + length :]
    if rng.random() < 0.5 and body:
        values = np.frombuffer(body, "<f4", len(body) // 4).copy()
        values[int(rng.integers(values.size))] = [np.nan, np.inf, 1e38][int(rng.integers(3))]
        file.write_bytes(data[: 8 + length] + values.tobytes() + body[values.nbytes :])
        return "a weight that is not finite"
    said = json.loads(head)
    notes = said.get("__metadata__", {})
    if notes and rng.random() < 0.7:
        name = sorted(notes)[int(rng.integers(len(notes)))]
        notes[name] = str(_changed(notes[name], rng))
        text = json.dumps(said).encode()
        what = f"note {name} changed"
    else:
        tokens = list(_TOKENS.finditer(head))
        token = tokens[int(rng.integers(len(tokens)))]
        text = head[: token.start()] + _WORDS[int(rng.integers(len(_WORDS)))] + head[token.end() :]
        what = f"{token.group()!r:.40} of the header changed"
    file.write_bytes(struct.pack("<Q", len(text)) + text + body)
    return what


def copy(source: Path, target: Path) -> None:
    """A copy of a file or folder."""
    shutil.copytree(source, target) if source.is_dir() else shutil.copy(source, target)
