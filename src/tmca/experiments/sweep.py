"""Sweeps: every combination of some settings of a camera, over test scenes, in cells that are computed once.

The same for every camera; ``sweep_spectral`` and ``sweep_light_field`` say what they vary.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import isfinite
from pathlib import Path
from typing import Any

from tmca.cameras import LIMITS, PAIRS, PARTS, Hardware
from tmca.data.scene_names import identity_of, short_names
from tmca.decoders import decoders_for, make_decoder, settings_of
from tmca.decoders.settings import checked_settings
from tmca.errors import SettingError
from tmca.experiments.cells import Grid, Measured, Settings, Timed, cell_key
from tmca.experiments.results import check_new, mean_over_scenes, repository_commit, write_table
from tmca.experiments.source import source_digest
from tmca.experiments.sweep_tables import UNITS, csv_text, markdown
from tmca.plots.curves import sweep_figure
from tmca.plots.style import save_figure

SENSOR = {"noise": "read_noise", "read_noise": "read_noise", "full_well": "full_well",
          "read_noise_electrons": "read_noise_electrons", "bits": "bits"}  # fmt: skip
WHOLE = ("slots", "bits", "period", "planes", "seed")

SETTING = "decoder."
"""Before the name of a setting of a decoder."""

Values = Mapping[str, Sequence[Any]]


@dataclass(frozen=True)
class Swept:
    """What a sweep asks of a camera.

    Args:
        title: what tables say of it.
        camera: its settings that can be varied, beside the sensor's, ``decoder`` and ``seed``.
        words: those that are words.
        check: refuses settings (camera, sensor) that make no camera.
        decoders: names of decoders as tables show them.
        networks: those that are trained at every combination.
        application: name of the camera, which says what faults its bench can have.
        measure, train: compute a cell; module-level functions.
    """

    title: str
    camera: tuple[str, ...]
    words: tuple[str, ...]
    check: Callable[[dict[str, Any], dict[str, Any]], Any]
    decoders: Mapping[str, str]
    networks: tuple[str, ...]
    application: str
    measure: Callable[[Settings], Measured]
    train: Callable[[Settings], Measured]

    @property
    def axes(self) -> tuple[str, ...]:
        """Everything that can be varied."""
        return (*SENSOR, *self.camera, "decoder", "seed", *self.settings, *self.faults)

    @property
    def settings(self) -> tuple[str, ...]:
        """Settings of decoders, such as ``decoder.tv_weight``."""
        known = decoders_for(self.application).values()
        return tuple(sorted({f"{SETTING}{one.name}" for cls in known for one in settings_of(cls)}))

    @property
    def faults(self) -> tuple[str, ...]:
        """Faults of the bench, of which decoders are not told."""
        return tuple(name for name in LIMITS if name not in PARTS[self.application])


def sweep(
    swept: Swept,
    vary: Values,
    scenes: Sequence[str],
    out: Path,
    work: Path,
    data: Settings,
    *,
    check: Callable[[], object] | None = None,
    prepare: Callable[[Sequence[dict[str, Any]]], Settings] | None = None,
    fixed: Mapping[str, Any] | None = None,
    decoder: str = "lmmse",
    train: Sequence[str] = (),
    validation: Sequence[str] = (),
    steps: int = 300,
    jobs: int = 1,
    cluster: Settings | None = None,
    overwrite: bool = False,
    progress: Timed | None = None,
    command: Sequence[str] = (),
) -> dict[str, Any]:
    """Measure every combination of the varied settings.

    Args:
        swept: the camera.
        vary: setting → its values; names of ``swept.axes`` (``noise`` is the read noise).
        scenes: test scenes.
        out: the results ``OUT.json``, ``OUT.csv``, ``OUT.md`` and ``OUT.png``.
        work: folder of finished cells.
        data: how scenes are read.
        check: opens every scene as cells will; called once the combinations are found possible, before anything is
            made.
        prepare: from the combinations to further settings of all cells.
        fixed: settings of all cells.
        decoder: name of ``swept.decoders``, unless it is varied; networks are trained at every combination.
        train: scenes of priors and networks; the rendered training scenes' prior if empty.
        validation: scenes that choose a network's best step; some training scenes are set aside without any.
        steps: of each training.
        jobs: processes side by side.
        cluster: parameters of submitit, to send the cells to Slurm instead.
        overwrite: replace results.
        progress: told (done, all, name, seconds left) after each cell.
        command: how the run was called.

    Raises:
        SettingError: an unknown or empty axis, or a combination that makes no camera.
        OutputError: results exist.
        DataError: a scene that cannot be used.
        CellsFailed: some cells failed; the others are kept.
    """
    from tmca.data import check_folder, make_folder

    files = [out.with_suffix(suffix) for suffix in (".json", ".csv", ".md", ".png")]
    check_new(files, overwrite)
    if steps < 1 or jobs < 1:
        raise SettingError("--steps, --jobs", f"{steps}, {jobs}", "at least 1")
    vary = converted(swept, vary, "--vary")
    kept = {"decoder": decoder, **converted(swept, {name: [value] for name, value in (fixed or {}).items()}, "--set")}
    kept = {name: values[0] if isinstance(values, list) else values for name, values in kept.items()}
    points = combinations(swept, vary, kept)
    names = short_names(scenes)
    check_folder(out.parent)
    if check:
        check()
    data = {**data, "train": list(train), "validation": list(validation), "steps": steps}
    data |= prepare(points) if prepare else {}
    make_folder(out.parent)
    cells = [_cell(swept, point, scene, name, data, work) for point in points for scene, name in names.items()]
    grid = Grid(swept.measure, work, jobs, cluster, progress)
    rows = _rows(points, _measured(swept, cells, grid), list(names.values()))
    if not rows:
        grid.failures.check()
    found = {
        "camera": swept.title, "command": " ".join(command), "commit": repository_commit(),
        "scenes": list(names.values()), "vary": {name: list(values) for name, values in vary.items()},
        "fixed": {name: value for name, value in kept.items() if name not in vary},
        "train": [Path(name).name for name in train], "rows": rows,
    }  # fmt: skip
    _write(swept, found, files, overwrite)
    grid.failures.check()
    return found


def _measured(swept: Swept, cells: Sequence[Settings], grid: Grid) -> list[Measured]:
    """All cells that can be measured, behind networks that are trained first."""
    trainings = {cell["folder"]: cell for cell in cells if cell["decoder"] in swept.networks}
    shared = {"path": "", "scene": "", "checksum": None}
    grid.run([{**cell, "name": f"training for {cell['name']}", **shared} for cell in trainings.values()], swept.train)
    broken = {name.removeprefix("training for ").partition(": ")[2] for name, _ in grid.failures.met}
    return grid.run([cell for cell in cells if cell["name"].partition(": ")[2] not in broken])


def _write(swept: Swept, found: dict[str, Any], files: Sequence[Path], overwrite: bool) -> None:
    """JSON, CSV, Markdown and picture of a sweep."""
    from tmca.data import write_text

    rows, axes = found["rows"], list(found["vary"])
    write_table(found, markdown(found, axes, swept.decoders), (files[0], files[2]), overwrite)
    write_text(csv_text(rows, axes), files[1], overwrite=overwrite)
    save_figure(sweep_figure(rows, axes, swept.decoders, UNITS.get(axes[0], axes[0])), files[3], overwrite=overwrite)


def converted(swept: Swept, settings: Values, option: str) -> dict[str, list[Any]]:
    """Values of the type that each setting has: whole numbers, numbers or words.

    Raises:
        SettingError: a name that is none of ``swept.axes``, two names for one thing, or a value of another type.
    """
    for name in settings:
        if name not in swept.axes:
            raise SettingError(option, name, f"one of {', '.join(swept.axes)}")
    if {"noise", "read_noise"} <= set(settings):
        raise SettingError(option, "noise and read_noise", "one of them", "they are the same")
    return {name: [_converted(swept, name, value, option) for value in values] for name, values in settings.items()}


def _converted(swept: Swept, name: str, value: Any, option: str) -> Any:
    if name in swept.words or name.startswith(SETTING):
        return str(value)
    if name in PAIRS and ":" in str(value):
        Hardware.of({name: value})
        return str(value)
    try:
        number = float(value)
        if name in WHOLE and not number.is_integer():
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        wanted = "whole numbers" if name in WHOLE else "numbers"
        raise SettingError(option, f"{name} = {value}", wanted) from None
    if not isfinite(number):
        raise SettingError(option, f"{name} = {value}", "finite numbers")
    return int(number) if name in WHOLE else number


def combinations(swept: Swept, vary: Values, fixed: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Every combination of the varied settings, with the fixed ones, each of which makes a camera.

    Raises:
        SettingError: the first that does not.
    """
    if not vary:
        raise SettingError("--vary", "nothing", "at least one, such as slots=2,4,8")
    both = sorted(set(vary) & set(fixed) - {"decoder"})
    if both:
        raise SettingError("--set", both[0], "a setting that is not varied", "leave one of the two out")
    for name, values in vary.items():
        if not values or len(set(map(str, values))) < len(values):
            raise SettingError("--vary", f"{name} = {list(values)}", "different values, separated by commas")
    points = [{**fixed, **dict(zip(vary, values, strict=True))} for values in product(*vary.values())]
    for point in points:
        if point["decoder"] not in swept.decoders:
            raise SettingError("decoder", repr(point["decoder"]), f"one of {', '.join(swept.decoders)}")
        swept.check(*parts(swept, point))
        faults_of(swept, point)
        decoder_settings(swept, point)
    return points


def parts(swept: Swept, point: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arguments of the camera and of the sensor in a combination."""
    camera = {name: value for name, value in point.items() if name in swept.camera or name == "seed"}
    return camera, {SENSOR[name]: value for name, value in point.items() if name in SENSOR}


def decoder_settings(swept: Swept, point: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of the decoder in a combination.

    Raises:
        SettingError: those that it does not have, or that are of another type.
    """
    texts = {name.removeprefix(SETTING): value for name, value in point.items() if name.startswith(SETTING)}
    known = decoders_for(swept.application)
    if not texts:
        return {}
    if point["decoder"] not in known:
        raise SettingError(f"{SETTING}{next(iter(texts))}", f"a setting of {point['decoder']}", "none of a network")
    settings = checked_settings(known[point["decoder"]], texts, texts=True)
    make_decoder(point["decoder"], swept.application, settings)
    return settings


def faults_of(swept: Swept, point: Mapping[str, Any]) -> dict[str, Any]:
    """Faults of the bench in a combination.

    Raises:
        SettingError: impossible ones.
    """
    asked = {name: value for name, value in point.items() if name in swept.faults}
    return Hardware.of(asked).faults()


def _cell(swept: Swept, point: dict[str, Any], path: str, scene: str, data: dict[str, Any], work: Path) -> Settings:
    camera, sensor = parts(swept, point)
    shown = ", ".join(f"{name} = {value}" for name, value in point.items())
    cell: Settings = {"name": f"{scene}: {shown}", "path": path, "scene": scene, "checksum": identity_of(path)}
    common = {name: value for name, value in data.items() if name not in ("validation", "steps")}
    common |= {"camera": camera, "sensor": sensor, "decoder": point["decoder"]}
    faults = faults_of(swept, point)
    cell |= {"faults": faults} if faults else {}
    settings = decoder_settings(swept, point)
    common |= {"settings": settings} if settings else {}
    common["source"] = source_digest(__name__, swept.measure.__module__, swept.train.__module__)
    common["checksums"] = [identity_of(name) for name in (*data["train"], *data["validation"])]
    if point["decoder"] in swept.networks:
        common |= {"steps": data["steps"], "validation": data["validation"]}
    return cell | common | {"folder": str(work / f"point-{cell_key(common)}")}


def _rows(
    points: Sequence[dict[str, Any]], measured: Sequence[Measured], scenes: Sequence[str]
) -> list[dict[str, Any]]:
    """A row for every combination that was measured on all scenes."""
    rows, found = [], {cell["name"]: cell for cell in measured}
    for point in points:
        shown = ", ".join(f"{name} = {value}" for name, value in point.items())
        part = [found[f"{scene}: {shown}"] for scene in scenes if f"{scene}: {shown}" in found]
        if len(part) == len(scenes):
            each = {cell["scene"]: cell["metrics"] for cell in part}
            light = sum(cell["throughput"] for cell in part) / len(part)
            rows.append({**point, **mean_over_scenes(each), "throughput": light, "scenes": each})
    return rows
