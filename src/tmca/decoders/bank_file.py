"""Banks in files, so that the next process decodes at once: safetensors, one for a camera, its noise and a prior."""

from __future__ import annotations

import json
from collections.abc import Iterator
from hashlib import blake2b
from math import prod
from pathlib import Path
from typing import Annotated, Any
from warnings import warn

import torch
from pydantic import Field
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from tmca.arguments import reason
from tmca.attributes import Attributes, json_of
from tmca.data import atomic_path
from tmca.decoders.bank import Bank, EqualCells
from tmca.errors import DataError, OutputError
from tmca.operators.blocks import BlockGrid
from tmca.operators.taps import Taps
from tmca.priors import GaussianPrior
from tmca.sensor import Noise

FORMAT = "tmca bank 3"
"""Raised when what banks hold, or how they are computed, changes."""
_PLACES, _PARTS = ("pixels", "down", "across"), ("pixels", "down", "across", "matrix")
"""Tensors of a cell."""
_FRAMES = ("offset", "deviation")
_ANY_FORMAT, _NAME = "tmca bank ", "name another file"
_LONGEST_HEAD = 2**26
"""Bytes."""
_SAME_CODE = 1e-6
"""Relative to its largest value: what devices compute of a code otherwise."""
Side = Annotated[int, Field(ge=1)]


class DamagedBank(UserWarning):
    """A file of a bank that is not what was written; it is made anew."""


class _About(Attributes):
    """What the head of the file says.

    Args:
        key: see `bank_key`.
        boxes: rows and columns of the measurements of every group of cells.
        sums: of all tensors, in their order.
    """

    key: str
    boxes: tuple[tuple[Side, Side], ...]
    sums: tuple[int, ...]


def bank_key(
    prior: GaussianPrior, taps: Taps, noise: Noise, grid: BlockGrid, dtype: torch.dtype, fast: bool = False
) -> str:
    """Digest of all that a bank depends on but the code, which devices compute with other last bits."""
    digest = blake2b(digest_size=20)
    layout = (taps.channels, taps.offsets, taps.snapshot_width, taps.buckets, grid.tops, grid.lefts, str(dtype), fast)
    digest.update(repr((FORMAT, layout, tuple(taps.code.shape), noise.read, noise.shot, prior.block)).encode())
    for part in (prior.mean, prior.moments):
        digest.update(repr((part.dtype, part.shape)).encode())
        digest.update(part.detach().contiguous().cpu().numpy().data)
    return digest.hexdigest()


def write_bank(bank: Bank, code: Tensor, key: str, path: Path) -> None:
    """Write a file, whole or not at all; what was there is replaced.

    Raises:
        OutputError: it cannot be written.
    """
    tensors = {name: value.detach().cpu().contiguous() for name, value in _tensors(bank, code)}
    boxes, sums = [cell.box for cell in bank.cells], [*map(_sum, tensors.values())]
    about = {"key": key, "boxes": boxes, "sums": sums}
    with atomic_path(path, overwrite=True) as temporary:
        temporary.touch()
        mode = temporary.stat().st_mode  # that of any file of the user; those of safetensors are closed to others
        try:
            save_file(tensors, temporary, {"format": FORMAT, "tmca": json.dumps(about)})
            temporary.chmod(mode)
        except SafetensorError as error:
            found, remedy = reason(error), "free some room, or leave the file out"
            raise OutputError(path, found, "a bank written whole", remedy) from None


def stored_bank(path: Path, key: str, grid: BlockGrid, taps: Taps, dtype: torch.dtype) -> Bank | None:
    """The bank of a file, its numbers of a type; None without one, or where it is damaged.

    Raises:
        DataError: a file of something else, or of another camera, noise or prior: it is not touched.

    Warns:
        DamagedBank: a damaged one.
    """
    if not path.exists():
        return None
    head = _head(path)
    try:
        about = json_of(head["tmca"], path, _About)
        bank, code = _restored(about, path, grid, taps, dtype) if about.key == key else (None, taps.code)
    except (KeyError, ValueError, DataError, SafetensorError, OSError):
        warn(f"{path}: damaged, and made anew", DamagedBank, stacklevel=2)
        return None
    if bank is None or float((code - taps.code.detach().float()).abs().max()) > _SAME_CODE * float(code.abs().max()):
        found = "the bank of another camera, noise, prior or setting"
        raise DataError(path, found, "this one's", f"{_NAME}, or delete it")
    return bank


def _head(path: Path) -> dict[str, Any]:
    """What the head of a bank says, also where the rest of the file is damaged; DataError for other files."""
    try:
        with path.open("rb") as file:
            length = int.from_bytes(file.read(8), "little")
            head = json.loads(file.read(length)).get("__metadata__", {}) if length <= _LONGEST_HEAD else {}
            written = str(head.get("format"))
    except (OSError, ValueError, AttributeError, RecursionError):
        head, written = {}, ""
    if written.startswith(_ANY_FORMAT) and written != FORMAT:
        raise DataError(path, f"the format {written}", FORMAT, f"{_NAME}, or delete it")
    if written != FORMAT:
        raise DataError(path, "a file of something else, or its beginning is damaged", "a bank of tmca", _NAME)
    return dict(head)


def _tensors(bank: Bank, code: Tensor) -> Iterator[tuple[str, Tensor]]:
    for place, cell in enumerate(bank.cells):
        for name in _PARTS:
            yield f"{place:05d}.{name}", getattr(cell, name)
    for name in _FRAMES:
        yield name, getattr(bank, name)
    yield "code", code


def _sum(tensor: Tensor) -> int:
    """Of the words of numbers of 2, 4 or 8 bytes: any flipped bit changes it, and it is read as fast as memory is."""
    word = torch.int16 if tensor.itemsize == 2 else torch.int32
    return int(tensor.contiguous().flatten().view(word).sum(dtype=torch.int64)) if tensor.numel() else 0


def _restored(about: _About, path: Path, grid: BlockGrid, taps: Taps, dtype: torch.dtype) -> tuple[Bank, Tensor]:
    """The bank and the code of a file; KeyError or ValueError where they are not what its head says."""
    with safe_open(path, "pt", str(taps.code.device)) as file:
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    cells = [
        EqualCells(box=box, **{name: tensors[f"{place:05d}.{name}"] for name in _PARTS})
        for place, box in enumerate(about.boxes)
    ]
    bank, code = Bank(grid, cells, **{name: tensors[name] for name in _FRAMES}), tensors["code"]
    every, types = [*_tensors(bank, code)], {name: [torch.int64] for name in _PLACES}
    types |= {"code": [torch.float32], "matrix": [dtype, torch.bfloat16]}
    if any(values.dtype not in types.get(name.rpartition(".")[2], [dtype]) for name, values in every):
        raise ValueError("tensors of other types")
    if [_sum(values) for _, values in every] != [*about.sums] or code.shape != taps.code.shape or not _fits(bank, taps):
        raise ValueError("tensors that do not go together")
    return bank, code


def _fits(bank: Bank, taps: Taps) -> bool:
    """Whether the cells make up a frame of the camera, and all measurements are there."""
    shape = (1, taps.scene_channels, *bank.grid.frame)
    seen = bank.grid.pad_snapshot(torch.empty(1, *taps.snapshot_shape, device="meta")).shape[1:]
    if any(tuple(frame.shape) != shape or not _finite(frame) for frame in (bank.offset, bank.deviation)):
        return False
    count = prod(bank.grid.frame)
    if not all(_inside(cell, seen, shape[1], count) for cell in bank.cells):
        return False
    pixels = torch.cat([cell.pixels.flatten() for cell in bank.cells])
    return len(pixels) == count and bool((pixels.bincount(minlength=count) == 1).all())


def _inside(cell: EqualCells, seen: torch.Size, channels: int, pixels: int) -> bool:
    """Whether tensors of cells go together, and their indices lie within the snapshot (R, rows, columns) and the
    frame."""
    count, size = cell.down.numel(), cell.pixels.shape[-1] if cell.pixels.ndim else 0
    shapes = [tuple(getattr(cell, name).shape) for name in _PARTS]
    wanted = [(count, size), (count,), (count,), (seen[0] * prod(cell.box), channels * size)]
    places, ends = (cell.pixels, cell.down, cell.across), (pixels - 1, seen[1] - cell.box[0], seen[2] - cell.box[1])
    return (
        count * size > 0
        and shapes == wanted
        and all(int(part.min()) >= 0 and int(part.max()) <= end for part, end in zip(places, ends, strict=True))
        and _finite(cell.matrix)
    )


def _finite(numbers: Tensor) -> bool:
    return bool(numbers.sum().isfinite())
