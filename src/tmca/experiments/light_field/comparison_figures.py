"""Pictures of the light-field table: views with epipolar slices, quality per view, and disparity of some rows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tmca.experiments.cells import Measured
from tmca.experiments.figures import save_figure
from tmca.experiments.light_field.figures import disparity_figure, light_field_figure, view_psnr_figure
from tmca.experiments.light_field.reading import Reading, read
from tmca.experiments.light_field.rows import DECODER_NAMES, SHOWN

_MAPS = 4


def slug(scene: str) -> str:
    """A scene's name as part of a file's."""
    return scene.strip("./").replace("/", "-").replace(":", "-")


def picture_files(scenes: Sequence[str], out: Path) -> list[Path]:
    """Views, quality per view and disparity of every scene."""
    return [out / f"light-field_{scene}_{kind}.png" for scene in scenes for kind in ("views", "psnr", "disparity")]


def comparison_pictures(measured: Sequence[Measured], out: Path, *, overwrite: bool = False) -> list[Path]:
    """Write the pictures of every scene whose estimates were kept.

    Args:
        measured: cells of the table; those with ``kept`` have an estimate on disk.
        out: folder.
        overwrite: replace earlier pictures.
    """
    from tmca.metrics import estimate_disparity

    files = []
    for scene in dict.fromkeys(cell["scene"] for cell in measured if cell.get("kept")):
        cells = {(c["code"], c["decoder"]): c for c in measured if c.get("kept") and c["scene"] == scene}
        shown = {_label(*row): cells[row] for row in SHOWN if row in cells}
        first = next(iter(shown.values()))
        truth = read(first["path"], first["views"][0], Reading(**first["reading"]), first["size"])
        estimates = {name: np.load(cell["kept"]).astype(np.float32) for name, cell in shown.items()}
        maps = {name: np.asarray(cell["psnr_per_view"]) for name, cell in shown.items()}
        known = np.load(first["disparity"])
        seen = {name: estimate_disparity(estimates[name]) for name in list(estimates)[-_MAPS:]}
        seen = {"estimator on true views": known["seen"], **seen}
        drawn = [
            light_field_figure(estimates, truth.values),
            view_psnr_figure(maps),
            disparity_figure(seen, dict(known).get("truth")),
        ]
        for figure, file in zip(drawn, picture_files([slug(scene)], out), strict=True):
            files.append(save_figure(figure, file, overwrite=overwrite, dpi=80))
    return files


def _label(code: str, decoder: str) -> str:
    return f"{code}\n{DECODER_NAMES[decoder]}"
