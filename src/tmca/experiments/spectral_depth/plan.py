"""Which cells the spectral-depth table is made of: searches, snapshots and decoders, trainings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tmca.design import MaskEffort
from tmca.experiments.cells import Measured, Settings, cell_key
from tmca.experiments.spectral_depth.rows import (
    CODES,
    CONSTANT,
    DESIGNED,
    LEARNED,
    LEARNED_WITH,
    NETWORKS,
    NOISES,
    STARTS,
    TRAINED,
    Sizes,
    training_of,
)

_JUDGED_BY = ("source", "preset", "prior", "examples", "side", "placed", "from_rgb")
"""What makes the figures of a mask, beside its code."""


@dataclass(frozen=True)
class Table:
    """What a table is asked to hold.

    Args:
        common: settings of all cells that measure.
        sizes: of scenes, windows and patches.
        train: scenes that are learned from.
        decoders: names of ``DECODER_NAMES``.
        seeds: of codes, noise and trainings.
        effort: arguments of `MaskEffort`.
        steps: of a training.
        work: folder of the cells.
        withheld: one of ``train`` that teaches networks nothing, and with a rendered scene chooses their best step.
    """

    common: Settings
    sizes: Sizes
    train: Sequence[str]
    decoders: Sequence[str]
    seeds: range
    effort: Mapping[str, Any]
    steps: int
    work: Path
    withheld: str | None = None


Codes = Mapping[tuple[str, int], str]
"""Files of the masks that were found, by code and seed."""


def constant(table: Table) -> Settings:
    """The middle of the range, guessed everywhere."""
    own = {"kind": "constant", "name": CONSTANT, "seed": table.seeds[0], "decoder": CONSTANT, "noise": ""}
    return {**table.common, **own}


def searches(table: Table) -> list[Settings]:
    """Masks that are searched for least confusion under the first noise, and judged on training scenes."""
    noise, sensor = next(iter(NOISES.items()))
    kept = {name: table.common[name] for name in _JUDGED_BY}
    return [
        {**kept, "kind": "search", "name": f"search · {code} · seed {seed}", "code": code, "noise": noise,
         "sensor": sensor, "seed": seed, "effort": _effort(table, code), "window": table.sizes.searched,
         "decoded": table.sizes.window}
        for code in DESIGNED for seed in table.seeds
    ]  # fmt: skip


def _effort(table: Table, code: str) -> Settings:
    """That of a search."""
    own = MaskEffort(**table.effort)
    return {**table.effort, "starts": STARTS.get(code, 1) * own.starts}


def untrained(table: Table, codes: Codes, decoder: str = "likelihood") -> list[Settings]:
    """A decoder without training behind random and optimised codes."""
    return [
        {**table.common, "kind": "rows", "name": f"{code} · {noise} · {decoder} · seed {seed}", "code": code,
         "noise": noise, "sensor": sensor, "seed": seed, "decoder": decoder, "window": table.sizes.window,
         "codes": codes.get((code, seed)), "keep": seed == table.seeds[0] and noise == next(iter(NOISES))}
        for code in CODES for noise, sensor in NOISES.items() for seed in table.seeds
        if ((code, seed) in codes or code not in DESIGNED) and code not in LEARNED
    ]  # fmt: skip


def foretold(table: Table, rows: Sequence[Settings]) -> list[Settings]:
    """What is foretold of every row without a network."""
    kept = (*_JUDGED_BY, "code", "noise", "sensor", "seed", "codes", "camera_of")
    return [
        {**{name: row[name] for name in kept if name in row}, "kind": "foretold", "window": table.sizes.searched,
         "decoded": table.sizes.window, "name": f"foretold · {row['code']} · {row['noise']} · seed {row['seed']}"}
        for row in rows if row["decoder"] == "likelihood"
    ]  # fmt: skip


def trainings(table: Table, codes: Codes) -> list[Settings]:
    """A network behind every code, on the given scenes and the rendered ones; one that learns with learned codes."""
    found: list[Settings] = []
    for decoder in (name for name in table.decoders if name in NETWORKS):
        for code in (name for name in TRAINED if name not in LEARNED or decoder == LEARNED_WITH):
            for seed in table.seeds:
                start = codes.get((LEARNED.get(code, code), seed))
                if code in (*LEARNED, *DESIGNED) and start is None:
                    continue  # its search failed
                found.append(_training(table, code, decoder, seed, start, learn=code in LEARNED))
    return found


def behind_learned(table: Table, trained: Sequence[Measured]) -> list[Settings]:
    """The other networks behind codes that were learned with ``LEARNED_WITH``, which stay as they are."""
    return [
        _training(table, cell["code"], decoder, cell["seed"], cell["weights"], learn=False)
        | {"codes_seconds": cell["seconds"]}
        for decoder in table.decoders if decoder in NETWORKS and decoder != LEARNED_WITH
        for cell in trained if cell["code"] in LEARNED and cell["decoder"] == LEARNED_WITH
    ]  # fmt: skip


def _training(table: Table, code: str, decoder: str, seed: int, start: str | None, learn: bool) -> Settings:
    """A training in a folder of its own."""
    training = training_of(code, decoder, seed, table.steps, table.sizes, list(NOISES), start, learn)
    training["data"] |= network_scenes(table)
    cell = {name: table.common[name] for name in ("source", "side", "placed", "from_rgb", "checksums")}
    cell |= {"kind": "training", "name": f"training · {code} · {decoder} · seed {seed}"}
    cell |= {"code": code, "decoder": decoder, "seed": seed, "training": training}
    return {**cell, "folder": str(table.work / f"run-{cell_key(cell)}")}


def network_scenes(table: Table) -> Settings:
    """Those of a training: what is measured teaches nothing, a rendered and a withheld scene choose the best step."""
    from tmca.data import split_rendered

    rendered = sorted({*split_rendered()["train"]} - {*table.common["scenes"]})
    learned = [name for name in table.train if name != table.withheld]
    chosen = rendered[:1] if table.withheld is None else [*rendered[:1], table.withheld]
    return {"train": [*learned, *rendered[1:]], "validation": chosen, "prior": learned}


def behind_networks(table: Table, trained: Sequence[Measured]) -> list[Settings]:
    """Every network behind its codes; the likelihood, if it is asked for, behind the masks that were learned too."""
    rows = [(cell, cell["decoder"], "weights") for cell in trained]
    if "likelihood" in table.decoders:
        learned = [cell for cell in trained if cell["code"] in LEARNED and cell["decoder"] == LEARNED_WITH]
        rows += [(cell, "likelihood", "camera_of") for cell in learned]
    first = min((cell["seed"] for cell in trained), default=0)
    return [
        {**table.common, "kind": "rows", "name": f"{cell['code']} · {noise} · {decoder} · seed {cell['seed']}",
         "code": cell["code"], "noise": noise, "sensor": sensor, "seed": cell["seed"], "decoder": decoder,
         part: cell["weights"], "window": table.sizes.window,
         "training_seconds": float(np.round(cell["seconds"] + cell.get("codes_seconds", 0), 3)),
         "keep": cell["seed"] == first and noise == next(iter(NOISES))}
        for cell, decoder, part in rows for noise, sensor in NOISES.items()
    ]  # fmt: skip
