"""Sweeps of the spectral camera: what can be varied, and how its scenes are read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tmca.cameras import SpectralCamera
from tmca.data.scenes import check_readable
from tmca.experiments.spectral.cells import sweep_cell, sweep_training
from tmca.experiments.spectral.rows import DECODER_NAMES, NETWORKS
from tmca.experiments.sweep import Swept, Values, sweep
from tmca.sensor import Sensor


def _check(camera: dict[str, Any], sensor: dict[str, Any]) -> None:
    SpectralCamera(bands=2, size=(64, 64), sensor=Sensor(**sensor), **camera)


SPECTRAL = Swept(
    title="Spectral camera",
    camera=("slots", "aperture", "shutter", "exposure", "dispersion", "disperser", "transmittance", "duty", "period"),
    words=("aperture", "shutter", "exposure", "disperser", "decoder"),
    check=_check,
    decoders=DECODER_NAMES,
    networks=tuple(NETWORKS),
    application="spectral",
    measure=sweep_cell,
    train=sweep_training,
)


def sweep_spectral(
    vary: Values,
    scenes: Sequence[str],
    out: Path,
    work: Path,
    *,
    bands: int = 12,
    size: tuple[int, int] | None = None,
    **how: Any,
) -> dict[str, Any]:
    """Measure every combination of the varied settings; ``sweep`` says what is not said here.

    Args:
        vary: setting → its values; names of ``SPECTRAL.axes``.
        scenes: test scenes, names that ``load_scene`` understands.
        out: the results ``OUT.json``, ``OUT.csv``, ``OUT.md`` and ``OUT.png``.
        work: folder of finished cells.
        bands: from 400 to 700 nm.
        size: (H, W) middle of the scenes.
        how: further arguments of ``sweep``.
    """

    def check() -> None:
        check_readable(scenes, bands, size)
        check_readable([*how.get("train", ()), *how.get("validation", ())], bands)

    return sweep(SPECTRAL, vary, scenes, out, work, {"bands": bands, "size": size}, check=check, **how)
