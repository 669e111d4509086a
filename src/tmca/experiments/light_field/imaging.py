"""The light-field camera's main job: views → snapshot → views again, with files, metrics and pictures."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any
from warnings import warn

import numpy as np
import torch
from torch import Tensor

from tmca.cameras import LightFieldCamera, Snapshot, moving_scenes
from tmca.cameras.hardware import Hardware, imperfect
from tmca.decoders import decoders
from tmca.errors import DataError, SettingError
from tmca.experiments.figures import save_figure
from tmca.experiments.light_field.animation import views_gif
from tmca.experiments.light_field.figures import light_field_figure
from tmca.experiments.light_field.refocus import focus_steps, refocus_strip
from tmca.experiments.reconstructions import Reconstruction, decoded
from tmca.experiments.scenes import SceneWarning
from tmca.experiments.snapshots import NOISE_STREAM

if TYPE_CHECKING:
    import xarray as xr


READING = "scene_reading"
"""Attribute of light fields, snapshots and estimates: how the scene was read, as JSON."""


class UnevenGrid(SceneWarning):
    """A light field whose grid of views is not square, as when some are missing."""


def load_light_field(
    source: str,
    *,
    views: int | None = 5,
    size: tuple[int, int] | None = None,
    scale: int | None = None,
    colour: bool = False,
    pattern: str | None = None,
    lens: tuple[int, int] | None = None,
) -> xr.DataArray:
    """A light field from files, or a rendered one.

    Args:
        source: what ``tmca.data.read_light_field`` reads, or the name of a rendered scene, ``coffee`` or with the seed
            of its arrangement ``coffee:3``.
        views: n for the centre n×n views; all if None.
        size: (H, W) centre crop.
        scale: whole number of pixels per axis that are averaged into one.
        colour: red, green and blue instead of their luminance.
        pattern: of the file names of a folder.
        lens: (rows, columns) of the views under a lens of a lenslet picture; 14×14 without.

    Returns:
        (view_v, view_u, y, x), or (colour, view_v, view_u, y, x), with an attribute ``name``, and ``scene_reading``: a
        JSON object with ``source`` and these arguments.

    Raises:
        DataError, SettingError: no such light field, or one that cannot be used so.

    Warns:
        UnevenGrid: the centre of views that stand on no square grid was taken.
    """
    from tmca.data import read_light_field, rendered_names

    asked: dict[str, Any] = {"views": views, "scale": scale, "colour": colour, "pattern": pattern, "lens": lens}
    if Path(source).exists():
        found = read_light_field(source, crop=size, **asked)
        rows, columns = found.attrs["grid"]
        if rows != columns:
            odd = f"{rows}×{columns} views are no square, some may be missing"
            warn(f"{source}: {odd}; taken are {taken_views(found)}", UnevenGrid, stacklevel=2)
    elif source.partition(":")[0] in rendered_names():
        _refuse_files(pattern=pattern, lens=lens)
        found = _rendered(source, views or 5, size, scale or 1, colour)["light_field"]
    else:
        wanted = f"a path, or one of {', '.join(rendered_names())}"
        raise DataError(source, "no such file, folder or rendered scene", wanted)
    noted = {"source": source, "size": size, **asked, "scale": scale or 1}
    return found.assign_attrs({READING: json.dumps(noted, default=int)})


def taken_views(light_field: xr.DataArray) -> str:
    """Which rows and columns of its files' grid a light field is."""
    taken = light_field.sizes["view_v"], light_field.sizes["view_u"]
    first = [(int(n) - k + 1) // 2 for n, k in zip(light_field.attrs["grid"], taken, strict=True)]
    rows, columns = (f"{top} to {top + k - 1}" for top, k in zip(first, taken, strict=True))
    return f"rows {rows} and columns {columns}, counted from 0"


def _refuse_files(**asked: Any) -> None:
    """Refuse what only files have."""
    for name, value in asked.items():
        if value is not None:
            text = "×".join(map(str, value)) if isinstance(value, tuple) else value
            raise SettingError(name, f"{text} of a rendered scene", "a light field from files", "leave it out")


def true_disparity(
    source: str, like: xr.DataArray, scale: int | None = None, pattern: str | None = None
) -> xr.DataArray | None:
    """Disparity (y, x) of the centre view in px per view step, brought to the pixels of ``like``; None without."""
    from tmca.data import find_disparity, read_disparity

    size = (like.sizes["y"], like.sizes["x"])
    if not Path(source).exists():
        return _rendered(source, like.sizes["view_v"], size, scale or 1, False)["disparity"]
    if find_disparity(source) is None:
        return None
    return read_disparity(source, crop=size, scale=scale, pattern=pattern)


def _rendered(source: str, views: int, size: tuple[int, int] | None, scale: int, colour: bool) -> xr.Dataset:
    from tmca.data import rendered_light_field

    name, _, seed = source.partition(":")
    if seed and not seed.isdigit():
        raise SettingError(source, f"seed {seed!r}", "a whole number, such as coffee:3")
    if scale != 1:
        raise SettingError("scale", f"{scale} of a rendered scene", "1: choose its size instead", "leave it out")
    return rendered_light_field(name, views=views, size=size, seed=int(seed or 0), colour=colour)


def as_batch(light_field: xr.DataArray) -> Tensor:
    """(B, V, U, H, W), B the colours."""
    values = torch.from_numpy(np.ascontiguousarray(light_field.values, dtype=np.float32))
    return values if values.ndim == 5 else values[None]


def take_light_field_snapshot(
    light_field: xr.DataArray, camera: LightFieldCamera, seed: int = 0, hardware: Hardware | None = None
) -> Snapshot[LightFieldCamera]:
    """Image a light field.

    Args:
        light_field: (view_v, view_u, y, x), or with colours first: one snapshot of each.
        camera: of its views and size.
        seed: of the sensor's noise, whose stream no code shares.
        hardware: faults of the bench that takes it; the snapshot's camera is the one that is known.

    Raises:
        SettingError: faults that this camera cannot have.
    """
    faults, views = hardware or Hardware(), as_batch(light_field)
    notes: dict[str, Any] = {"scene": str(light_field.attrs.get("name", "")), "noise_seed": seed}
    if any(faults.movement):
        views = moving_scenes(views, faults.movement, camera.slots)
        notes["motion_pixels"] = list(faults.movement)
    with torch.no_grad():
        values = imperfect(camera, faults, seed)(views, NOISE_STREAM + seed)
    notes |= {"hardware": faults.said()} if faults.faults() else {}
    noted = {READING: light_field.attrs[READING]} if READING in light_field.attrs else {}
    return Snapshot(values, camera, notes | noted)


def reconstruct_light_field(
    snapshot: Snapshot[LightFieldCamera],
    decoder: str = "lmmse",
    *,
    prior: Any = None,
    dictionary: Any = None,
    truth: xr.DataArray | None = None,
    progress: Callable[..., None] | None = None,
    **how: Any,
) -> Reconstruction:
    """Recover the light field of a snapshot.

    Args:
        snapshot: with its camera.
        decoder: one of ``tmca.decoders.decoders_for("light-field")``.
        prior: a prior, its file, or None for the rendered light fields' one.
        dictionary: a dictionary or its file: the prior of the decoders that use one.
        truth: the light field, for metrics.
        progress: told the share that is done and, while a prior is learned, what is done next.
        how: settings of the decoder.

    Raises:
        SettingError: a dictionary for a decoder that uses none.
    """
    from tmca.metrics import light_field_metrics

    if dictionary is not None and (decoder not in decoders() or decoders()[decoder].prior_kind != "dictionary"):
        wanted = "none: only dictionary and dictionary-omp use it"
        raise SettingError("dictionary", f"one for {decoder}", wanted, "leave it out")
    estimate = decoded(snapshot, decoder, prior=prior if dictionary is None else dictionary, progress=progress, **how)
    found = Reconstruction.of(estimate)
    found.metrics = {} if truth is None else light_field_metrics(found.light_field.values, truth.values)
    return found


def light_field_files(path: Path, figures: bool) -> list[Path]:
    """What a reconstruction and its pictures will be called."""
    if not figures:
        return [path]
    return [path, path.with_suffix(".png"), path.with_name(f"{path.stem}_refocus.png"), path.with_suffix(".gif")]


def light_field_pictures(
    result: Reconstruction,
    path: Path,
    *,
    snapshot: Snapshot[LightFieldCamera],
    truth: xr.DataArray | None = None,
    overwrite: bool = False,
) -> list[Path]:
    """Centre view with epipolar slices, refocused images, and a walk over the views beside a reconstruction file."""
    values, taken = result.light_field.values, snapshot.values[:, 0].numpy()
    _, picture, strip, walk = light_field_files(path, figures=True)
    shown = taken if len(taken) > 1 else taken[0]
    drawing = light_field_figure({result.decoder: values}, None if truth is None else truth.values, shown)
    title = f"{path.stem}: refocused, disparity in px per view"
    return [
        save_figure(drawing, picture, overwrite=overwrite),
        save_figure(refocus_strip(values, focus_steps(result.light_field), title), strip, overwrite=overwrite),
        views_gif(values, walk, overwrite=overwrite),
    ]
