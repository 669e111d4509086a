"""What a search for codes refuses before any scene is read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tmca.design.expected_error import design_model
from tmca.design.flips import MOST_TILE, tile_bytes
from tmca.design.kinds import KINDS, designable
from tmca.design.sheet import SensorSheet
from tmca.design.transfer import example_bytes
from tmca.errors import SettingError, check_range

_MOST_EXAMPLES = 10e9
"""Memory for what all example scenes say of blocks, bytes."""
_MOST_PIXELS = 2**20


def check_search(
    sheet: SensorSheet,
    slots: Sequence[int] | None,
    kinds: Sequence[str] | None,
    period: int,
    seed: int,
    throughput: float | None,
    light: float | None,
) -> None:
    """Refuse what cannot be searched, whatever the camera; arguments as of `tmca design`.

    Raises:
        SettingError: an impossible value.
    """
    if period < 1:
        raise SettingError("--period", str(period), "1 pixel or more")
    if seed < 0:
        raise SettingError("--seed", str(seed), "0 or more")
    for name, share in (("--throughput", throughput), ("--light", light)):
        if share is not None and not 0 < share < 1:
            raise SettingError(name, f"{share:g}", "a share above 0 and below 1")
    _check_kinds(kinds or ())
    sheet.allowed(slots)
    for kind in sheet.kinds(kinds) if kinds is not None else ():
        remedy = f"{kind} codes need a slot for each bucket"
        check_range("--slots", max(slots or (2,)), KINDS[kind].get("buckets", 1), remedy=remedy)


def check_size(
    camera: Mapping[str, Any], period: tuple[int, int], slots: Sequence[int], scenes: int, buckets: int = 1
) -> None:
    """Refuse what does not fit the memory.

    Args:
        camera: arguments of ``designable`` beside kind, slots and period.
        period: (rows, columns) of the tile of codes, pixels.
        slots: numbers of slots that are tried.
        scenes: number of example scenes.
        buckets: of a pixel.

    Raises:
        SettingError: too large a tile, too many code pixels, or too many scenes for so many bands or views.
    """
    one = designable("static", 1, (8, 8), **camera)
    model = design_model(one.taps())
    tile = f"{period[0]}×{period[1]} pixels"
    if (needed := tile_bytes(model.for_buckets(buckets), period)) > MOST_TILE:
        found = f"{tile}, {needed / 1e9:.1f} GB for the blocks of one tile"
        remedy = f"take a smaller period or fewer {one.channel}s"
        raise SettingError("--period", found, f"at most {MOST_TILE / 1e9:g} GB", remedy)
    if (needed := example_bytes(model, scenes)) > _MOST_EXAMPLES:
        found = f"{scenes} of {model.block[0]} {one.channel}s, {needed / 1e9:.1f} GB for what they say of blocks"
        remedy = f"name fewer scenes, or take fewer {one.channel}s (--{one.channel}s)"
        raise SettingError("scenes", found, f"at most {_MOST_EXAMPLES / 1e9:g} GB", remedy)
    for k in slots:
        if k * period[0] * period[1] > _MOST_PIXELS:
            found, remedy = f"{k} slots of {tile}", "take fewer or a smaller period"
            raise SettingError("--slots", found, f"at most {_MOST_PIXELS} code pixels", remedy)


def _check_kinds(kinds: Sequence[str]) -> None:
    if "static" in kinds:
        raise SettingError("--kinds", "static", "codes of several slots", "the static code is always searched")
    known = [name for name in KINDS if name != "static"]
    for kind in kinds:
        if kind not in known:
            raise SettingError("--kinds", repr(kind), f"some of {', '.join(known)}")
