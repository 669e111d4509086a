"""A study from its description to its tables and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from tmca.data import held_folder, make_folder
from tmca.data.scene_names import named_scenes, short_names
from tmca.errors import SettingError
from tmca.evaluation.camera import Lists
from tmca.evaluation.cells import compute
from tmca.evaluation.grid import CellsFailed, Grid, Measured, Settings
from tmca.evaluation.outcome import StudyResults
from tmca.evaluation.overview import PICTURE, is_drawn
from tmca.evaluation.page import markdown, picture_names, results, write_pictures
from tmca.evaluation.paper import paper_files, write_paper
from tmca.evaluation.plan import Plan
from tmca.evaluation.study import Study
from tmca.evaluation.tables import (
    Split,
    check_counts,
    check_decoders,
    check_resumed,
    plain_columns,
    write_table,
)
from tmca.evaluation.trained import check_trained, check_weights
from tmca.lab.decoder_files import loaded
from tmca.progress import Asked, counting


def run_study(
    study: Study,
    out: str | Path,
    work: str | Path,
    *,
    jobs: int = 1,
    cluster: Settings | None = None,
    device: str | None = None,
    overwrite: bool = False,
    progress: Asked = None,
    command: Sequence[str] = (),
) -> StudyResults:
    """Measure every code, noise and decoder of a study on its test scenes.

    Args:
        study: what is compared.
        out: folder of ``NAME.json``, ``NAME.csv``, ``NAME.md`` and pictures.
        work: folder of priors, codes, trainings and finished cells; a stopped study resumes there.
        jobs: processes side by side.
        cluster: parameters of submitit, to send the cells to Slurm instead.
        device: where snapshots are decoded and codes searched, ``"cuda"``; the processor without.
        overwrite: replace results of another study; those of this one are replaced without it.
        progress: called with (done, all, name, seconds left) after each cell; True for a bar, False for none; None for
            one that is shown after a second in a terminal or a notebook.
        command: how the run was called, written into the results.

    Returns:
        What the JSON file holds, as a dictionary that a notebook shows as a table with bars.

    Raises:
        SettingError: an unknown decoder, no test scenes, or sizes that do not fit.
        OutputError: there are results of another study, or another process works in ``work``.
        DataError: a scene that is missing, altered or of no use.
        CellsFailed: some cells failed; the table of the others is written.
    """
    out, work = Path(out), Path(work)
    check_counts(jobs=jobs)
    check_decoders(study.decoders, study.decoder_labels)
    for name in study.decoders:
        check_weights(name, study.options.get(name, {}), study.camera, "options.network.weights of the study")
    split = _split(study)
    files = [out / name for name in _file_names(study, [*split["names"].values()])]
    overwrite = check_resumed(files, overwrite, "study", study.model_dump(mode="json"))
    study.evaluation.check_study(study, [*split["train"], *split["validation"]], split["test"])
    check_trained(study, split["test"][0])
    make_folder(out)
    with held_folder(work), counting(progress, f"study {study.name}") as report:
        computing = partial(compute, folder=str(work), device=device, files=loaded(study.decoders))
        grid = Grid(computing, work, jobs, cluster, report)
        outcome, measured = _results(study, split, grid, command)
        _write(study, outcome, measured, out, overwrite)
        try:
            grid.check()
        except CellsFailed as failed:
            failed.results = outcome
            raise
    return outcome


def _split(study: Study) -> Split:
    """Scenes of a study by what they are for; SettingError where a test scene is one that is measured anyway."""
    train, test, validation = (list(named_scenes(scenes)) for scenes in vars(study.scenes).values())
    if not test:
        raise SettingError("test", "no scenes", "scenes or split files")
    always = study.evaluation.always_measured() if study.page else []
    for name in sorted({*test} & {*always}):
        raise SettingError("test", name, "other scenes", f"leave it out: {', '.join(always)} are measured anyway")
    return {"train": train, "test": test, "names": short_names([*test, *always]), "validation": validation}


def _file_names(study: Study, scenes: Sequence[str]) -> list[str]:
    """All that a study of these scenes writes."""
    files = [f"{study.name}{suffix}" for suffix in (".json", ".md", ".csv")]
    files += [f"{study.name}_{PICTURE}.png"] if is_drawn(study) else []
    return [*files, *picture_names(study, scenes), *paper_files(study, scenes)]


def _results(study: Study, split: Split, grid: Grid, command: Sequence[str]) -> tuple[StudyResults, list[Measured]]:
    """What the JSON file holds, and the cells that it is made of."""
    places = study.evaluation.places(study, split["names"], split["test"])
    plan = Plan(study, split["train"], places, split["validation"], grid.folder)
    measured = _measured(plan, grid, split["test"])
    if not any("metrics" in cell for cell in measured):
        grid.check()
    outcome = results(study, measured, split, command, places) | {"failed": grid.reasons()}
    merit = study.evaluation.metric
    return StudyResults(outcome, next(column for column in study.evaluation.columns if column[0] == merit)), measured


def _write(study: Study, outcome: StudyResults, measured: Sequence[Measured], out: Path, overwrite: bool) -> None:
    """The tables, the pictures and the page."""
    rows = outcome["rows"]
    write_table(outcome, markdown(outcome), rows, plain_columns(rows), out / study.name, overwrite)
    write_pictures(study, outcome, measured, out, overwrite)
    write_paper(study, outcome, measured, out, overwrite)


def _measured(plan: Plan, grid: Grid, test: Sequence[str]) -> list[Measured]:
    """All cells that can be measured, those first that others need."""
    priors = {cell["prior_kind"]: cell["prior"] for cell in grid.run(plan.priors())}
    grid.check()
    lists = Lists(plan.train, test, priors, plan.places)
    searches, found = plan.searches(lists), dict[str, Measured]()
    for many in (True, False):  # a search of multiplexed codes contains that of the static ones
        asked = [cell for cell in searches.values() if (cell.settings.get("slots", 1) > 1) == many]
        found |= {cell["name"]: cell for cell in grid.run(asked)}
    measured = [found[cell.name] for cell in searches.values() if cell.name in found]
    codes = plan.files(searches, measured)
    cells = plan.untrained(priors, codes)
    measured += grid.run(cells)
    trained = [cell for cells in plan.trainings(codes) for cell in grid.run(cells)]
    behind = plan.behind_networks(trained, priors, codes)
    measured += trained + grid.run(behind)
    return measured + grid.run(plan.evaluation.checks(plan.study, [*cells, *behind], lists))
