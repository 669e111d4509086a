"""When, why and by how much time multiplexing helps: designs over noise, full well and slots, as resumable cells."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, cast

from studies.codes.ablation import ablation
from studies.codes.figures import files_of, study_figures
from studies.codes.learned import examples_folder, mixture_file, prior_file
from studies.codes.ranking import RANKED, correlations, networks, ranking
from studies.codes.records import Cell, RankedRow, Results
from studies.codes.searches import design_ahead, grid, in_the_light, on_test_scene
from studies.codes.tables import study_markdown
from studies.grid import Grid, Settings, Timed, cell_key, check_new, repository_commit, source
from studies.tables import write_results
from tmca.data import identity_of, load_scene, make_folder, split_rendered
from tmca.design import Effort, check_size
from tmca.errors import SettingError

SLOTS = (2, 4, 8, 16)
READ_NOISES = (0.0, 0.001, 0.00316, 0.01, 0.0316, 0.1, 0.316)
"""Standard deviations in snapshot units, those of the thesis' tables 5 and 6 among them."""
FULL_WELLS = (1e3, 3e3, 1e4, 3e4, 1e5)
_RANKED_NOISES = ("σ = 0.001", "σ = 0.01")
_NETWORK_NOISE = _RANKED_NOISES[1]
"""Where every ranked code gets a network."""
KINDS: dict[str, Callable[[Cell], Sequence[Mapping[str, Any]]]] = {
    "grid": grid, "test": on_test_scene, "ranking": ranking, "network": ranking, "ablation": ablation,
    "design": design_ahead, "light": in_the_light,
}  # fmt: skip
"""What computes the rows of a cell."""


def sensors() -> dict[str, dict[str, float]]:
    """Noises of the grid by name; read noise in electrons grows with the root of the full well, 3 e⁻ at 10 000 e⁻."""
    found = {f"σ = {value:g}": {"read_noise": value} for value in READ_NOISES}
    for well in FULL_WELLS:
        electrons = round(3 * (well / 1e4) ** 0.5, 2)
        name = f"{well:,.0f} e⁻ full well, {electrons:g} e⁻ read noise".replace(",", " ", 1)
        found[name] = {"full_well": well, "read_noise_electrons": electrons}
    return found


_CORNERS = ("σ = 0", "σ = 0.001", "σ = 0.01", "10 000 e⁻ full well, 3 e⁻ read noise")
CORNERS = {name: sensors()[name] for name in _CORNERS[1:]}
NETWORK_CORNERS = {name: sensors()[name] for name in _CORNERS if name != "σ = 0.001"}
"""Where networks are trained."""


def study_codes(
    train: Sequence[str],
    test: Sequence[str],
    out: Path,
    work: Path,
    *,
    bands: int = 12,
    slots: Sequence[int] = SLOTS,
    period: tuple[int, int] = (16, 24),
    effort: Effort | None = None,
    test_slots: int = 8,
    validation: Sequence[str] = (),
    steps: int = 0,
    seeds: int = 1,
    jobs: int = 1,
    overwrite: bool = False,
    progress: Timed | None = None,
    command: Sequence[str] = (),
) -> Results:
    """Search codes under every noise of the grid, and measure designs on test scenes in its corners.

    Args:
        train: scenes that codes are designed for, two at least.
        test: scenes that are measured; they choose nothing.
        out: folder of ``codes.md``, ``codes.json`` and pictures.
        work: folder of finished cells; a stopped study goes on there.
        bands: number of bands from 400 to 700 nm.
        slots: numbers of slots K above 1.
        period: (rows, columns) of the tile, pixels.
        effort: of every search, static or not.
        test_slots: K of the designs on the test scenes.
        validation: scenes that choose a network's best step.
        steps: of an unrolled network for each code that is ranked; none are trained with 0.
        seeds: random codes, noise and searches of the test scenes.
        jobs: processes side by side.
        overwrite: replace results.
        progress: told (done, all, name, seconds left) after each cell.
        command: how the study was called.

    Raises:
        SettingError: too few scenes, slots below 2, or more than fits the memory.
        OutputError: results exist.
        CellsFailed: some cells failed; the others are stored.
    """
    _check_asked(train, slots, test_slots, steps, seeds, jobs)
    if min(period) < 1:
        raise SettingError("--period", f"{period[0]}×{period[1]} pixels", "1×1 or more")
    check_size({"bands": bands}, period, [*slots, test_slots], len(train))
    check_new([out / "codes.json", out / "codes.md", *files_of(out)], overwrite)
    make_folder(out)
    engine, light = Grid(compute, work, jobs, None, progress), _light(test, bands) if test else None
    first = _first_cell(train, work, bands, period, effort or Effort())
    measured = _run(engine, _grid_cells(first, slots))
    cells = _ablation_cells(first, test_slots)
    if test:
        _run(engine, _design_cells(first, test_slots, seeds))
        first = replace(first, prior=str(prior_file(train, work, bands)), light=light)
        cells += _test_cells(first, test, test_slots, seeds)
        ranked = replace(first, **_ranked_on(train, validation, test), steps=steps)
        cells += _ranking_cells(ranked, work) + _network_cells(ranked, work, test_slots, seeds)
    measured += _run(engine, cells)
    engine.check()
    split = {name: [Path(n).name for n in names] for name, names in (("train", train), ("test", test))}
    rows = {kind: [row for cell in measured if cell["kind"] == kind for row in cell["rows"]] for kind in KINDS}
    rows.pop("design")
    found = {
        "command": " ".join(command), "commit": repository_commit(), "effort": first.effort, "steps": steps,
        "period": list(period), "slots": test_slots, "mean_irradiance": light, "split": split, **rows,
        "rank_correlation": correlations(cast(list[RankedRow], rows["ranking"])),
    }  # fmt: skip
    results = cast(Results, found)
    write_results(results, study_markdown(results), out / "codes.json", overwrite)
    study_figures(results, out, overwrite=overwrite)
    return results


def _check_asked(
    train: Sequence[str], slots: Sequence[int], test_slots: int, steps: int, seeds: int, jobs: int
) -> None:
    if len(train) < 2 or min(slots, default=0) < 2 or seeds < 1 or jobs < 1:
        given = f"{len(train)} scenes, slots {list(slots)}, {seeds} seeds, {jobs} jobs"
        raise SettingError("design study", given, "two scenes or more, slots ≥ 2, seeds and jobs ≥ 1")
    if len({Path(name).stem for name in train}) < len(train):
        raise SettingError("--train", "two scenes of one name", "a name for each", "rename a file")
    if test_slots < 2 or steps < 0:
        raise SettingError("design study", f"{test_slots} test slots, {steps} steps", "slots ≥ 2, steps ≥ 0")


def _run(engine: Grid, cells: Sequence[Cell]) -> list[dict[str, Any]]:
    return engine.run([asdict(cell) for cell in cells])


def compute(settings: Settings) -> dict[str, Any]:
    """The rows of one cell of any kind."""
    cell = Cell.of(settings)
    return {"rows": list(KINDS[cell.kind](cell))}


def _first_cell(train: Sequence[str], work: Path, bands: int, period: tuple[int, int], effort: Effort) -> Cell:
    """What all cells share; example scenes are learned once and stored, the given ones and with the rendered ones."""
    rendered = sorted(name for name in split_rendered()["train"] if name not in train)
    return Cell(
        examples=str(examples_folder(train, work, bands)),
        wide=str(examples_folder([*train, *rendered], work, bands)),
        mixture=str(mixture_file(train, work, bands)),
        designs=str(make_folder(work / "designs")),
        bands=bands,
        period=period,
        effort=dict(vars(effort)),
        source=source(
            *(f"codes/{name}.py" for name in ("ablation", "ranking", "records", "searches")),
        ),
    )


def _light(scenes: Sequence[str], bands: int) -> float:
    """Mean irradiance of scenes, share of white, to which the examples are dimmed."""
    return sum(float(load_scene(name, bands=bands).mean()) for name in scenes) / len(scenes)


def _grid_cells(first: Cell, slots: Sequence[int]) -> list[Cell]:
    """Every noise at equal exposure time; the corners per slot, where static codes get the time of all slots too.

    K exposures accumulated before one readout have K times the electrons, and the read noise of one: in snapshot units
    that is read noise and shot variance divided by K, the same search at less noise. The mean of K exposures that are
    read one by one would have the read noise divided by √K.
    """
    base, chosen = replace(first, kind="grid"), tuple(slots)
    equal = [replace(base, name=name, noise=name, sensor=s, slots=chosen) for name, s in sensors().items()]
    per_slot = [
        replace(base, name=f"{name}, {k} slots' time", noise=name, sensor=s, slots=(k,), exposures=k)
        for name, s in CORNERS.items() for k in slots
    ]  # fmt: skip
    return [*equal, *per_slot]


def _ablation_cells(first: Cell, slots: int) -> list[Cell]:
    base = replace(first, kind="ablation", slots=(slots,))
    return [replace(base, name=f"ingredients · {name}", noise=name, sensor=s) for name, s in CORNERS.items()]


def _design_cells(first: Cell, slots: int, seeds: int) -> list[Cell]:
    """Designs of further seeds, each searched once before several cells ask for it."""
    base = replace(first, kind="design", slots=(slots,))
    return [
        replace(base, name=f"designs · {name} · seed {seed}", sensor=s, seed=seed)
        for name, s in {**CORNERS, **NETWORK_CORNERS}.items() for seed in range(1, seeds)
    ]  # fmt: skip


def _test_cells(first: Cell, test: Sequence[str], slots: int, seeds: int) -> list[Cell]:
    """Designs on the test scenes, as they are and searched for their light."""
    base = replace(first, kind="test", slots=(slots,))
    cells = [
        replace(base, name=f"{Path(path).stem} · {name} · seed {seed}", noise=name, sensor=s, seed=seed, test=(path,),
                checksums=(identity_of(path),))
        for name, s in CORNERS.items() for seed in range(seeds) for path in test
    ]  # fmt: skip
    return [*cells, *(replace(cell, kind="light", name=f"{cell.name} · in its light") for cell in cells)]


def _ranked_on(train: Sequence[str], validation: Sequence[str], test: Sequence[str]) -> dict[str, Any]:
    """Scenes of the cells that rank codes."""
    scenes = {"train": tuple(train), "validation": tuple(validation), "test": tuple(test)}
    return {**scenes, "checksums": tuple(identity_of(path) for paths in scenes.values() for path in paths)}


def _ranking_cells(first: Cell, work: Path) -> list[Cell]:
    """Every ranked code under read noise, by the LMMSE and, under one of the noises, by a network of its codes."""
    return [
        _ranked_cell(replace(first, kind="ranking", noise=noise, sensor=CORNERS[noise], codes=name, code=code,
                             steps=first.steps if noise == _NETWORK_NOISE else 0), work)
        for noise in _RANKED_NOISES for name, code in RANKED.items()
    ]  # fmt: skip


def _network_cells(first: Cell, work: Path, slots: int, seeds: int) -> list[Cell]:
    """Networks of designed and random codes at the corners; none without steps."""
    return [
        _ranked_cell(replace(first, kind="network", noise=noise, sensor=s, seed=seed, codes=name, code=code), work)
        for noise, s in NETWORK_CORNERS.items() if first.steps
        for seed in range(seeds) for name, code in networks(slots).items()
    ]  # fmt: skip


def _ranked_cell(cell: Cell, work: Path) -> Cell:
    named = replace(cell, name=f"{cell.kind} · {cell.noise} · {cell.codes} · seed {cell.seed}")
    return replace(named, folder=str(work / f"network-{cell_key(asdict(named))}"))
