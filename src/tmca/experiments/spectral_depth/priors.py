"""Priors of the spectral-depth camera's scenes, learned once and kept."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tmca.cameras import SpectralDepthCamera
from tmca.data.depth_scenes import load_any_depth_scene
from tmca.data.scene_names import identity_of
from tmca.experiments.cells import Progress, Settings, cell_key
from tmca.experiments.source import source_digest
from tmca.experiments.spectral_depth.imaging import reading_range

if TYPE_CHECKING:
    import xarray as xr


def learned_depth_prior(
    train: Sequence[str], work: Path, preset: str, window: int, reading: Settings, progress: Progress | None = None
) -> str:
    """File of the prior of some scenes at a preset's bands, learned once and kept in ``work``.

    Args:
        train: scenes, what ``load_any_depth_scene`` reads.
        work: folder of the file.
        preset: of the camera.
        window: of the patch likelihood, pixels.
        reading: further arguments of ``load_any_depth_scene``.
        progress: told after each scene.
    """
    from tmca.data import make_folder
    from tmca.priors.spectral_depth import learn_depth_prior

    probe = SpectralDepthCamera.from_preset(preset, size=(64, 64))
    about = {**reading, "preset": preset, "window": window, "scenes": [identity_of(n) or n for n in train]}
    file = make_folder(work) / f"prior-{cell_key({**about, 'source': source_digest(__name__)})}.nc"

    def load(name: str) -> xr.DataArray:
        return load_any_depth_scene(name, **reading, **reading_range(probe))["radiance"]

    if not file.exists():
        learn_depth_prior(train, load, window, probe.bench.window, progress).save(file)
    return str(file)
