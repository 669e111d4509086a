"""Snapshots of any camera: the stream of their noise, their files and pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tmca.cameras import Snapshot
from tmca.experiments.camera_figures import codes_figure, snapshot_figure
from tmca.experiments.figures import save_figure

NOISE_STREAM = 0x9E3779B9
"""Added to the seed of the noise: codes draw from seeds below it (torch uses the lower 32 bits only)."""


def snapshot_files(path: Path, figures: bool) -> list[Path]:
    """What `snapshot_pictures` and the snapshot itself will be called."""
    return [path, path.with_suffix(".png"), path.with_name(f"{path.stem}_codes.png")] if figures else [path]


def snapshot_pictures(snapshot: Snapshot[Any], path: Path, *, overwrite: bool = False) -> list[Path]:
    """The snapshot and the codes as PNG beside a snapshot file."""
    title = f"{path.stem}: K = {snapshot.camera.slots}"
    _, image, codes = snapshot_files(path, figures=True)
    return [
        save_figure(
            snapshot_figure(snapshot.values[:, 0].mean(0).numpy(), snapshot.camera, title),
            image,
            overwrite=overwrite,
        ),
        save_figure(codes_figure(snapshot.camera), codes, overwrite=overwrite),
    ]
