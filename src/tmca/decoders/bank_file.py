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

FORMAT = "tmca bank 1"
"""Raised when what banks hold, or how they are computed, changes."""
_OF_CELLS = ("pixels", "down", "across", "matrix", "offset", "deviation")
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


def bank_key(prior: GaussianPrior, taps: Taps, noise: Noise, grid: BlockGrid, dtype: torch.dtype) -> str:
    """Digest of all that a bank depends on."""
    digest = blake2b(digest_size=20)
    layout = (taps.channels, taps.offsets, taps.snapshot_width, taps.buckets, grid.tops, grid.lefts, str(dtype))
    digest.update(repr((FORMAT, layout, float(noise.read), float(noise.shot), prior.block)).encode())
    for part in (taps.code, prior.mean, prior.moments):
        digest.update(repr((part.dtype, part.shape)).encode())
        digest.update(part.detach().contiguous().cpu().numpy().data)
    return digest.hexdigest()


def write_bank(bank: Bank, key: str, path: Path) -> None:
    """Write a file, whole or not at all; what was there is replaced.

    Raises:
        OutputError: it cannot be written.
    """
    tensors = {name: value.detach().cpu().contiguous() for name, value in _tensors(bank)}
    about = {"key": key, "boxes": [cell.box for cell in bank.cells], "sums": [*map(_sum, tensors.values())]}
    with atomic_path(path, overwrite=True) as temporary:
        try:
            save_file(tensors, temporary, {"format": FORMAT, "tmca": json.dumps(about)})
        except SafetensorError as error:
            raise OutputError(path, reason(error), "room for a bank", "free some, or leave the file out") from None


def stored_bank(path: Path, key: str, grid: BlockGrid, taps: Taps) -> Bank | None:
    """The bank of a file; None without one, or where it is damaged.

    Raises:
        DataError: a file of something else, or of another camera, noise or prior: it is not touched.

    Warns:
        DamagedBank: a damaged one.
    """
    if not path.exists():
        return None
    try:
        with safe_open(path, "pt") as file:
            head = file.metadata() or {}
            names = set(file.keys())
            tensors = {name: file.get_tensor(name) for name in sorted(names)} if _is_bank(head) else {}
    except (SafetensorError, OSError) as error:
        raise DataError(path, f"no readable bank ({reason(error)})", "one of tmca", "delete it") from None
    if not _is_bank(head):
        raise DataError(path, "a file of something else", "a bank of tmca", "name another file")
    about = json_of(head["tmca"], path, _About)
    if about.key != key:
        found = "the bank of another camera, noise or prior"
        raise DataError(path, found, "this one's", "name another file, or delete it")
    bank = _bank(about, tensors, grid)
    if bank is None or not _fits(bank, taps):
        warn(f"{path}: damaged, and made anew", DamagedBank, stacklevel=2)
        return None
    return _moved(bank, taps.code.device)


def _is_bank(head: dict[str, str]) -> bool:
    return head.get("format") == FORMAT and "tmca" in head


def _tensors(bank: Bank) -> Iterator[tuple[str, Tensor]]:
    for place, cell in enumerate(bank.cells):
        for name in _OF_CELLS:
            yield f"{place:05d}.{name}", getattr(cell, name)
    yield "deviation", bank.deviation


def _sum(tensor: Tensor) -> int:
    """Of its words: any flipped bit changes it, and it is read as fast as memory is."""
    return int(tensor.contiguous().flatten().view(torch.int32).sum(dtype=torch.int64)) if tensor.numel() else 0


def _bank(about: _About, tensors: dict[str, Tensor], grid: BlockGrid) -> Bank | None:
    """The bank that a head and tensors make; None where these are not what the head says."""
    parts = [{name: tensors.get(f"{place:05d}.{name}") for name in _OF_CELLS} for place in range(len(about.boxes))]
    named = [part for group in parts for part in group.values()] + [tensors.get("deviation")]
    whole = [part for part in named if part is not None]
    if len(whole) < len(named) or [*map(_sum, whole)] != [*about.sums]:
        return None
    cells = [EqualCells(box=box, **group) for box, group in zip(about.boxes, parts, strict=True)]  # type: ignore[arg-type]
    return Bank(grid, cells, tensors["deviation"])


def _fits(bank: Bank, taps: Taps) -> bool:
    """Whether the cells make up a frame of the camera, and all measurements are there."""
    channels, (height, width) = taps.scene_channels, bank.grid.frame
    seen = bank.grid.pad_snapshot(torch.empty(1, *taps.snapshot_shape, device="meta")).shape[1:]
    covered = sum(cell.pixels.numel() for cell in bank.cells)
    alike = tuple(bank.deviation.shape) == (1, channels, height, width) and bank.deviation.is_floating_point()
    return alike and covered == height * width and all(_inside(cell, seen, channels, covered) for cell in bank.cells)


def _inside(cell: EqualCells, seen: torch.Size, channels: int, pixels: int) -> bool:
    """Whether tensors of cells go together, and their indices lie within the snapshot (R, rows, columns) and the
    frame."""
    sides = cell.offset.shape[1:]
    count, area = len(cell.down), prod(sides)
    shapes = [tuple(getattr(cell, name).shape) for name in _OF_CELLS]
    wanted = [(count, area), (count,), (count,), (seen[0] * prod(cell.box), channels * area)]
    places, numbers = (cell.pixels, cell.down, cell.across), (cell.matrix, cell.offset, cell.deviation)
    ends = (pixels - 1, seen[1] - cell.box[0], seen[2] - cell.box[1])
    return (
        len(sides) == 2
        and count > 0
        and shapes == [*wanted, (channels, *sides), (channels, *sides)]
        and all(part.dtype == torch.int64 for part in places)
        and all(part.dtype == cell.matrix.dtype and part.is_floating_point() for part in numbers)
        and all(int(part.min()) >= 0 and int(part.max()) <= end for part, end in zip(places, ends, strict=True))
    )


def _moved(bank: Bank, device: torch.device) -> Bank:
    def there(cell: EqualCells) -> EqualCells:
        moved: dict[str, Any] = {name: getattr(cell, name).to(device) for name in _OF_CELLS}
        return EqualCells(box=cell.box, **moved)

    return Bank(bank.grid, [there(cell) for cell in bank.cells], bank.deviation.to(device))
