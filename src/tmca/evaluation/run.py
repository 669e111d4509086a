"""A study from its description to its tables and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from tmca.data import make_folder, write_text
from tmca.data.scene_names import short_names
from tmca.errors import SettingError
from tmca.evaluation.cells import Measurement, compute
from tmca.evaluation.grid import Grid, Measured, Settings, Timed
from tmca.evaluation.pages import page_of
from tmca.evaluation.plan import Plan
from tmca.evaluation.study import Study, named
from tmca.evaluation.tables import Row, check_counts, check_decoders, check_new, check_weights, csv_text, write_table


def run_study(
    study: Study,
    out: Path,
    work: Path,
    *,
    jobs: int = 1,
    cluster: Settings | None = None,
    overwrite: bool = False,
    progress: Timed | None = None,
    command: Sequence[str] = (),
) -> Row:
    """Measure every code, noise and decoder of a study on its test scenes.

    Args:
        study: what is compared.
        out: folder of ``NAME.json``, ``NAME.csv``, ``NAME.md`` and pictures.
        work: folder of priors, codes, trainings and finished cells; a stopped study resumes there.
        jobs: processes side by side.
        cluster: parameters of submitit, to send the cells to Slurm instead.
        overwrite: replace results.
        progress: called with (done, all, name, seconds left) after each cell.
        command: how the run was called, written into the results.

    Returns:
        What the JSON file holds.

    Raises:
        SettingError: an unknown decoder, no test scenes, or sizes that do not fit.
        OutputError: the results exist.
        DataError: a scene that is missing, altered or of no use.
        CellsFailed: some cells failed; the table of the others is written.
    """
    check_counts(jobs=jobs)
    check_decoders(study.decoders, study.decoder_labels)
    for name in study.decoders:
        check_weights(name, study.options.get(name, {}), "options.network.weights of the study")
    train, test, validation = (named(scenes) for scenes in vars(study.scenes).values())
    if not test:
        raise SettingError("--test", "no scenes", "scenes or split files")
    names = short_names([*test, *(study.own.always_measured() if study.page else ())])
    page, files = page_of(study), [out / f"{study.name}{suffix}" for suffix in (".json", ".md", ".csv")]
    check_new([*files, *page.picture_files(study, [*names.values()], out)], overwrite)
    study.own.check_study(study, [*train, *validation], test)
    make_folder(out)
    grid = Grid(partial(compute, folder=str(work)), make_folder(work), jobs, cluster, progress)
    plan = Plan(study, train, study.own.places(study, names, test), validation, work)
    measured = _measured(plan, grid, test)
    if not any("metrics" in cell for cell in measured):
        grid.failures.check()
    split = {"train": train, "test": test, "names": names, "validation": validation}
    results = page.results(study, measured, split, command)
    write_table(results, page.markdown(results, study), files[:2], overwrite)
    write_text(csv_text(results["rows"], _columns(results["rows"])), files[2], overwrite=overwrite)
    page.pictures(study, [cell for cell in measured if cell.get("seed", study.seed) == study.seed], out, overwrite)
    grid.failures.check()
    return results


def _measured(plan: Plan, grid: Grid, test: Sequence[str]) -> list[Measured]:
    """All cells that can be measured, those first that others need."""
    study, own = plan.study, plan.own
    priors = {cell["prior_kind"]: cell["prior"] for cell in grid.run(plan.priors())}
    grid.failures.check()
    searches = plan.searches(priors)
    for many in (True, False):  # a search of multiplexed codes contains that of the static ones
        grid.run([cell for cell in searches.values() if (cell.settings.get("slots", 1) > 1) == many])
    checks = grid.run(own.checks_before(study, plan.places))
    plan.places = own.informed(plan.places, checks)
    measured = grid.run([*searches.values()]) + checks
    codes = plan.files(searches, measured[: len(measured) - len(checks)])
    scenes = (plan.train, test)
    measured += _rows(grid, plan, plan.untrained(priors, codes), priors, scenes)
    trained = [cell for cells in plan.trainings(codes) for cell in grid.run(cells)]
    return measured + trained + _rows(grid, plan, plan.behind_networks(trained, priors, codes), priors, scenes)


def _rows(
    grid: Grid, plan: Plan, cells: Sequence[Measurement], priors: dict[str, str], scenes: tuple[Sequence[str], ...]
) -> list[Measured]:
    """Measurements, and checks of their codes."""
    return grid.run(cells) + grid.run(plan.own.checks_after(plan.study, cells, priors, *scenes))


def _columns(rows: Sequence[Row]) -> list[str]:
    """Names, and figures that are one number."""
    return [name for name, value in rows[0].items() if isinstance(value, str | int | float)] if rows else []
