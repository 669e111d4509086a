"""Snapshots of a batch one after the other, and the share of the work that is done."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from torch import Tensor

from tmca.decoders.decoder import Progress


def part_of(progress: Progress | None, first: float, last: float) -> Callable[[float], None]:
    """Turn the share of a part that is done into the share of all, from ``first`` to ``last``."""
    return lambda share: progress(first + (last - first) * share) if progress else None


def one_by_one(values: Tensor, progress: Progress | None) -> Iterator[tuple[Tensor, Callable[[float], None]]]:
    """The snapshots of a batch alone, each with what takes the share of it that is done."""
    for place, one in enumerate(values.split(1)):
        yield one, part_of(progress, place / len(values), (place + 1) / len(values))
