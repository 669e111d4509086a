"""Snapshots of any camera: the stream of their noise, their files and pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tmca.cameras import LightFieldCamera, Snapshot
from tmca.experiments.camera_figures import codes_figure, snapshot_figure
from tmca.plots.codes import sub_images_figure
from tmca.plots.style import save_figure


def snapshot_files(path: Path, figures: bool, *, views: bool = False) -> list[Path]:
    """What `snapshot_pictures` and the snapshot itself will be called; ``views`` for a light-field camera."""
    pictures = [path.with_name(f"{path.stem}{what}.png") for what in ("", "_codes", *(["_rays"] if views else []))]
    return [path, *(pictures if figures else [])]


def snapshot_pictures(snapshot: Snapshot[Any], path: Path, *, overwrite: bool = False) -> list[Path]:
    """The snapshot and the codes as PNG beside a snapshot file; of a light-field camera also what each mask point does
    to the rays that cross it."""
    camera = snapshot.camera
    title = f"{path.stem}: K = {camera.slots}"
    drawings = [snapshot_figure(snapshot.values[:, 0].mean(0).numpy(), camera, title), codes_figure(camera)]
    views = isinstance(camera, LightFieldCamera)
    if isinstance(camera, LightFieldCamera):
        seen = camera.code_through_mask().detach().cpu().numpy()
        drawings.append(sub_images_figure({f"code seen from the mask, K = {camera.slots}": seen}))
    files = snapshot_files(path, figures=True, views=views)[1:]
    return [save_figure(figure, file, overwrite=overwrite) for figure, file in zip(drawings, files, strict=True)]
