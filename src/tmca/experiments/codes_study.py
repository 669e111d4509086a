"""When, why and by how much time multiplexing helps: designs over noise, full well and slots, as resumable cells."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tmca.design import Effort, design_model, designable, learn_examples
from tmca.errors import SettingError
from tmca.experiments.cells import Failures, Progress, Settings, cell_key, run_cells, source_digest
from tmca.experiments.codes_cells import SLOTS, compute, save_examples
from tmca.experiments.codes_ranking import RANKED, correlations
from tmca.experiments.codes_tables import files_of, study_figures, study_markdown
from tmca.experiments.results import check_new, repository_commit
from tmca.experiments.scenes import identity_of, load_scene

READ_NOISES = (0.0, 0.001, 0.00316, 0.01, 0.0316, 0.1, 0.316)
"""Standard deviations in snapshot units, those of the thesis' tables 5 and 6 among them."""
FULL_WELLS = (1e3, 3e3, 1e4, 3e4, 1e5)
CORNERS: dict[str, dict[str, float]] = {
    "σ = 0.001": {"read_noise": 0.001},
    "σ = 0.01": {"read_noise": 0.01},
    "10 000 e⁻ full well, 3 e⁻ read noise": {"full_well": 1e4, "read_noise_electrons": 3.0},
}


_RANKED_NOISES, _RANKED_SIZE = ("σ = 0.001", "σ = 0.01"), (256, 256)

_RANKED_KEYS = ("noise", "codes", "expected", "lmmse", "unrolled", "throughput")


def sensors() -> dict[str, dict[str, float]]:
    """Noises of the grid by name; read noise in electrons grows with the root of the full well, 3 e⁻ at 10 000 e⁻."""
    found = {f"σ = {value:g}": {"read_noise": value} for value in READ_NOISES}
    for well in FULL_WELLS:
        electrons = round(3 * (well / 1e4) ** 0.5, 2)
        found[f"{well:g} e⁻, {electrons:g} e⁻"] = {"full_well": well, "read_noise_electrons": electrons}
    return found


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
    progress: Progress | None = None,
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
        progress: told after each cell.
        command: how the study was called.

    Raises:
        SettingError: too few scenes, or slots below 2.
        OutputError: results exist.
        CellsFailed: some cells failed; the others are kept.
    """
    from tmca.data import make_folder, write_json, write_text

    if len(train) < 2 or min(slots, default=0) < 2 or seeds < 1 or jobs < 1:
        given = f"{len(train)} scenes, slots {list(slots)}, {seeds} seeds, {jobs} jobs"
        raise SettingError("design study", given, "two scenes or more, slots ≥ 2, seeds and jobs ≥ 1")
    files = [out / "codes.json", out / "codes.md", *files_of(out)]
    check_new(files, overwrite)
    make_folder(out)
    common = _common(train, make_folder(work), bands, period, effort or Effort(sweeps=0))
    failures = Failures(work)
    prior = _prior(common, train, work) if test else None
    cells = [*_grid_cells(common, slots), *_test_cells(common, test, prior, test_slots, seeds)]
    cells += _ranking_cells(common, train, test, validation, prior, work, steps)
    measured = run_cells(cells, compute, work, jobs=jobs, progress=progress, failures=failures)
    failures.check()
    found = {
        "command": " ".join(command), "commit": repository_commit(), "effort": common["effort"],
        "period": list(period), "split": {"train": [Path(n).name for n in train], "test": [Path(n).name for n in test]},
        "grid": [{"noise": cell["noise"], "exposures": cell["exposures"], **row}
                 for cell in measured if cell["kind"] == "grid" for row in cell["rows"]],
        "test": [{key: cell[key] for key in ("noise", "scene", "seed", "metrics")}
                 for cell in measured if cell["kind"] == "test"],
        "ranking": [{key: cell[key] for key in _RANKED_KEYS if key in cell}
                    for cell in measured if cell["kind"] == "ranking"],
        "rank_correlation": correlations([cell for cell in measured if cell["kind"] == "ranking"]),
    }  # fmt: skip
    write_json(found, files[0], overwrite=overwrite)
    write_text(study_markdown(found), files[1], overwrite=overwrite)
    study_figures(found, out, overwrite=overwrite)
    return found


def _common(train: Sequence[str], work: Path, bands: int, period: tuple[int, int], effort: Effort) -> Settings:
    """What all cells share; example scenes are learned once and kept."""
    from tmca.data import make_folder

    identity = {"scenes": [identity_of(name) or name for name in train], "bands": bands, "source": source_digest()}
    folder = work / f"examples-{cell_key(identity)}"
    if not (folder / "examples.json").exists():
        cubes = {Path(name).stem: load_scene(name, bands=bands) for name in train}
        wavelengths = next(iter(cubes.values()))["wavelength"].values.tolist()
        model = design_model(designable("static", 1, (8, 8), bands=wavelengths).taps())
        save_examples(learn_examples(_tensors(cubes), model, wavelengths), make_folder(folder))
    return {
        "examples": str(folder), "bands": bands, "period": list(period), "effort": vars(effort), "seed": 0,
        "exposures": 1, "source": source_digest(),
    }  # fmt: skip


def _tensors(cubes: dict[str, Any]) -> dict[str, Any]:
    import torch

    return {name: torch.from_numpy(cube.values.copy()) for name, cube in cubes.items()}


def _grid_cells(common: Settings, slots: Sequence[int]) -> list[Settings]:
    """Every noise at equal exposure time; the corners per slot, where static codes get the time of all slots too.

    The mean of K exposures has the noise of one divided by K, and K times the electrons: the same search at less noise.
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


def _prior(common: Settings, train: Sequence[str], work: Path) -> Path:
    """The prior of the decoder, learned once and kept."""
    from tmca.priors import learn_prior

    file = work / f"prior-{cell_key({'examples': common['examples'], 'source': common['source']})}.nc"
    if not file.exists():
        cubes = [load_scene(name, bands=common["bands"]) for name in train]
        learn_prior(cubes, spread=common["bands"] - 1).save(file)
    return file


def _test_cells(common: Settings, test: Sequence[str], prior: Path | None, slots: int, seeds: int) -> list[Settings]:
    return [
        {**common, "kind": "test", "name": f"{Path(scene).stem} · {name} · seed {seed}", "noise": name,
         "sensor": sensor, "scene": Path(scene).stem, "path": scene, "checksum": identity_of(scene),
         "slots": [slots], "prior": str(prior), "seed": seed}
        for name, sensor in CORNERS.items() for seed in range(seeds) for scene in test
    ]  # fmt: skip


def _ranking_cells(
    common: Settings,
    train: Sequence[str],
    test: Sequence[str],
    validation: Sequence[str],
    prior: Path | None,
    work: Path,
    steps: int,
) -> list[Settings]:
    """Every ranked code under read noise: the middle of the test scenes by the LMMSE, and by a network of its own."""
    shared = {**common, "kind": "ranking", "test": list(test), "checksums": [identity_of(name) for name in test]}
    shared |= {"prior": str(prior), "steps": steps, "size": list(_RANKED_SIZE)}
    shared |= {"train": list(train), "validation": list(validation)} if steps else {}
    cells = []
    for noise in _RANKED_NOISES if test else ():
        for name, code in RANKED.items():
            own = {**shared, "noise": noise, "sensor": CORNERS[noise], "codes": name, "code": code}
            cells.append(
                {**own, "name": f"ranking · {noise} · {name}", "folder": str(work / f"ranked-{cell_key(own)}")}
            )
    return cells
