"""The table of the spectral camera: codes × noises × decoders over test scenes, in cells that are computed once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tmca.data.scenes import check_readable
from tmca.experiments.cells import Grid, Measured, Timed, cell_key
from tmca.experiments.decoder_labels import prior_kind
from tmca.experiments.results import check_counts, check_decoders, check_new, write_table
from tmca.experiments.source import source_digest
from tmca.experiments.spectral import plan
from tmca.experiments.spectral.cells import measure
from tmca.experiments.spectral.figures import comparison_pictures, picture_files
from tmca.experiments.spectral.plan import Table
from tmca.experiments.spectral.rows import DECODER_NAMES, MULTIPLEXED, NETWORKS
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
    cluster: dict[str, Any] | None = None,
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
    from tmca.data import make_folder, read_split

    check_counts(seeds=seeds, steps=steps, jobs=jobs)
    check_decoders(decoders, DECODER_NAMES)
    examples, scenes = read_split(train), read_split(test)
    files = [out / "spectral.json", out / "spectral.md"]
    check_new([*files, *(picture for scene in scenes for picture in picture_files(scene.stem, out))], overwrite)
    check_readable([*examples, *scenes, *(read_split(validation) if validation else ())], bands)
    make_folder(out)
    priors = _learn(examples, make_folder(work), bands, decoders)
    grid = Grid(partial(measure, folder=str(work)), work, jobs, cluster, progress)
    table = Table(bands, scenes, decoders, priors, range(seed, seed + seeds), steps, work)
    cells = plan.untrained(table)
    if "lmmse" in priors:
        cells += plan.expectations(table, examples, patches)
    measured = grid.run(cells)
    trainings, trained = plan.trainings(table, train, validation), list[Measured]()
    for later in (False, True):  # learned multiplexed codes start at learned static ones
        trained += grid.run([cell for cell in trainings if (cell["code"] == MULTIPLEXED) == later])
    measured += trained
    measured += grid.run(plan.behind_networks(table, trained))
    if not any("metrics" in cell for cell in measured):
        grid.failures.check()
    found = results(measured, train, test, command, validation)
    write_table(found, markdown(found), files, overwrite)
    comparison_pictures([cell for cell in measured if cell.get("seed") == seed], out, overwrite=overwrite)
    grid.failures.check()
    return found


def _learn(scenes: Sequence[Path], work: Path, bands: int, decoders: Sequence[str]) -> dict[str, Path]:
    """Files of the priors that the decoders need, learned where they are not yet kept."""
    from tmca.data import checksum_of
    from tmca.data.scenes import load_scene
    from tmca.priors import learn_prior

    files: dict[str, Path] = {}
    for kind, prior in {"lmmse": "gaussian", "mixture": "mixture"}.items():
        users = [name for name in decoders if name not in NETWORKS and prior_kind(name) == prior]
        if not users:
            continue
        identity: dict[str, Any] = {"decoder": kind, "bands": bands, "source": source_digest(__name__)}
        identity["scenes"] = [checksum_of(s) for s in scenes]
        file = work / f"prior-{kind}-{cell_key(identity)}.nc"
        if not file.exists():
            cubes = [load_scene(scene, bands=bands) for scene in scenes]
            learn_prior(cubes, None, prior, extent=bands - 1).save(file)
        files |= dict.fromkeys(users, file)
    return files
