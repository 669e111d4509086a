"""Pictures of the light-field table: views with epipolar slices, quality per view, and disparity of some rows."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tmca.data.light_field_scenes import Reading, read_middle
from tmca.experiments.cells import Measured
from tmca.experiments.light_field.rows import DECODER_NAMES, SHOWN, STATIC_CODES
from tmca.plots.light_field import centre_view, disparity_figure, light_field_figure, view_psnr_figure
from tmca.plots.style import save_figure
from tmca.plots.views import brightest

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = tuple[str, str]
"""Code and decoder."""


def slug(scene: str) -> str:
    """A scene's name as part of a file's."""
    return scene.strip("./").replace("/", "-").replace(":", "-")


def picture_files(scenes: Sequence[str], out: Path) -> list[Path]:
    """Views, quality per view and disparity of every scene."""
    return [out / f"light-field_{scene}_{kind}.png" for scene in scenes for kind in ("views", "psnr", "disparity")]


def in_pairs(rows: Collection[Row]) -> list[Row]:
    """Rows that are pictured, each static one before its time-multiplexed partner; a row without partner is left out,
    unless all are."""
    static = [row for row in SHOWN if row[0] in STATIC_CODES]
    partners = [row for row in SHOWN if row[0] not in STATIC_CODES]
    pairs = [pair for pair in zip(static, partners, strict=True) if set(pair) <= set(rows)]
    return [row for pair in pairs for row in pair] or [row for row in SHOWN if row in rows]


def comparison_pictures(measured: Sequence[Measured], out: Path, *, overwrite: bool = False) -> list[Path]:
    """Write the pictures of every scene whose estimates were kept.

    Args:
        measured: cells of the table; those with ``kept`` have an estimate on disk.
        out: folder.
        overwrite: replace earlier pictures.
    """
    files = []
    for scene in dict.fromkeys(cell["scene"] for cell in measured if cell.get("kept")):
        cells = {(c["code"], c["decoder"]): c for c in measured if c.get("kept") and c["scene"] == scene}
        drawn = _pictures({_label(*row): cells[row] for row in in_pairs(cells)})
        for figure, file in zip(drawn, picture_files([slug(scene)], out), strict=True):
            files.append(save_figure(figure, file, overwrite=overwrite, dpi=80))
    return files


def _pictures(cells: dict[str, Measured]) -> list[Figure]:
    """Views, quality per view and disparity of the rows of one scene."""
    from tmca.metrics import estimate_disparity

    first = next(iter(cells.values()))
    truth = read_middle(first["path"], first["views"][0], Reading(**first["reading"]), first["size"]).values
    estimates = {name: np.load(cell["kept"]).astype(np.float32) for name, cell in cells.items()}
    known = dict(np.load(first["disparity"]))
    seen = {name: estimate_disparity(estimate) for name, estimate in estimates.items()}
    return [
        light_field_figure(estimates, truth),
        view_psnr_figure({name: np.asarray(cell["psnr_per_view"]) for name, cell in cells.items()}),
        disparity_figure(
            {"estimator on true views": known["seen"], **seen},
            known.get("truth"),
            view=centre_view(truth, brightest(truth)),
        ),
    ]


def _label(code: str, decoder: str) -> str:
    return f"{code}\n{DECODER_NAMES[decoder]}"
