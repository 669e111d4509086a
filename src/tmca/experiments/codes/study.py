"""When, why and by how much time multiplexing helps: designs over noise, full well and slots, as resumable cells."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tmca.data.scene_names import identity_of
from tmca.design import Effort
from tmca.errors import SettingError
from tmca.experiments.cells import Grid, Measured, Settings, Timed, cell_key
from tmca.experiments.codes.ablation import ablation
from tmca.experiments.codes.figures import files_of, study_figures
from tmca.experiments.codes.learned import examples_folder, mixture_file, prior_file
from tmca.experiments.codes.ranking import RANKED, correlations, networks, ranked_there, ranking
from tmca.experiments.codes.searches import design_ahead, grid, in_the_light, on_test_scene
from tmca.experiments.codes.tables import study_markdown
from tmca.experiments.design.checks import check_size
from tmca.experiments.results import check_new, repository_commit, write_table
from tmca.experiments.source import source_digest

SLOTS = (2, 4, 8, 16)
READ_NOISES = (0.0, 0.001, 0.00316, 0.01, 0.0316, 0.1, 0.316)
"""Standard deviations in snapshot units, those of the thesis' tables 5 and 6 among them."""
FULL_WELLS = (1e3, 3e3, 1e4, 3e4, 1e5)
_RANKED_NOISES, _RANKED_SIZE = ("σ = 0.001", "σ = 0.01"), (256, 256)
_NETWORK_NOISE = _RANKED_NOISES[1]
"""Where every ranked code gets a network of its own."""
_KEPT = {
    "test": ("noise", "scene", "seed", "metrics"),
    "light": ("noise", "scene", "seed", "metrics", "plain_prior", "there"),
    "ranking": ("noise", "codes", "expected", "expected_mixture", "lmmse", "unrolled", "throughput"),
    "network": ("noise", "codes", "seed", "expected", "lmmse", "unrolled", "throughput"),
    "ablation": ("noise", "rows"),
}


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
) -> dict[str, Any]:
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
        CellsFailed: some cells failed; the others are kept.
    """
    from tmca.data import make_folder

    _check_asked(train, slots, test_slots, steps, seeds, jobs)
    if min(period) < 1:
        raise SettingError("--period", f"{period[0]}×{period[1]} pixels", "1×1 or more")
    check_size({"bands": bands}, period, [*slots, test_slots], len(train))
    files = [out / "codes.json", out / "codes.md", *files_of(out)]
    check_new(files, overwrite)
    make_folder(out)
    grid = Grid(compute, work, jobs, None, progress)
    common = _common(train, work, bands, period, effort or Effort())
    measured, light = grid.run(_grid_cells(common, slots)), _light(test, bands) if test else None
    cells = _ablation_cells(common, test_slots)
    if test:
        grid.run(_design_cells(common, test_slots, seeds))
        common["prior"] = str(prior_file(train, work, bands))
        trained: Settings = {"train": list(train), "validation": list(validation)}
        trained["learned"] = [identity_of(name) for name in (*train, *validation)]
        cells += _cells_on_tests(common, test, test_slots, seeds, light)
        cells += _ranking_cells(common, test, trained, work, steps)
        cells += _network_cells(common, test, trained, work, steps, test_slots, seeds)
    measured += grid.run(cells)
    grid.failures.check()
    split = {"train": [Path(n).name for n in train], "test": [Path(n).name for n in test]}
    found = {"command": " ".join(command), "commit": repository_commit(), "effort": common["effort"], "steps": steps}
    found |= {"period": list(period), "slots": test_slots, "split": split, "mean_irradiance": light}
    found |= _found(measured)
    write_table(found, study_markdown(found), files, overwrite)
    study_figures(found, out, overwrite=overwrite)
    return found


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


def compute(cell: Settings) -> Measured:
    """One cell of any kind."""
    kinds = {"grid": grid, "test": on_test_scene, "ranking": ranking, "network": ranking}
    kinds |= {"ablation": ablation, "design": design_ahead, "light": in_the_light, "there": ranked_there}
    return kinds[cell["kind"]](cell)


def _found(measured: Sequence[Measured]) -> dict[str, Any]:
    """What the study's files hold of the cells."""
    searched = [cell for cell in measured if cell["kind"] == "grid"]
    found: dict[str, Any] = {
        "grid": [{"noise": c["noise"], "exposures": c["exposures"], **row} for c in searched for row in c["rows"]]
    }
    for kind, kept in _KEPT.items():
        found[kind] = [{key: c[key] for key in kept if key in c} for c in measured if c["kind"] == kind]
    there = {cell["noise"]: cell["expected_there"] for cell in measured if cell["kind"] == "there"}
    for row in found["ranking"]:
        row["expected_there"] = there[row["noise"]][row["codes"]]
    return found | {"rank_correlation": correlations(found["ranking"])}


def _common(train: Sequence[str], work: Path, bands: int, period: tuple[int, int], effort: Effort) -> Settings:
    """What all cells share; example scenes are learned once and kept, the given ones and with the rendered ones."""
    from tmca.data import make_folder, split_rendered

    rendered = sorted(name for name in split_rendered()["train"] if name not in train)
    learned = {
        "examples": examples_folder(train, work, bands),
        "wide": examples_folder([*train, *rendered], work, bands),
        "mixture": mixture_file(train, work, bands),
        "designs": make_folder(work / "designs"),
    }
    common = {"bands": bands, "period": list(period), "effort": vars(effort), "seed": 0, "exposures": 1}
    return {**{name: str(path) for name, path in learned.items()}, **common, "source": source_digest(__name__)}


def _light(scenes: Sequence[str], bands: int) -> float:
    """Mean irradiance of scenes, share of white, to which the examples are dimmed."""
    from tmca.data.scenes import load_scene

    return sum(float(load_scene(name, bands=bands).mean()) for name in scenes) / len(scenes)


def _grid_cells(common: Settings, slots: Sequence[int]) -> list[Settings]:
    """Every noise at equal exposure time; the corners per slot, where static codes get the time of all slots too.

    K exposures accumulated before one readout have K times the electrons, and the read noise of one: in snapshot units
    that is read noise and shot variance divided by K, the same search at less noise. The mean of K exposures that are
    read one by one would have the read noise divided by √K.
    """
    equal = [
        {**common, "kind": "grid", "name": name, "noise": name, "sensor": sensor, "slots": list(slots)}
        for name, sensor in sensors().items()
    ]
    per_slot = [
        {**common, "kind": "grid", "name": f"{name}, {k} slots' time", "noise": name, "sensor": sensor, "slots": [k],
         "exposures": k}
        for name, sensor in CORNERS.items() for k in slots
    ]  # fmt: skip
    return [*equal, *per_slot]


def _ablation_cells(common: Settings, slots: int) -> list[Settings]:
    return [
        {**common, "kind": "ablation", "name": f"ingredients · {name}", "noise": name, "sensor": sensor,
         "slots": [slots]}
        for name, sensor in CORNERS.items()
    ]  # fmt: skip


def _design_cells(common: Settings, slots: int, seeds: int) -> list[Settings]:
    """Designs of further seeds, each searched once before several cells ask for it."""
    noises = {**CORNERS, **NETWORK_CORNERS}
    return [
        {**common, "kind": "design", "name": f"designs · {name} · seed {seed}", "sensor": sensor, "slots": [slots],
         "seed": seed}
        for name, sensor in noises.items() for seed in range(1, seeds)
    ]  # fmt: skip


def _test_cells(common: Settings, test: Sequence[str], slots: int, seeds: int) -> list[Settings]:
    return [
        {**common, "kind": "test", "name": f"{Path(scene).stem} · {name} · seed {seed}", "noise": name,
         "sensor": sensor, "scene": Path(scene).stem, "path": scene, "checksum": identity_of(scene),
         "slots": [slots], "seed": seed}
        for name, sensor in CORNERS.items() for seed in range(seeds) for scene in test
    ]  # fmt: skip


def _ranking_cells(common: Settings, test: Sequence[str], trained: Settings, work: Path, steps: int) -> list[Settings]:
    """Every ranked code under read noise, by the LMMSE and, under one of the noises, by a network of its own."""
    cells = []
    for noise in _RANKED_NOISES:
        shared = _on_middles({**common, "kind": "ranking", "noise": noise, "sensor": CORNERS[noise]}, test)
        network = {**trained, "steps": steps} if noise == _NETWORK_NOISE and steps else {"steps": 0}
        for name, code in RANKED.items():
            cells.append(_with_folder({**shared, **network, "codes": name, "code": code}, work))
    return cells


def _cells_on_tests(
    common: Settings, test: Sequence[str], slots: int, seeds: int, light: float | None
) -> list[Settings]:
    """Designs on the test scenes, as they are and searched for their light, and the order of codes in that light."""
    cells = _test_cells(common, test, slots, seeds)
    dimmed = [{**cell, "kind": "light", "name": f"{cell['name']} · in its light", "light": light} for cell in cells]
    return [*cells, *dimmed, *_there_cells(common, light)]


def _there_cells(common: Settings, light: float | None) -> list[Settings]:
    """The order of the ranked codes by examples that are dimmed to the mean irradiance of the test scenes."""
    return [
        {**common, "kind": "there", "name": f"order in the light · {noise}", "noise": noise, "sensor": CORNERS[noise],
         "light": light}
        for noise in _RANKED_NOISES
    ]  # fmt: skip


def _network_cells(
    common: Settings, test: Sequence[str], trained: Settings, work: Path, steps: int, slots: int, seeds: int
) -> list[Settings]:
    """Networks of designed and random codes at the corners; none without steps."""
    cells = []
    for noise, sensor in NETWORK_CORNERS.items() if steps else ():
        shared = _on_middles({**common, **trained, "kind": "network", "noise": noise, "sensor": sensor}, test)
        for seed in range(seeds):
            for name, code in networks(slots).items():
                cells.append(_with_folder({**shared, "steps": steps, "seed": seed, "codes": name, "code": code}, work))
    return cells


def _on_middles(cell: Settings, test: Sequence[str]) -> Settings:
    return {**cell, "test": list(test), "checksums": [identity_of(n) for n in test], "size": list(_RANKED_SIZE)}


def _with_folder(cell: Settings, work: Path) -> Settings:
    name = f"{cell['kind']} · {cell['noise']} · {cell['codes']} · seed {cell['seed']}"
    return {**cell, "name": name, "folder": str(work / f"network-{cell_key(cell)}")}
