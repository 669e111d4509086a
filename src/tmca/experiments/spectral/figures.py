"""The thesis' figures 20 to 22 for the scenes of the spectral table: composites, spectra and bands of some rows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tmca.data.scenes import load_scene
from tmca.experiments.cells import Measured
from tmca.experiments.spectral.rows import DECODER_NAMES, SHOWN, SHOWN_NOISE
from tmca.plots.cube import bands, composites, signatures
from tmca.plots.style import save_figure

if TYPE_CHECKING:
    pass


def comparison_pictures(measured: Sequence[Measured], out: Path, *, overwrite: bool = False) -> list[Path]:
    """Write ``spectral_SCENE_composites|spectra|bands.png`` for every scene whose estimates were kept.

    Args:
        measured: cells of the table; those with ``kept`` have an estimate on disk.
        out: folder.
        overwrite: replace earlier pictures.
    """
    files = []
    for scene in dict.fromkeys(cell["scene"] for cell in measured if cell.get("kept")):
        cells = [cell for cell in measured if cell.get("kept") and cell["scene"] == scene]
        truth = load_scene(cells[0]["path"], bands=cells[0]["bands"])
        found = {(c["code"], c["decoder"]): np.load(c["kept"]).astype(np.float32) for c in cells}
        names = [row for row in SHOWN if row in found]
        estimates = {f"{code}\n{DECODER_NAMES[decoder]}": found[code, decoder] for code, decoder in names}
        wavelengths = truth["wavelength"].values.tolist()
        drawn = (
            composites(truth.values, estimates, wavelengths, SHOWN_NOISE),
            signatures(truth.values, estimates, wavelengths),
            bands(truth.values, estimates, wavelengths),
        )
        for figure, file in zip(drawn, picture_files(scene, out), strict=True):
            files.append(save_figure(figure, file, overwrite=overwrite, dpi=80))
    return files


def picture_files(scene: str, out: Path) -> list[Path]:
    """The pictures of a scene: composites, spectra, bands."""
    return [out / f"spectral_{scene}_{kind}.png" for kind in ("composites", "spectra", "bands")]
