"""The table of the light-field camera: codes × noises × decoders over test scenes, in cells that are computed once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from tmca.data.light_field_scenes import NOTHING, Reading, check_asked, check_light_fields
from tmca.data.scene_names import identity_of, short_names
from tmca.errors import SettingError
from tmca.experiments.cells import Grid, Measured, Settings, Timed
from tmca.experiments.decoder_labels import prior_kind
from tmca.experiments.light_field import plan
from tmca.experiments.light_field.cells import measure
from tmca.experiments.light_field.comparison_figures import comparison_pictures, picture_files, slug
from tmca.experiments.light_field.learned import Learned
from tmca.experiments.light_field.plan import Table
from tmca.experiments.light_field.rows import DECODER_NAMES, EFFORT, NETWORKS, SHOWN_DECODERS, Sizes
from tmca.experiments.light_field.tables import markdown, results
from tmca.experiments.results import check_counts, check_decoders, check_new, write_table
from tmca.experiments.source import source_digest
from tmca.optics import view_grid


def compare_light_field(
    train: Path,
    test: Path,
    out: Path,
    work: Path,
    *,
    decoders: Sequence[str] = tuple(SHOWN_DECODERS),
    sizes: Sizes | None = None,
    effort: Mapping[str, int] = EFFORT,
    reading: Reading = NOTHING,
    test_scale: int | None = None,
    atoms: int = 1024,
    seed: int = 0,
    seeds: int = 1,
    steps: int = 300,
    jobs: int = 1,
    cluster: Settings | None = None,
    overwrite: bool = False,
    progress: Timed | None = None,
    command: Sequence[str] = (),
) -> dict[str, Any]:
    """Measure every code, noise and decoder on the light fields of ``test`` and on rendered ones of known geometry.

    Args:
        train: split file of the light fields that priors, dictionary, codes and networks learn from.
        test: split file of the measured light fields; they choose nothing.
        out: folder of ``light-field.md``, ``light-field.json`` and pictures.
        work: folder of priors, designs and finished cells; a stopped run goes on there.
        decoders: names of ``DECODER_NAMES``; the dictionary decodes a crop, where the others are measured too.
        sizes: of views, frames, codes and patches.
        effort: arguments of ``Effort``, of every search, static or not.
        reading: of light fields from files; its ``scale`` of those of ``train``.
        test_scale: the scale of those of ``test``.
        atoms: of the dictionary.
        seed: of codes, noise and trainings.
        seeds: how many of them, from ``seed`` on.
        steps: of a training.
        jobs: processes side by side.
        cluster: parameters of submitit, to send the cells to Slurm instead.
        overwrite: replace results.
        progress: told (done, all, name, seconds left) after each cell.
        command: how the run was called, kept in the results.

    Raises:
        SettingError: unknown decoder, an even number of views, or a frame smaller than the crop.
        OutputError: the results exist.
        DataError: a light field of a split is missing or altered.
        CellsFailed: some cells failed; the table of the others is written.
    """
    from tmca.data import make_folder, read_split, split_rendered_light_fields

    check_counts(seeds=seeds, steps=steps, jobs=jobs)
    check_decoders(decoders, DECODER_NAMES)
    own = sizes or Sizes()
    view_grid(own.views)  # refuses even ones before anything is made
    examples = [str(path) for path in read_split(train)]
    real = [str(path) for path in read_split(test)]
    scenes = short_names(real + sorted(split_rendered_light_fields()["test"]))
    files = [out / "light-field.json", out / "light-field.md"]
    check_new([*files, *picture_files([slug(name) for name in scenes.values()], out)], overwrite)
    measured_as = replace(reading, scale=test_scale)
    check_asked([*examples, *real], pattern=reading.pattern, lens=reading.lens)
    _check_readable(examples, real, own, reading, measured_as)
    make_folder(out)
    learned = _learn(Learned(examples, make_folder(work), own.views, reading), decoders, atoms)
    grid = Grid(partial(measure, folder=str(work)), work, jobs, cluster, progress)
    table = Table(
        _common(learned, work, own, effort), own, examples, reading, decoders, range(seed, seed + seeds), steps, work
    )
    measured = _measured(grid, table, _places(scenes, real, own, measured_as), learned)
    split: Settings = {"train": list(short_names(examples).values()), "test": list(scenes.values())}
    split["real"] = [scenes[name] for name in real]
    split |= {**vars(reading), "test_scale": test_scale, "atoms": atoms}
    found = results(measured, split, {**vars(own), "effort": dict(effort), "steps": steps}, command)
    write_table(found, markdown(found), files, overwrite)
    comparison_pictures([cell for cell in measured if cell.get("seed", seed) == seed], out, overwrite=overwrite)
    grid.failures.check()
    return found


def _common(learned: Mapping[str, str], work: Path, sizes: Sizes, effort: Mapping[str, int]) -> Settings:
    """What all cells know."""
    from tmca.data import make_folder

    common: Settings = {"source": source_digest(__name__), "views": 2 * [sizes.views]}
    common |= {"examples": learned["examples"], "designs": str(make_folder(work / "designs"))}
    return common | {"period": 2 * [sizes.period], "effort": dict(effort), "exposures": 1}


def _measured(grid: Grid, table: Table, places: Sequence[Settings], learned: Mapping[str, str]) -> list[Measured]:
    """All that can be measured.

    Raises:
        CellsFailed: nothing could.
    """
    searched = plan.searches(table)
    for slots in (True, False):  # a search of multiplexed codes contains that of the static ones
        grid.run([cell for cell in searched if (cell["search"][1] > 1) == slots])
    measured = grid.run(searched) + grid.run(plan.geometries(table, places))
    maps = {cell["path"]: cell["disparity"] for cell in measured if cell["kind"] == "geometry"}
    measured += grid.run(plan.untrained(table, places, learned, maps))
    trained = grid.run(plan.trainings(table))
    measured += trained + grid.run(plan.behind_networks(table, places, trained, maps))
    if not any("metrics" in cell for cell in measured):
        grid.failures.check()
    return measured


def _learn(learned: Learned, decoders: Sequence[str], atoms: int) -> dict[str, str]:
    """Files that the decoders need, and the examples of the searches."""
    found = {"examples": learned.examples(), "gaussian": learned.prior()}
    kinds = {prior_kind(name) for name in decoders if name not in NETWORKS}
    if "mixture" in kinds:
        found["mixture"] = learned.mixture()
    if plan.DICTIONARY in kinds:
        found[plan.DICTIONARY] = learned.dictionary(atoms)
    return found


def _check_readable(
    examples: Sequence[str], real: Sequence[str], sizes: Sizes, reading: Reading, measured_as: Reading
) -> None:
    """Refuse light fields that cannot be used, and a frame that the crop does not fit, before anything is learned."""
    for side, most in zip(sizes.crop, sizes.frame, strict=True):
        if side > most:
            found, wanted = "×".join(map(str, sizes.frame)), "×".join(map(str, sizes.crop))
            raise SettingError("frame", f"{found} pixels", f"at least {wanted}, the crop that the dictionary decodes")
    try:
        check_light_fields(examples, real, sizes.views, reading, measured_as, sizes.frame)
    except SettingError as error:
        where = "frame" if error.where == "crop" else error.where
        raise SettingError(where, error.found, error.expected, error.remedy) from error


def _places(scenes: Mapping[str, str], real: Sequence[str], sizes: Sizes, measured_as: Reading) -> list[Settings]:
    """Where is measured: on every scene, and on a crop of those from files, where the dictionary can follow."""
    whole: list[Settings] = [
        {"path": scene, "scene": name, "checksum": identity_of(scene), "crop": None, "reading": vars(measured_as),
         "size": list(sizes.frame if scene in real else sizes.rendered)}
        for scene, name in scenes.items()
    ]  # fmt: skip
    return whole + [{**place, "crop": list(sizes.crop)} for place in whole if place["path"] in real]
