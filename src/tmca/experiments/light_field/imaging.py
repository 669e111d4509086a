"""The light-field camera's main job: views → snapshot → views again, with files, metrics and pictures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.cameras import LightFieldCamera, Snapshot
from tmca.decoders import decoders
from tmca.errors import SettingError
from tmca.experiments.reconstructions import Reconstruction, decoded
from tmca.plots.light_field import light_field_figure
from tmca.plots.style import save_figure
from tmca.plots.views import focus_steps, refocus_strip, views_gif

if TYPE_CHECKING:
    import xarray as xr


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
        progress: called with the share that is done and, while a prior is learned, what is done next.
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
