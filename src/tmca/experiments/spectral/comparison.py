"""The table of the spectral camera: codes × noises × decoders over test scenes, in cells that are computed once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tmca.errors import SettingError
from tmca.experiments.cells import Failures, Measured, Settings, Timed, run_cells, source_digest, timed
from tmca.experiments.results import check_counts, check_new
from tmca.experiments.spectral.cells import measure
from tmca.experiments.spectral.figures import comparison_pictures, picture_files
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
from tmca.experiments.spectral.tables import markdown, results


def compare_spectral(
    train: Path,
    test: Path,
    out: Path,
    work: Path,
    *,
    bands: int = 12,
    decoders: Sequence[str] = ("lmmse", "mixture", "admm-tv"),
    validation: Path | None = None,
    seed: int = 0,
    seeds: int = 1,
    steps: int = 400,
    patches: int = 24_000,
    jobs: int = 1,
    cluster: Settings | None = None,
    overwrite: bool = False,
    progress: Timed | None = None,
    command: Sequence[str] = (),
) -> dict[str, Any]:
    """Measure every code, noise and decoder on the scenes of ``test`` with priors learned from those of ``train``.

    Args:
        train: split file of the prior's scenes.
        test: split file of the measured scenes.
        out: folder of ``spectral.md``, ``spectral.json`` and pictures of some rows.
        work: folder of priors and finished cells; a stopped run goes on there.
        bands: number of bands from 400 to 700 nm.
        decoders: names of ``DECODER_NAMES``.
        validation: split file of the scenes that choose a network's best step.
        seed: of codes, noise and trainings.
        seeds: codes and noise of the rows under a prior, and trainings of the others, from ``seed`` on.
        steps: of a training.
        patches: on which the expected error is checked, for each code and noise.
        jobs: processes side by side.
        cluster: parameters of submitit, to send the cells to Slurm instead.
        overwrite: replace the two result files.
        progress: told (done, all, name, seconds left) after each cell.
        command: how the run was called, kept in the results.

    Raises:
        SettingError: unknown decoder.
        OutputError: the results exist.
        DataError: a scene of a split is missing or altered.
        CellsFailed: some cells failed; the table of the others is written.
    """
    from tmca.data import make_folder, read_split, write_json, write_text

    check_counts(seeds=seeds, steps=steps, jobs=jobs)
    unknown = [name for name in decoders if name not in DECODER_NAMES]
    if unknown:
        raise SettingError("--decoders", ", ".join(unknown), f"some of {', '.join(DECODER_NAMES)}")
    examples, scenes = read_split(train), read_split(test)
    files = [out / "spectral.json", out / "spectral.md"]
    check_new([*files, *(picture for scene in scenes for picture in picture_files(scene.stem, out))], overwrite)
    make_folder(out)
    make_folder(work)
    priors = _learn(examples, work, bands, decoders)
    cells = _cells(scenes, priors, bands, decoders, seed, seeds)
    if "lmmse" in priors:
        cells += _expectations(examples, scenes, priors["lmmse"], bands, seed, patches)

    failures = Failures(work)

    def run(part: list[Settings]) -> list[Measured]:
        compute, told = partial(measure, folder=str(work)), timed(progress)
        return run_cells(part, compute, work, jobs=jobs, cluster=cluster, progress=told, failures=failures)

    measured = run(cells)
    trainings = _trainings(train, validation, work, bands, decoders, seed, seeds, steps)
    trained = []
    for later in (False, True):  # learned multiplexed codes start at learned static ones
        part = [cell for cell in trainings if (cell["code"] == MULTIPLEXED) == later]
        trained += run(part)
    measured += trained
    measured += run(_trained_cells(scenes, trained, bands, decoders, priors))
    if not any("metrics" in cell for cell in measured):
        failures.check()
    found = results(measured, train, test, command, validation)
    write_json(found, files[0], overwrite=overwrite)
    write_text(markdown(found), files[1], overwrite=overwrite)
    comparison_pictures([cell for cell in measured if cell.get("seed") == seed], out, overwrite=overwrite)
    failures.check()
    return found


def _learn(scenes: Sequence[Path], work: Path, bands: int, decoders: Sequence[str]) -> dict[str, Path]:
    """Files of the priors that the decoders need, learned where they are not yet kept."""
    from tmca.data import checksum_of
    from tmca.experiments.cells import cell_key
    from tmca.experiments.scenes import load_scene
    from tmca.priors import learn_prior

    kept: dict[str, Path] = {}
    for kind, users in {"lmmse": {"lmmse", "lmmse-adapted"}, "mixture": {"mixture"}}.items():
        if not users & set(decoders):
            continue
        identity: dict[str, Any] = {"decoder": kind, "bands": bands, "source": source_digest()}
        identity["scenes"] = [checksum_of(s) for s in scenes]
        file = work / f"prior-{kind}-{cell_key(identity)}.nc"
        if not file.exists():
            cubes = [load_scene(scene, bands=bands) for scene in scenes]
            learn_prior(cubes, spread=bands - 1, mixture=kind == "mixture").save(file)
        kept |= dict.fromkeys(users, file)
    return kept


def _cells(
    scenes: Sequence[Path], priors: dict[str, Path], bands: int, decoders: Sequence[str], seed: int, seeds: int
) -> list[Settings]:
    """Measurements of the rows that need no training; those under a prior with the codes of every seed."""
    rows = [
        (code, decoder, seed + extra)
        for decoder in decoders
        if decoder not in NETWORKS
        for extra in range(seeds if decoder in priors else 1)
        for code in CODES
    ]
    return [
        _measurement(scene, code, noise, decoder, bands, place) | {"prior": str(priors.get(decoder, "")) or None}
        for code, decoder, place in rows
        for noise in NOISES
        for scene in scenes
    ]


def _trainings(
    train: Path,
    validation: Path | None,
    work: Path,
    bands: int,
    decoders: Sequence[str],
    first: int,
    seeds: int,
    steps: int,
) -> list[Settings]:
    """Trainings of all rows and seeds; learned multiplexed codes start at those of the learned static camera."""
    from tmca.data import checksum_of, read_split
    from tmca.experiments.cells import cell_key

    data = {"bands": bands, **scenes_of([str(train)]), "validation": [str(validation)] if validation else []}
    checksums = [checksum_of(scene) for split in (train, validation) if split for scene in read_split(split)]
    cells: dict[tuple[str, str, int], Settings] = {}
    for code, decoder in trained_rows(decoders):
        for seed in range(first, first + seeds):
            training = training_of(code, decoder, seed, steps)
            training["data"] = {**training["data"], **data}
            if code == MULTIPLEXED:
                start = cells[STATIC, decoder, seed]["folder"]
                training["codes"] |= {"start": start, "decoder": start}
            cell: Settings = {"name": f"training · {code} · {DECODER_NAMES[decoder]} · seed {seed}", "code": code}
            cell |= {"decoder": decoder, "seed": seed, "bands": bands, "training": training, "source": source_digest()}
            cell["checksums"] = checksums
            cells[code, decoder, seed] = cell | {"folder": str(work / f"training-{cell_key(cell)}")}
    return list(cells.values())


def _trained_cells(
    scenes: Sequence[Path],
    trained: Sequence[Measured],
    bands: int,
    decoders: Sequence[str],
    priors: dict[str, Path],
) -> list[Settings]:
    """Measurements of trained rows, and of decoders without training under the learned codes."""
    rows: list[tuple[Measured, str, str | None]] = [(cell, cell["decoder"], None) for cell in trained]
    for cell in trained:
        if cell["code"] in LEARNED and cell["decoder"] == "unrolled":
            rows += [(cell, name, str(priors[name])) for name in OF_UNROLLED_CODES if name in decoders]
    return [
        _measurement(scene, cell["code"], noise, decoder, bands, cell["seed"])
        | {"prior": prior, "weights": cell["weights"]}
        for cell, decoder, prior in rows
        for noise in NOISES
        for scene in scenes
    ]


def _measurement(scene: Path, code: str, noise: str, decoder: str, bands: int, seed: int) -> Settings:
    from tmca.data import checksum_of

    return {
        "name": f"{scene.stem} · {code} · {noise} · {DECODER_NAMES[decoder]} · seed {seed}",
        "scene": scene.stem,
        "source": source_digest(),
        "path": str(scene),
        "checksum": checksum_of(scene),
        "code": code,
        "noise": noise,
        "decoder": decoder,
        "bands": bands,
        "seed": seed,
        "keep": (code, decoder) in SHOWN and noise == SHOWN_NOISE,
    }


def _expectations(
    train: Sequence[Path], test: Sequence[Path], prior: Path, bands: int, seed: int, patches: int
) -> list[Settings]:
    return [
        {
            "name": f"expected error · {code} · {noise}",
            "source": source_digest(),
            "train": [str(path) for path in train],
            "test": [str(path) for path in test],
            "prior": str(prior),
            "code": code,
            "noise": noise,
            "bands": bands,
            "seed": seed,
            "patches": patches,
        }
        for noise in NOISES
        for code in CODES
    ]
