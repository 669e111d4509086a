"""Results of real captures: docs/results/real.md, its JSON and its pictures."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from studies.grid import check_new, repository_commit
from studies.real.control import check_known, study_control
from studies.real.decoding import ADAPT, START, check_real_decoders
from studies.real.figures import geometry_figure, scene_figure
from studies.real.page import page
from studies.real.records import Network, Results
from studies.real.study import (
    SCENES,
    Scene,
    Told,
    captures_folder,
    single_disperser,
    study_geometry,
    study_movies,
    study_scene,
)
from studies.tables import write_results
from tmca.data import make_folder
from tmca.decoders import Weights
from tmca.plots import frames_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def report_files(out: Path) -> list[Path]:
    """JSON, page and pictures of a report."""
    pictures = [*SCENES, "geometry", "wine"]
    return [
        out.with_suffix(".json"),
        out.with_suffix(".md"),
        *(out.with_name(f"{out.name}_{name}.png") for name in pictures),
    ]


def write_report(
    data: Path,
    out: Path,
    decoders: Sequence[str],
    weights: str | Path,
    keep: Path,
    command: Sequence[str],
    *,
    control: Sequence[str] = (),
    overwrite: bool = False,
    told: Told = lambda text: None,
) -> list[Path]:
    """Decode, judge and draw every real capture of a data folder.

    Args:
        data: folder with ``tsa/`` and ``pixel_shutter_wine/``, or the one above.
        out: the page, without suffix.
        decoders: of ``REAL_DECODERS``.
        weights: of the network: a run or its file, or the name of weights that come with tmca.
        keep: folder of estimates, used again by the next call.
        command: that is shown on the page.
        control: scenes that are known, imaged behind the same mask.
        overwrite: replace results that exist.
        told: what is done next.

    Raises:
        DataError, SettingError, OutputError: captures that are missing, decoders that cannot run, results that exist.
    """
    folder, files = captures_folder(data), report_files(out)
    check_real_decoders(decoders)
    check_new(files, overwrite)
    check_known(control, folder)
    make_folder(keep)
    trained = Weights.find(weights) if "network" in decoders else None
    told("geometry")
    geometry, blocks = study_geometry(folder)
    scenes = [study_scene(folder, name, decoders, trained, keep, told) for name in SCENES]
    first = scenes[0].snapshot
    known = [row for name in control for row in study_control(first, name, decoders, trained, keep, told)]
    rows, frames, captures = study_movies(folder, told)
    results: Results = {
        "command": shlex.join(command), "commit": repository_commit(), "geometry": geometry,
        "network": _network(weights, trained), "rows": [row for scene in scenes for row in scene.rows],
        "pairs": [pair for scene in scenes for pair in scene.pairs], "control": known, "movies": rows,
    }  # fmt: skip
    drawings = {scene.name: _drawn(scene) for scene in scenes}
    drawings |= {"geometry": geometry_figure(geometry, blocks, first.camera.size[0])}
    drawings |= {"wine": frames_figure(frames, captures)}
    for name, drawing in drawings.items():
        save_figure(drawing, out.with_name(f"{out.name}_{name}.png"), overwrite=overwrite)
    write_results(results, page(results, out.name), files[0], overwrite)
    return files


def _network(name: str | Path, weights: Weights | None) -> Network | None:
    """Which network it is, and how it decodes."""
    if weights is None:
        return None
    return {"weights": str(name), "kind": weights.network.kind, "start": START, "adapt": ADAPT}


def _drawn(scene: Scene) -> Figure:
    prototype, snapshot = single_disperser(), scene.snapshot
    return scene_figure(
        snapshot.values[0, 0].numpy(), scene.estimates, snapshot.camera.wavelengths,
        prototype.points.get(scene.name, {}), scene.mask_spectra, prototype.turned,
    )  # fmt: skip
