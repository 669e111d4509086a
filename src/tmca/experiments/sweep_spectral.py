"""Sweeps of the spectral camera: every combination of some settings, over test scenes, in cells computed once."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.cameras import SpectralCamera
from tmca.errors import OutputError, SettingError
from tmca.experiments.cells import Measured, Progress, Settings, cell_key, run_cells, source_digest
from tmca.experiments.figures import save_figure
from tmca.experiments.results import METRICS, markdown_table, mean_over_scenes, repository_commit
from tmca.experiments.spectral_cells import sweep_cell, sweep_training
from tmca.experiments.spectral_rows import DECODER_NAMES, NETWORKS
from tmca.sensor import Sensor

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SENSOR = {"noise": "read_noise", "read_noise": "read_noise", "full_well": "full_well",
          "read_noise_electrons": "read_noise_electrons", "bits": "bits"}  # fmt: skip
CAMERA = ("slots", "aperture", "shutter", "exposure", "dispersion", "disperser", "transmittance", "duty", "period")
AXES = (*SENSOR, *CAMERA, "decoder", "seed")

Values = Mapping[str, Sequence[Any]]


def sweep_spectral(
    vary: Values,
    scenes: Sequence[str],
    out: Path,
    work: Path,
    *,
    fixed: Mapping[str, Any] | None = None,
    decoder: str = "lmmse",
    train: Sequence[str] = (),
    validation: Sequence[str] = (),
    steps: int = 300,
    bands: int = 12,
    size: tuple[int, int] | None = None,
    jobs: int = 1,
    cluster: Settings | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
    command: Sequence[str] = (),
) -> dict[str, Any]:
    """Measure every combination of the varied settings.

    Args:
        vary: setting → its values; names of ``AXES`` (``noise`` is the read noise).
        scenes: test scenes, names that ``load_scene`` understands.
        out: the results ``OUT.json``, ``OUT.csv``, ``OUT.md`` and ``OUT.png``.
        work: folder of finished cells.
        fixed: settings of all cells.
        decoder: name of ``DECODER_NAMES``, unless it is varied; networks are trained at every combination.
        train: scenes of priors and networks; the rendered training scenes' prior if empty.
        validation: scenes that choose a network's best step; some training scenes are set aside without any.
        steps: of each training.
        bands: from 400 to 700 nm.
        size: (H, W) middle of the scenes.
        jobs: processes side by side.
        cluster: parameters of submitit, to send the cells to Slurm instead.
        overwrite: replace results.
        progress: told after each cell.
        command: how the run was called.

    Raises:
        SettingError: an unknown or empty axis, or a combination that makes no camera.
        OutputError: results exist.
        CellsFailed: some cells failed; the others are kept.
    """
    from tmca.data import make_folder, write_json, write_text

    files = [out.with_suffix(suffix) for suffix in (".json", ".csv", ".md", ".png")]
    for file in files:
        if file.exists() and not overwrite:
            raise OutputError(file, "a file of earlier results", "none", "pass --overwrite or another --out")
    points = combinations(vary, {"decoder": decoder, **(fixed or {})})
    make_folder(out.parent)
    cells = [_cell(point, scene, bands, size, list(train), steps, work) for point in points for scene in scenes]
    trainings = {cell["folder"]: cell for cell in cells if cell["decoder"] in NETWORKS}
    named = [{**cell, "name": f"training for {cell['name']}", "path": ""} for cell in trainings.values()]
    run_cells(named, sweep_training, work, jobs=jobs, cluster=cluster, progress=progress)  # once for all scenes
    measured = run_cells(cells, sweep_cell, make_folder(work), jobs=jobs, cluster=cluster, progress=progress)
    rows = _rows(points, measured, len(scenes))
    found = {
        "command": " ".join(command), "commit": repository_commit(), "scenes": [Path(scene).stem for scene in scenes],
        "vary": {name: list(values) for name, values in vary.items()}, "rows": rows,
    }  # fmt: skip
    write_json(found, files[0], overwrite=overwrite)
    write_text(_csv(rows, list(vary)), files[1], overwrite=overwrite)
    write_text(_markdown(found, list(vary)), files[2], overwrite=overwrite)
    save_figure(sweep_figure(rows, list(vary)), files[3], overwrite=overwrite)
    return found


def combinations(vary: Values, fixed: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Every combination of the varied settings, with the fixed ones, each of which makes a camera.

    Raises:
        SettingError: the first that does not.
    """
    if not vary:
        raise SettingError("--vary", "nothing", "at least one, such as slots=2,4,8")
    for name, values in vary.items():
        if name not in AXES:
            raise SettingError("--vary", name, f"one of {', '.join(AXES)}")
        if not values or len(set(map(str, values))) < len(values):
            raise SettingError("--vary", f"{name} = {list(values)}", "different values, separated by commas")
    points = [{**fixed, **dict(zip(vary, values, strict=True))} for values in product(*vary.values())]
    for point in points:
        if point["decoder"] not in DECODER_NAMES:
            raise SettingError("decoder", repr(point["decoder"]), f"one of {', '.join(DECODER_NAMES)}")
        camera, sensor = parts(point)
        SpectralCamera(bands=2, size=(64, 64), sensor=Sensor(**sensor), **{**camera, "dispersion": 1.0})
    return points


def parts(point: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arguments of the camera and of the sensor in a combination."""
    camera = {name: value for name, value in point.items() if name in CAMERA or name == "seed"}
    return camera, {SENSOR[name]: value for name, value in point.items() if name in SENSOR}


def _cell(
    point: dict[str, Any],
    scene: str,
    bands: int,
    size: tuple[int, int] | None,
    train: list[str],
    steps: int,
    work: Path,
) -> Settings:
    camera, sensor = parts(point)
    shown = ", ".join(f"{name} = {value}" for name, value in point.items())
    cell: Settings = {"name": f"{Path(scene).stem}: {shown}", "path": scene, "bands": bands, "size": size}
    cell |= {"camera": camera, "sensor": sensor, "decoder": point["decoder"], "train": train, "source": source_digest()}
    if point["decoder"] in NETWORKS:
        cell["steps"] = steps
    identity = {name: value for name, value in cell.items() if name not in ("name", "path")}
    return cell | {"folder": str(work / f"point-{cell_key(identity)}")}


def _rows(points: Sequence[dict[str, Any]], measured: Sequence[Measured], scenes: int) -> list[dict[str, Any]]:
    rows = []
    for place, point in enumerate(points):
        part = measured[place * scenes : (place + 1) * scenes]
        each = {Path(cell["path"]).stem: cell["metrics"] for cell in part}
        light = sum(cell["throughput"] for cell in part) / scenes
        rows.append({**point, **mean_over_scenes(each), "throughput": light, "scenes": each})
    return rows


def _columns(axes: Sequence[str]) -> list[tuple[str, str, str]]:
    return [*((name, name, "") for name in axes), *METRICS, ("throughput", "light", ".1%")]


def _csv(rows: Sequence[dict[str, Any]], axes: Sequence[str]) -> str:
    text = io.StringIO()
    names = [name for name, _, _ in _columns(axes)]
    writer = csv.DictWriter(text, names, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _markdown(found: dict[str, Any], axes: Sequence[str]) -> str:
    lines = ["# Spectral camera: sweep over " + " and ".join(axes), ""]
    lines += [
        f"Command: `{found['command']}` at commit `{found['commit']}`. Means over {', '.join(found['scenes'])}.",
        "",
    ]
    return "\n".join([*lines, markdown_table(found["rows"], _columns(axes))])


def sweep_figure(rows: Sequence[dict[str, Any]], axes: Sequence[str]) -> Figure:
    """PSNR along the first varied setting, a line for every combination of the others."""
    from matplotlib.figure import Figure

    from tmca.experiments.figures import plain_axes

    figure = Figure(figsize=(6, 4), layout="constrained")
    axis = figure.add_subplot()
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(", ".join(f"{name} = {row[name]}" for name in axes[1:]), []).append(row)
    for label, group in groups.items():
        places = [row[axes[0]] for row in group]
        places = places if all(isinstance(p, int | float) for p in places) else [str(p) for p in places]
        axis.plot(places, [row["psnr"] for row in group], "o-", label=label or None)
    if len(groups) > 1:
        axis.legend(fontsize=8)
    plain_axes(axis, "mean over test scenes", axes[0], "PSNR (dB)")
    return figure
