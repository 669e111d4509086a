"""Which cells the light-field table is made of: searches, geometry, snapshots and decoders, trainings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tmca.data.light_field_scenes import Reading
from tmca.data.scene_names import identity_of
from tmca.experiments.cells import Measured, Settings, cell_key
from tmca.experiments.decoder_labels import prior_kind
from tmca.experiments.light_field.rows import (
    DECODER_NAMES,
    DESIGNED,
    LEARNED,
    NETWORKS,
    NOISES,
    SHOWN,
    SHOWN_NOISE,
    TRAINED,
    Sizes,
    rows,
    scenes_of,
    search_of,
    training_of,
)

DICTIONARY = "dictionary"


@dataclass(frozen=True)
class Table:
    """What a table is asked to hold.

    Args:
        common: settings of all cells.
        sizes: of views, frames, codes and patches.
        train: light fields that are learned from.
        reading: of these.
        decoders: names of ``DECODER_NAMES``.
        seeds: of codes, noise and trainings.
        steps: of a training.
        work: folder of the cells.
    """

    common: Settings
    sizes: Sizes
    train: Sequence[str]
    reading: Reading
    decoders: Sequence[str]
    seeds: range
    steps: int
    work: Path


def searches(table: Table) -> list[Settings]:
    """Every design of every noise and seed."""
    return [
        {**table.common, "kind": "search", "name": f"search · {code} · {noise} · seed {seed}", "search": [kind, slots],
         "code": code, "noise": noise, "sensor": NOISES[noise], "seed": seed}
        for seed in table.seeds
        for noise in NOISES
        for code, (kind, slots) in ((c, search_of(c, noise)[:2]) for c, (_, target) in DESIGNED.items() if not target)
    ]  # fmt: skip


def geometries(table: Table, places: Sequence[Settings]) -> list[Settings]:
    """The disparity of the true views of every scene."""
    plain = {name: table.common[name] for name in ("source", "views")}
    return [
        {**plain, **place, "kind": "geometry", "name": f"{place['scene']} · disparity of the true views"}
        for place in places if not place["crop"]
    ]  # fmt: skip


def untrained(
    table: Table, places: Sequence[Settings], learned: Mapping[str, str], maps: Mapping[str, str]
) -> list[Settings]:
    """Measurements without training.

    Args:
        table: that is asked for.
        places: where is measured.
        learned: file of the prior or dictionary of every kind.
        maps: disparity of the true views of every scene.
    """
    return [
        cell
        for decoder in (name for name in table.decoders if name not in NETWORKS)
        for noise in NOISES
        for code in rows(noise)
        for seed in table.seeds
        for cell in _measurements(
            {**table.common, **_prior(decoder, learned), "code": code, "noise": noise, "decoder": decoder,
             "seed": seed}, places, maps,
        )
    ]  # fmt: skip


def _prior(decoder: str, learned: Mapping[str, str]) -> Settings:
    """The file of the prior or dictionary that a decoder needs."""
    kind = prior_kind(decoder)
    return {} if kind is None else {DICTIONARY if kind == DICTIONARY else "prior": learned[kind]}


def _measurements(cell: Settings, places: Sequence[Settings], maps: Mapping[str, str]) -> list[Settings]:
    """One in every place; those of dictionaries on crops alone."""
    slow = cell["decoder"] not in NETWORKS and prior_kind(cell["decoder"]) == DICTIONARY
    keep = (cell["code"], cell["decoder"]) in SHOWN and cell["noise"] == SHOWN_NOISE
    label = f"{cell['code']} · {cell['noise']} · {DECODER_NAMES[cell['decoder']]} · seed {cell['seed']}"
    return [
        {**cell, **place, "kind": "measurement", "keep": keep and not place["crop"],
         "name": f"{place['scene']}{' crop' if place['crop'] else ''} · {label}",
         "disparity": None if place["crop"] else maps.get(place["path"])}
        for place in places if place["crop"] or not slow
    ]  # fmt: skip


def trainings(table: Table) -> list[Settings]:
    """Trainings of all rows and seeds."""
    asked = {name: value for name, value in vars(table.reading).items() if value is not None}
    data, checksums = {**scenes_of(table.train), **asked}, [identity_of(name) for name in table.train]
    cells = []
    for seed in table.seeds:
        for decoder in (name for name in table.decoders if name in NETWORKS):
            for code in TRAINED:
                training = training_of(code, decoder, seed, table.steps, table.sizes, _start(table, code, seed))
                training["data"] = {**training["data"], **data}
                cell: Settings = {**table.common, "kind": "training", "code": code, "decoder": decoder, "seed": seed}
                cell |= {"name": f"training · {code} · {DECODER_NAMES[decoder]} · seed {seed}"}
                cell |= {"training": training, "checksums": checksums}
                cells.append(cell | {"folder": str(table.work / f"training-{cell_key(cell)}")})
    return cells


def _start(table: Table, code: str, seed: int) -> str | None:
    """File of the design that a row shows or starts from, None for random codes."""
    from tmca.design import Task

    start = LEARNED.get(code, (code,))[0]
    if start not in DESIGNED:
        return None
    kind, slots, target = search_of(start, "")
    return str(Task.of({**table.common, "seed": seed, "sensor": NOISES[target]}).file(kind, slots))


def behind_networks(
    table: Table, places: Sequence[Settings], trained: Sequence[Measured], maps: Mapping[str, str]
) -> list[Settings]:
    """Measurements of trained rows."""
    found = []
    for row in trained:
        for noise in NOISES:
            cell = {**table.common, "code": row["code"], "noise": noise, "decoder": row["decoder"]}
            found += _measurements(cell | {"seed": row["seed"], "weights": row["weights"]}, places, maps)
    return found
