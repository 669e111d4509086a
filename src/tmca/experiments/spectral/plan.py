"""Which cells the spectral table is made of: snapshots and decoders, expected errors, trainings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tmca.experiments.cells import Measured, Settings, cell_key
from tmca.experiments.source import source_digest
from tmca.experiments.spectral.rows import (
    CODES,
    DECODER_NAMES,
    LEARNED,
    MULTIPLEXED,
    NETWORKS,
    NOISES,
    OF_UNROLLED_CODES,
    SHOWN,
    SHOWN_NOISE,
    STATIC,
    scenes_of,
    trained_rows,
    training_of,
)


@dataclass(frozen=True)
class Table:
    """What a table is asked to hold.

    Args:
        bands: of the scenes.
        scenes: that are measured.
        decoders: names of ``DECODER_NAMES``.
        priors: file of every decoder that has one.
        seeds: of codes, noise and trainings.
        steps: of a training.
        work: folder of the cells.
    """

    bands: int
    scenes: Sequence[Path]
    decoders: Sequence[str]
    priors: Mapping[str, Path]
    seeds: range
    steps: int
    work: Path


def untrained(table: Table) -> list[Settings]:
    """Measurements of the rows that need no training; those under a prior with the codes of every seed."""
    rows = [
        (code, decoder, seed)
        for decoder in table.decoders if decoder not in NETWORKS
        for seed in (table.seeds if decoder in table.priors else table.seeds[:1])
        for code in CODES
    ]  # fmt: skip
    return [
        _measurement(table, scene, code, noise, decoder, seed) | {"prior": str(table.priors.get(decoder, "")) or None}
        for code, decoder, seed in rows
        for noise in NOISES
        for scene in table.scenes
    ]


def expectations(table: Table, train: Sequence[Path], patches: int) -> list[Settings]:
    """The expected error of every code, and what it is on patches of training and of test scenes."""
    own: Settings = {
        "source": _source(),
        "train": [str(path) for path in train],
        "prior": str(table.priors["lmmse"]),
    }
    own |= {"test": [str(path) for path in table.scenes], "bands": table.bands, "patches": patches}
    return [
        {**own, "name": f"expected error · {code} · {noise}", "code": code, "noise": noise, "seed": table.seeds[0]}
        for noise in NOISES
        for code in CODES
    ]


def trainings(table: Table, train: Path, validation: Path | None) -> list[Settings]:
    """Trainings of all rows and seeds; learned multiplexed codes start at those of the learned static camera."""
    from tmca.data import checksum_of, read_split

    data = {"bands": table.bands, **scenes_of([str(train)]), "validation": [str(validation)] if validation else []}
    checksums = [checksum_of(scene) for split in (train, validation) if split for scene in read_split(split)]
    own: Settings = {"bands": table.bands, "source": _source(), "checksums": checksums}
    cells: dict[tuple[str, str, int], Settings] = {}
    for code, decoder in trained_rows(table.decoders):
        for seed in table.seeds:
            training = training_of(code, decoder, seed, table.steps)
            training["data"] = {**training["data"], **data}
            if code == MULTIPLEXED:
                start = cells[STATIC, decoder, seed]["folder"]
                training["codes"] |= {"start": start, "decoder": start}
            name = f"training · {code} · {DECODER_NAMES[decoder]} · seed {seed}"
            cell = {**own, "name": name, "code": code, "decoder": decoder, "seed": seed, "training": training}
            cells[code, decoder, seed] = cell | {"folder": str(table.work / f"training-{cell_key(cell)}")}
    return list(cells.values())


def behind_networks(table: Table, trained: Sequence[Measured]) -> list[Settings]:
    """Measurements of trained rows, and of decoders without training under the learned codes."""
    rows: list[tuple[Measured, str, str | None]] = [(cell, cell["decoder"], None) for cell in trained]
    for cell in trained:
        if cell["code"] in LEARNED and cell["decoder"] == "unrolled":
            rows += [(cell, name, str(table.priors[name])) for name in OF_UNROLLED_CODES if name in table.decoders]
    return [
        _measurement(table, scene, cell["code"], noise, decoder, cell["seed"])
        | {"prior": prior, "weights": cell["weights"]}
        for cell, decoder, prior in rows
        for noise in NOISES
        for scene in table.scenes
    ]


def _source() -> str:
    return source_digest("tmca.experiments.spectral.cells")


def _measurement(table: Table, scene: Path, code: str, noise: str, decoder: str, seed: int) -> Settings:
    from tmca.data import checksum_of

    return {
        "name": f"{scene.stem} · {code} · {noise} · {DECODER_NAMES[decoder]} · seed {seed}", "scene": scene.stem,
        "source": _source(), "path": str(scene), "checksum": checksum_of(scene), "code": code, "noise": noise,
        "decoder": decoder, "bands": table.bands, "seed": seed,
        "keep": (code, decoder) in SHOWN and noise == SHOWN_NOISE,
    }  # fmt: skip
