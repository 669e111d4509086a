"""Sensors with several buckets a pixel: which slots of every pixel are collected in which bucket.

A coded-exposure pixel sends the light of every slot to one of its buckets, and all of them are read. With one bucket
the light of closed slots is lost (drained); with two, a shutter S^k leaves ``S^k`` in the first and ``1 - S^k`` in the
second.
"""

from __future__ import annotations

import torch
from torch import Tensor

from tmca.codes.patterns import FAMILIES
from tmca.errors import SettingError, check_choice, check_range

BURST = "burst"
"""The shutter of frames one after the other: all pixels alike, each bucket a group of neighbouring slots."""
_TAKE_BURST = f"take --shutter {BURST} (in Python shutter={BURST!r}), or patterns of every bucket"


def bucket_shutters(shutter: Tensor, slots: int, buckets: int) -> Tensor:
    """(R, K, H, W') what every bucket collects.

    Args:
        shutter: (K, H, W') of the first of at most two buckets, the second has the rest; or (R·K, H, W') of all.
        slots: K.
        buckets: R.

    """
    if len(shutter) == buckets * slots:
        return shutter.unflatten(0, (buckets, slots))
    return torch.stack((shutter, 1 - shutter))


def mixed_buckets(shutters: Tensor, leakage: float) -> Tensor:
    """(R, K, H, W') of buckets each of which loses a share of its light to the others, evenly."""
    others = shutters.sum(0, keepdim=True) - shutters
    return (1 - leakage) * shutters + leakage / max(1, len(shutters) - 1) * others


def changing(shutters: Tensor) -> Tensor:
    """(R, K, H, W') the slots at whose beginning a pixel changes to a bucket; the exposure repeats."""
    return shutters * (1 - shutters.roll(1, 1))


def check_patterns(count: int, buckets: int, slots: int) -> None:
    """Raises SettingError unless so many patterns say what each of R buckets collects in K slots."""
    if count != buckets * slots and (count != slots or buckets > 2):
        expected = f"{buckets * slots}, {slots} for each of {buckets} buckets"
        raise SettingError("shutter", f"{count} patterns", expected, _TAKE_BURST)


def burst_pattern(slots: int, size: tuple[int, int], buckets: int) -> Tensor:
    """(R, K, H, W') of a burst of R frames, the slots shared out evenly in their order.

    Raises:
        SettingError: fewer slots than buckets.
    """
    check_range("slots", slots, buckets, remedy="each frame of a burst has a slot")
    owner = torch.arange(slots) * buckets // slots
    frames = (owner == torch.arange(buckets)[:, None]).float()
    return frames[..., None, None].expand(-1, -1, *size)


def plane_patterns(shutter: str | Tensor, slots: int, buckets: int, tile: tuple[int, int]) -> tuple[str | Tensor, int]:
    """What a plane shows of a shutter, and how many patterns that is: K, or R·K of all buckets.

    Args:
        shutter: a family, ``BURST``, patterns (K, H, W') or (H, W') of the first bucket, or (R, K, H, W') of all.
        slots: K.
        buckets: R.
        tile: (H, W') of a burst's patterns.

    Raises:
        SettingError: an unknown family, patterns that are not those of R buckets, or a slot of a pixel in two of them.
    """
    if isinstance(shutter, str):
        check_choice("shutter", shutter, (*FAMILIES, BURST))
        if shutter == BURST:
            shutter = burst_pattern(slots, tile, buckets)
        elif buckets > 2:
            raise SettingError("buckets", f"{buckets} with {shutter} codes", "1 or 2, or a burst", _TAKE_BURST)
    if isinstance(shutter, Tensor) and shutter.ndim == 4:
        shutter = _of_all(shutter, slots, buckets)
    if buckets == 1 or isinstance(shutter, str) or shutter.ndim == 2:
        count = slots  # patterns of another number are the plane's to refuse
    else:
        count = len(shutter)
    check_patterns(count, buckets, slots)
    return shutter, count


def _of_all(patterns: Tensor, slots: int, buckets: int) -> Tensor:
    """(R·K, H, W') of patterns (R, K, H, W')."""
    if tuple(patterns.shape[:2]) != (buckets, slots):
        found = f"patterns of {patterns.shape[0]} buckets in {patterns.shape[1]} slots"
        raise SettingError("shutter", found, f"{buckets} in {slots}", f"give buckets={patterns.shape[0]}")
    check_once(patterns)
    return patterns.flatten(0, 1)


def check_once(shutters: Tensor, where: str = "shutter") -> None:
    """Raises SettingError where a slot of a pixel is in two of the buckets of shutters (R, K, H, W')."""
    twice = (shutters.sum(0) > 1 + 1e-6).nonzero()
    if len(twice):
        slot, row, column = twice[0].tolist()
        owners = " and ".join(map(str, shutters[:, slot, row, column].nonzero().flatten().tolist()))
        more = f", and {len(twice) - 1} more" if len(twice) > 1 else ""
        found = f"slot {slot} of pixel ({row}, {column}) in buckets {owners}, counted from 0{more}"
        raise SettingError(where, found, "each slot of a pixel in one bucket, or in none", "close it in all but one")
