"""Priors of the spectral-depth camera's scenes, learned once and kept."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tmca.cameras import SpectralDepthCamera
from tmca.experiments.cells import Settings, cell_key, source_digest
from tmca.experiments.depth_scenes import load_any_depth_scene
from tmca.experiments.scenes import identity_of


def learned_depth_prior(train: Sequence[str], work: Path, preset: str, window: int, reading: Settings) -> str:
    """File of the prior of some scenes at a preset's bands, learned once and kept in ``work``."""
    from tmca.data import make_folder
    from tmca.priors import learn_prior
    from tmca.priors.spectral_depth import needed_block

    probe = SpectralDepthCamera.from_preset(preset, size=(64, 64))
    about = {**reading, "preset": preset, "window": window, "scenes": [identity_of(n) or n for n in train]}
    file = make_folder(work) / f"prior-{cell_key({**about, 'source': source_digest()})}.nc"
    if not file.exists():
        cubes = [load_any_depth_scene(name, probe, **reading)["radiance"] for name in train]
        learn_prior(cubes, spread=0, block=needed_block(window, probe.bench.window)).save(file)
    return str(file)
