"""Which cells the spectral-depth table is made of: searches, snapshots and decoders, trainings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tmca.experiments.cells import Measured, Settings, cell_key
from tmca.experiments.spectral_depth.rows import (
    CODES,
    DESIGNED,
    LEARNED,
    LEARNED_WITH,
    NETWORKS,
    NOISES,
    TRAINED,
    Sizes,
    training_of,
)

_JUDGED_BY = ("source", "preset", "prior", "examples", "side", "placed", "from_rgb")
"""What makes the figures of a mask, beside its code."""


def searches(common: Settings, sizes: Sizes, effort: dict[str, Any], seeds: Sequence[int]) -> list[Settings]:
    """Masks that are searched for least confusion under the first noise, and judged on training scenes."""
    noise, sensor = next(iter(NOISES.items()))
    kept = {name: common[name] for name in _JUDGED_BY}
    return [
        {**kept, "kind": "search", "name": f"search · {code} · seed {seed}", "code": code, "noise": noise,
         "sensor": sensor, "seed": seed, "effort": effort, "window": sizes.searched}
        for code in DESIGNED for seed in seeds
    ]  # fmt: skip


def untrained(
    common: Settings, sizes: Sizes, codes: dict[tuple[str, int], str], seeds: Sequence[int]
) -> list[Settings]:
    """The patch likelihood behind random and optimised codes."""
    return [
        {**common, "kind": "rows", "name": f"{code} · {noise} · likelihood · seed {seed}", "code": code, "noise": noise,
         "sensor": sensor, "seed": seed, "decoder": "likelihood", "window": sizes.window,
         "codes": codes.get((code, seed)), "keep": seed == seeds[0] and noise == next(iter(NOISES))}
        for code in CODES for noise, sensor in NOISES.items() for seed in seeds
        if ((code, seed) in codes or code not in DESIGNED) and code not in LEARNED
    ]  # fmt: skip


def foretold(rows: Sequence[Settings], sizes: Sizes) -> list[Settings]:
    """What is foretold of every row without a network."""
    kept = (*_JUDGED_BY, "code", "noise", "sensor", "seed", "codes")
    return [
        {**{name: row[name] for name in kept}, "kind": "foretold", "window": sizes.searched,
         "name": f"foretold · {row['code']} · {row['noise']} · seed {row['seed']}"}
        for row in rows
    ]  # fmt: skip


def trainings(
    common: Settings,
    sizes: Sizes,
    train: Sequence[str],
    codes: dict[tuple[str, int], str],
    decoders: Sequence[str],
    seeds: Sequence[int],
    steps: int,
    work: Path,
) -> list[Settings]:
    """A network behind every code, on the given scenes and the rendered ones."""
    from tmca.data import split_rendered

    own = {*split_rendered()["train"]} - {*common["scenes"]}  # what is measured teaches nothing
    kept = {name: common[name] for name in ("source", "side", "placed", "from_rgb", "checksums")}
    rendered, found = sorted(own), list[Settings]()
    for decoder in (name for name in decoders if name in NETWORKS):
        for code in (name for name in TRAINED if name not in LEARNED or decoder == LEARNED_WITH):
            for seed in seeds:
                start = codes.get((LEARNED.get(code, code), seed))
                if code in (*LEARNED, *DESIGNED) and start is None:
                    continue  # its search failed
                training = training_of(code, decoder, seed, steps, sizes, list(NOISES), start)
                training["data"] |= {"train": [*train, *rendered[1:]], "validation": rendered[:1], "prior": list(train)}
                cell = {**kept, "kind": "training", "name": f"training · {code} · {decoder} · seed {seed}"}
                cell |= {"code": code, "decoder": decoder, "seed": seed, "training": training}
                found.append({**cell, "folder": str(work / f"run-{cell_key(cell)}")})
    return found


def behind_networks(
    common: Settings, sizes: Sizes, trained: Sequence[Measured], likelihood: bool = False
) -> list[Settings]:
    """Every network behind its codes; with ``likelihood`` that too behind the masks that were learned."""
    rows = [(cell, cell["decoder"], "weights") for cell in trained]
    rows += [(cell, "likelihood", "camera_of") for cell in trained if likelihood and cell["code"] in LEARNED]
    first = min((cell["seed"] for cell in trained), default=0)
    return [
        {**common, "kind": "rows", "name": f"{cell['code']} · {noise} · {decoder} · seed {cell['seed']}",
         "code": cell["code"], "noise": noise, "sensor": sensor, "seed": cell["seed"], "decoder": decoder,
         part: cell["weights"], "window": sizes.window, "training_seconds": float(np.round(cell["seconds"], 3)),
         "keep": cell["seed"] == first and noise == next(iter(NOISES))}
        for cell, decoder, part in rows for noise, sensor in NOISES.items()
    ]  # fmt: skip
