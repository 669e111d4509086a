"""Sweeps: every combination of some settings of a camera, over test scenes, in cells that are computed once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tmca.data import check_folder, held_folder, make_folder
from tmca.data.files import plain
from tmca.data.scene_names import identity_of, short_names
from tmca.decoders import decoders
from tmca.evaluation.axes import Point, Sweep
from tmca.evaluation.camera import EXAMPLES
from tmca.evaluation.cells import LearnedPrior, Measurement, Search, Training, compute
from tmca.evaluation.grid import Grid, Measured, Settings
from tmca.evaluation.study import merged
from tmca.evaluation.study_parts import TrainStage
from tmca.evaluation.tables import (
    check_counts,
    check_resumed,
    made_by,
    markdown_table,
    means,
    not_meaningful,
    repository_commit,
    write_table,
)
from tmca.lab.decoder_files import loaded
from tmca.plots.curves import sweep_figure
from tmca.plots.style import save_figure
from tmca.progress import Asked, counting

__all__ = ["Sweep", "run_sweep"]

UNITS = {
    "noise": "read noise σ, snapshot units",
    "read_noise": "read noise σ, snapshot units",
    "full_well": "full well, electrons",
    "read_noise_electrons": "read noise, electrons",
    "slots": "slots K",
    "contrast": "contrast of the texture, 1 = as the scene is",
    "contrast_ratio": "open over closed light of the aperture",
    "leakage": "light through a closed shutter, share",
    "switching": "time between patterns, share of a slot",
    "dead_time": "dead time, share of a slot",
    "delay": "delay of the shutter, slots",
    "jitter": "jitter of the shutter, slots rms",
    "rolling": "delay of the last row, slots",
    "misregistration": "misregistration along both axes, pixels",
    "magnification": "magnification of the aperture's image",
    "rotation": "rotation of the aperture's image, degrees",
    "dispersion_error": "error of the dispersion, share",
    "shear_error": "error of the shear, share",
    "blur": "blur between aperture and sensor, pixels rms",
    "height_error": "error of the heights, share",
    "wavefront_error": "aberration, metres rms of path",
    "hot_pixels": "hot pixels, share",
    "dead_pixels": "dead pixels, share",
    "motion": "motion along both axes, pixels",
}
STAGE = TrainStage(repeat=3)
"""Given scenes come thrice among the rendered ones, as in `tmca compare`."""


def run_sweep(
    sweep: Sweep,
    out: Path,
    work: Path,
    *,
    jobs: int = 1,
    cluster: Settings | None = None,
    device: str | None = None,
    overwrite: bool = False,
    progress: Asked = None,
    command: Sequence[str] = (),
) -> dict[str, Any]:
    """Measure every combination of the varied settings.

    Args:
        sweep: what is varied.
        out: the results ``OUT.json``, ``OUT.csv``, ``OUT.md`` and ``OUT.png``.
        work: folder of finished cells.
        jobs: processes side by side.
        cluster: parameters of submitit, to send the cells to Slurm instead.
        device: where snapshots are decoded and codes searched, ``"cuda"``; the processor without.
        overwrite: replace results of another sweep; those of this one are replaced without it.
        progress: called with (done, all, name, seconds left) after each cell; True for a bar, False for none; None for
            one that is shown after a second in a terminal or a notebook.
        command: how the run was called.

    Raises:
        SettingError: a combination that makes no camera.
        OutputError: there are results of another sweep, or another process works in ``work``.
        DataError: a scene that cannot be used.
        CellsFailed: some cells failed; the others stay in ``work``.
    """
    out = out.with_suffix("")
    files = [out.with_name(f"{out.name}{suffix}") for suffix in (".json", ".csv", ".md", ".png")]
    overwrite = check_resumed(files, overwrite, "sweep", plain(vars(sweep)))
    check_counts(jobs=jobs)
    points, names = sweep.points(), short_names(sweep.scenes)
    check_folder(out.parent)
    sweep.evaluation.check_scenes([*sweep.train, *sweep.validation], sweep.scenes, sweep.reading)
    windows = [_window(sweep, point) for point in points]
    make_folder(out.parent)
    with held_folder(work), counting(progress, f"sweep {out.name}") as report:
        named = loaded({str(point["decoder"]) for point in points})
        computing = partial(compute, folder=str(work), device=device, files=named)
        grid = Grid(computing, work, jobs, cluster, report)
        cells = _measurements(sweep, points, names, grid, max(windows, default=None, key=lambda side: side or 0))
        rows = _rows(points, grid.run(cells), [*names.values()])
        if not rows:
            grid.check()
        results = _record(sweep, rows, [*names.values()], command)
        _write(sweep, results, out, overwrite)
        grid.check()
    return results


def _record(
    sweep: Sweep, rows: Sequence[Mapping[str, Any]], scenes: Sequence[str], command: Sequence[str]
) -> dict[str, Any]:
    """What the JSON file holds."""
    return {
        "camera": sweep.evaluation.title, "command": " ".join(command), "commit": repository_commit(),
        "scenes": scenes, "vary": {name: [*values] for name, values in sweep.vary.items()},
        "fixed": {name: value for name, value in sweep.fixed.items() if name not in sweep.vary},
        "train": [Path(name).name for name in sweep.learned], "rows": rows, "sweep": plain(vars(sweep)),
    }  # fmt: skip


def _window(sweep: Sweep, point: Point) -> int | None:
    """Side of the windows of a camera that decodes depth from windows."""
    side: Callable[..., int] | None = getattr(sweep.evaluation, "window", None)
    settings, codes = _camera_settings(sweep, point)
    return side and side(settings, sweep.reading["crop"], sweep.reading.get("window"), codes)


def _camera_settings(sweep: Sweep, point: Point) -> tuple[Settings, str | None]:
    """Arguments of the constructor, and a file of codes where one is named."""
    camera = sweep.camera_of(point)
    settings = {name: value for name, value in camera.items() if name not in ("design", "codes", "contrast")}
    return sweep.evaluation.camera_settings(settings, sweep.reading), camera.get("codes")


def _measurements(
    sweep: Sweep, points: Sequence[Point], names: Mapping[str, str], grid: Grid, window: int | None
) -> list[Measurement]:
    """Cells behind priors, searched codes and networks, which are made first; those behind failed ones are left out."""
    cells = []
    priors, designs = _priors(sweep, points, grid, window), _designs(sweep, points, grid)
    networks = _networks(sweep, points, grid)
    for point in points:
        label, key = _label(point), str(point)
        if ("design" in point and key not in designs) or (point["decoder"] in sweep.networks and key not in networks):
            continue
        common = _common(sweep, point, designs.get(key))
        common |= {"prior": priors.get(key), "weights": networks.get(key)}
        files = (common["codes"], common["options"].get("weights"))
        program = getattr(decoders().get(point["decoder"]), "file", None)
        behind = [identity_of(str(file)) if file else None for file in files]
        behind += [] if program is None else [identity_of(program)]
        for source, scene in names.items():
            about: Settings = {"name": f"{scene}: {label}", "scene": scene, "source": source}
            cells.append(Measurement(**about, identity=[identity_of(source), *behind], **common))
    return cells


def _common(sweep: Sweep, point: Point, design: str | None) -> Settings:
    """What the cells of a combination have in common on all scenes; ``design`` is the file of searched codes."""
    settings, codes = _camera_settings(sweep, point) if design is None else ({}, design)
    window = {"window": sweep.reading.get("window")} if point["decoder"] == "likelihood" else {}
    return {
        "camera": sweep.camera, "decoder": point["decoder"], "seed": point.get("seed", 0), "settings": settings,
        "sensor": sweep.sensor_of(point), "codes": codes, "options": {**window, **sweep.options_of(point)},
        "faults": sweep.faults_of(point), "reading": sweep.reading,
        "about": {"contrast": point["contrast"]} if "contrast" in point else {},
    }  # fmt: skip


def _label(point: Point) -> str:
    return ", ".join(f"{name} = {value}" for name, value in point.items())


def _priors(sweep: Sweep, points: Sequence[Point], grid: Grid, window: int | None) -> dict[str, str]:
    """Files of the priors of given scenes that combinations need; without scenes decoders find the rendered ones'."""
    asked: dict[str, LearnedPrior] = {}
    for point in points if sweep.learned else ():
        kind = decoders()[point["decoder"]].prior_kind if point["decoder"] in decoders() else None
        if kind is not None:
            reading = {**sweep.reading, **({"window": window} if window else {})}
            settings = sweep.evaluation.prior_settings(kind, _camera_settings(sweep, point)[0], reading)
            asked[str(point)] = _learned(sweep, kind, settings)
    files = {cell["name"] + str(cell["settings"]): cell["prior"] for cell in grid.run([*asked.values()])}
    return {key: files[cell.name + str(cell.settings)] for key, cell in asked.items()}


def _learned(sweep: Sweep, kind: str, settings: Settings) -> LearnedPrior:
    return LearnedPrior(
        name=kind if kind == EXAMPLES else f"{kind} prior", camera=sweep.camera, prior_kind=kind,
        scenes=tuple(sweep.learned), identities=tuple(map(identity_of, sweep.learned)), reading=_learning(sweep),
        settings=settings,
    )  # fmt: skip


def _learning(sweep: Sweep) -> Settings:
    """How scenes that are learned from are read."""
    return {
        name: value for name, value in sweep.reading.items() if name not in ("size", "crop", "test_scale", "window")
    }


def _designs(sweep: Sweep, points: Sequence[Point], grid: Grid) -> dict[str, str]:
    """Files of the codes that are searched for the noise and slots of combinations; static ones have one slot."""
    asked = [point for point in points if "design" in point]
    if not asked:
        return {}
    (examples,) = grid.run([_learned(sweep, EXAMPLES, {})])
    cells = {}
    for point in asked:
        kind, slots = point["design"], 1 if point["design"] == "static" else int(point.get("slots", 8))
        settings = {"kind": kind, "slots": slots, "period": [16, 16], "effort": sweep.effort}
        settings |= {"examples": examples["prior"], **sweep.evaluation.searching(sweep.reading)}
        cells[str(point)] = Search(
            name=f"search · {_label({**point, 'slots': slots})}", camera=sweep.camera, code=kind, noise="",
            sensor=sweep.sensor_of(point), seed=point.get("seed", 0), settings=settings,
        )  # fmt: skip
    return _results(grid, cells, "codes")


def _networks(sweep: Sweep, points: Sequence[Point], grid: Grid) -> dict[str, str]:
    """Weights of the networks that are trained for combinations."""
    cells = {}
    for point in points:
        if point["decoder"] in sweep.networks:
            camera, network = sweep.camera_of(point), sweep.networks[point["decoder"]]
            scenes = sweep.evaluation.training_scenes(sweep.reading, sweep.train, sweep.validation, (), STAGE)
            training = {"camera": camera, "noise": [sweep.sensor_of(point)], "decoder": network.decoder, "data": scenes}
            training = merged(training, {"optimiser": {"steps": sweep.steps}}, network.training)
            identities = tuple(map(identity_of, (*sweep.train, *sweep.validation)))
            cells[str(point)] = Training(
                name=f"training for {_label(point)}", camera=sweep.camera, decoder=point["decoder"], training=training,
                reading=_learning(sweep), identities=identities, seed=camera.get("seed", 0),
            )  # fmt: skip
    return _results(grid, cells, "weights")


def _results(grid: Grid, cells: Mapping[str, Search | Training], name: str) -> dict[str, str]:
    """What cells made for each combination, once for equal ones; failed ones are left out."""
    made = {cell.key: cell for cell in cells.values()}
    files = {result["name"]: result[name] for result in grid.run([*made.values()])}
    return {point: files[cell.name] for point, cell in cells.items() if cell.name in files}


def _rows(points: Sequence[Point], measured: Sequence[Measured], scenes: Sequence[str]) -> list[dict[str, Any]]:
    """A row for every combination that was measured on all scenes."""
    rows, by_name = [], {cell["name"]: cell for cell in measured}
    for point in points:
        part = [by_name[name] for scene in scenes if (name := f"{scene}: {_label(point)}") in by_name]
        if len(part) == len(scenes):
            each = {cell["scene"]: cell["metrics"] for cell in part}
            light = sum(cell["throughput"] for cell in part) / len(part)
            rows.append({**point, **means(each.values()), "throughput": light, "scenes": each})
    return rows


def _write(sweep: Sweep, results: dict[str, Any], out: Path, overwrite: bool) -> None:
    """JSON, CSV, Markdown and picture of a sweep."""
    rows, axes, labels = results["rows"], list(results["vary"]), sweep.labels
    metrics = [column for column in sweep.evaluation.application.columns if column[0] in rows[0]]
    columns = [*((name, name, "") for name in axes), *metrics, ("throughput", "light", ".1%")]
    names = [name for name, _, _ in columns]
    write_table(results, markdown(results, labels, columns), rows, names, out, overwrite)
    drawn = [(name, heading) for name, heading, _ in metrics if name in ("psnr", "depth_mae")]
    shown = sorted(drawn, key=lambda metric: metric[0] != "psnr") or [metrics[0][:2]]
    figure = sweep_figure(rows, axes, labels, UNITS.get(axes[0], axes[0]), shown)
    save_figure(figure, out.with_name(f"{out.name}.png"), overwrite=overwrite)


def markdown(results: dict[str, Any], labels: Mapping[str, str], columns: Sequence[tuple[str, str, str]]) -> str:
    """The results for people; ``labels`` names the decoders."""
    axes = list(results["vary"])
    settings = "".join(f", {name} = {value}" for name, value in results["fixed"].items() if name != "decoder")
    decoder = results["fixed"].get("decoder")
    learned = ", ".join(results["train"]) or "the rendered training scenes"
    units = "; ".join(f"{name}: {UNITS[name]}" for name in axes if name in UNITS)
    lines = [f"# {results['camera']}: sweep over " + " and ".join(axes), ""]
    lines += [made_by(results), ""]
    said = f"decoder {labels[decoder]}" if decoder else "decoders side by side"
    said = f"{said[0].upper()}{said[1:]}{settings}; prior and networks learned from {learned}."
    lines += [f"{said} Means over {', '.join(results['scenes'])}.{f' {units}.' if units else ''}", ""]
    lines += [line for text in not_meaningful(results["rows"]) for line in (text, "")]
    return "\n".join([*lines, markdown_table(results["rows"], columns)])
