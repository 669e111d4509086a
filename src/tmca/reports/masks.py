"""Phase masks of a spectral-depth camera for a sensor: searched, judged, written as files with a page about them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tmca.applications.example_scenes import JUDGING, judge_on
from tmca.arguments import checked
from tmca.cameras import SpectralDepthCamera
from tmca.data import at_bands, check_folder, read, rendered_scene, split_rendered
from tmca.data.rendering import is_rendered
from tmca.design import MaskAdvice, MaskEffort, MaskTask, Progress, SensorSheet, search_masks
from tmca.errors import DataError, SettingError
from tmca.evaluation.tables import check_new
from tmca.operators.window_moments import needed_block
from tmca.optics import MODES, Stroke, changed_bench, check_mask
from tmca.priors import GaussianPrior, find_prior
from tmca.reports.codes import named_once, read_scenes
from tmca.reports.mask_page import described, design_files, write_design

SLOTS = (1, 2, 4)
"""Numbers of slots that are tried."""


@checked
def design_spectral_depth(
    sheet: SensorSheet,
    out: Path,
    *,
    scenes: Sequence[str] = (),
    prior: str | Path | GaussianPrior | None = None,
    preset: str = "quick",
    bands: int = 4,
    bench: Mapping[str, Any] | None = None,
    camera: Mapping[str, Any] | None = None,
    slots: Sequence[int] | None = None,
    shutter: str = "one-hot",
    mask: str = "zernike",
    rms: float | None = None,
    modes: int = MODES,
    stroke: float | None = None,
    levels: int | None = None,
    learn: Collection[str] = ("mask",),
    window: int = 8,
    effort: MaskEffort | None = None,
    seed: int = 0,
    overwrite: bool = False,
    progress: Progress | None = None,
    command: Sequence[str] = (),
) -> tuple[MaskAdvice, dict[str, Any]]:
    """Search phase masks that tell depths apart, static and time-multiplexed with the same effort, into a folder.

    Args:
        sheet: sensor and modulator.
        out: folder of ``design.json``, ``design.html``, ``fisher.png``, ``distances.png``, and for every number of
            slots K ``codes_kK.nc``, ``masks_kK.png`` and ``psf_kK.png``; for a sheet of two buckets also
            ``codes_kK_two_buckets.nc`` and ``burst.nc``, and their pictures; ``codes.nc`` are the recommended ones.
        scenes: cubes or rendered scenes that the prior is learned from; the rendered training scenes without any.
        prior: a stationary Gaussian prior of the searched bands, or its file, instead of scenes.
        preset: name of the camera that the other arguments change.
        bands: that are searched, evenly over those of the preset.
        bench: arguments of ``PhaseMaskBench`` to replace.
        camera: arguments of ``SpectralDepthCamera`` to replace: ``depth``, ``planes``, ``period``, and ``filters`` and
            ``channels`` by name, which are clear and monochrome without.
        slots: numbers of slots to try; those of ``SLOTS`` that fit the exposure without. One slot is always tried.
        shutter: family of the shutter beside several slots and one bucket; two buckets have a balanced one.
        mask, rms, modes, learn, window: see ``MaskTask``.
        stroke: largest height range of the device, metres; any without.
        levels: heights that it can show; any without.
        effort: of every search.
        seed: of masks, shutter and filters.
        overwrite: replace files that exist.
        progress: called with the share that is done and what is done.
        command: how it was called, kept in the files.

    Returns:
        The advice, and what ``design.json`` holds.

    Raises:
        SettingError, ShapeError, DataError: what cannot be searched, or scenes or a prior that do not fit.
        OutputError: files exist, or none can be written.

    Warns:
        StrayLight, Undersampled: recommended masks that send light beside their windows, or are steeper than their
            pixels.
    """
    counts = _counts(sheet, slots)
    check_new((out / name for name in design_files(counts, sheet.buckets)), overwrite)
    settings = _camera(preset, bands, {**(camera or {}), "sensor": sheet.sensor()})
    searched = changed_bench(SpectralDepthCamera.preset(preset)["bench"], bench or {})
    task = MaskTask(searched, settings, shutter, mask, rms, _stroke(stroke, levels), learn, window, seed, modes)
    for count in counts:
        task.camera_of(count, 0)
    named_once(scenes)
    check_folder(out)
    progress, effort = progress or (lambda share, step: None), effort or MaskEffort()
    cubes = [] if prior is not None else _cubes(scenes, task, lambda share, step: progress(0.1 * share, step))
    learned = _prior(scenes, prior, cubes, task, lambda share, step: progress(0.1 + 0.2 * share, step))
    judge = judge_on(cubes, learned, window)
    advice = search_masks(
        task, learned, counts, effort, lambda share, step: progress(0.3 + 0.68 * share, step), judge, sheet.buckets
    )
    record = described(advice, task, effort, learned, {"preset": preset, "sensor": asdict(sheet)}, command)
    write_design(advice, record, out, overwrite)
    check_mask(advice.best.camera.point_spread)
    return advice, record


def _counts(sheet: SensorSheet, slots: Sequence[int] | None) -> list[int]:
    most = sheet.most_slots
    asked = [k for k in SLOTS if most is None or k <= most] if slots is None else list(slots)
    return sorted({1, *sheet.allowed(asked)})


def _stroke(reach: float | None, levels: int | None) -> Stroke | None:
    if reach is None:
        if levels is not None:
            raise SettingError("levels", f"{levels} without a stroke", "the device's --stroke beside it")
        return None
    if not 0 < reach < float("inf"):
        raise SettingError("stroke", f"{reach:g} m", "metres above 0")
    return Stroke(-reach / 2, reach / 2, levels)


def _camera(preset: str, bands: int, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of the searched cameras."""
    defaults = SpectralDepthCamera.preset(preset)
    if bands < 2:
        raise SettingError("bands", str(bands), "2 or more")
    waves = tuple(np.linspace(defaults["bands"][0], defaults["bands"][-1], bands).tolist())
    same = {name: defaults[name] for name in ("depth", "planes", "period")}
    return {**same, "filters": "clear", "channels": "monochrome", **changes, "bands": waves}


def _prior(
    scenes: Sequence[str],
    prior: str | Path | GaussianPrior | None,
    cubes: Sequence[torch.Tensor],
    task: MaskTask,
    progress: Progress,
) -> GaussianPrior:
    camera = task.camera_of(1, 0)
    block = needed_block(max(task.window, camera.tile_size), task.bench.window)  # a judge decodes a tile at least
    if prior is not None and scenes:
        raise SettingError("prior", "scenes beside it", "one of them")
    if not scenes:
        return find_prior(camera, prior, block=block, progress=progress)
    progress(0.5, "learning what the scenes have in common")
    sources = [Path(name).stem for name in scenes]
    return GaussianPrior.learn(list(cubes), block, wavelengths=task.camera["bands"], sources=sources)


def _cubes(scenes: Sequence[str], task: MaskTask, progress: Progress) -> list[torch.Tensor]:
    """Example scenes at the searched bands; rendered ones that masks are judged on where none are named."""
    names = scenes or sorted(split_rendered()["train"])[:JUDGING]
    return list(read_scenes(names, lambda name: _cube(name, task.camera["bands"]), progress).values())


def _cube(name: str, waves: Sequence[float]) -> torch.Tensor:
    """(L, H, W) of an example scene at these bands."""
    if is_rendered(name):
        cube = rendered_scene(name, wavelengths=waves, size=(256, 256))["radiance"]
    else:
        cube = at_bands(read(name), waves)
    if not cube.values.any():
        raise DataError(name, "no light, every pixel is zero", "a lit scene", "leave it out")
    return torch.from_numpy(np.ascontiguousarray(cube.values, dtype=np.float32))
