"""The light-field camera's main job: views → snapshot → views again, with files, metrics and pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from tmca.cameras import Hardware, LightFieldCamera, Snapshot, imperfect, moving_scenes
from tmca.data.light_field_scenes import as_batch
from tmca.data.scene_names import READING
from tmca.decoders import Decoded, Weights, decode_light_field
from tmca.errors import SettingError
from tmca.experiments.reconstructions import Reconstruction
from tmca.experiments.snapshots import NOISE_STREAM
from tmca.plots.light_field import light_field_figure
from tmca.plots.style import save_figure
from tmca.plots.views import focus_steps, refocus_strip, views_gif

if TYPE_CHECKING:
    import xarray as xr

    from tmca.priors import GaussianPrior, PatchDictionary


@dataclass
class LightFieldReconstruction(Reconstruction):
    """A reconstructed light field with its coordinates.

    Args:
        light_field: (view_v, view_u, y, x) estimate, with colours first if there are any.
        deviation: of the same shape, predicted standard deviation, if known.
    """

    light_field: xr.DataArray
    deviation: xr.DataArray | None

    def parts(self) -> Mapping[str, xr.DataArray | None]:
        """``estimate`` and ``deviation``."""
        return {"estimate": self.light_field, "deviation": self.deviation}


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
        values = imperfect(camera, faults, seed)(views, generator=NOISE_STREAM + seed)
    notes |= {"hardware": faults.said()} if faults.faults() else {}
    noted = {READING: light_field.attrs[READING]} if READING in light_field.attrs else {}
    return Snapshot(values, camera, notes | noted)


def reconstruct_light_field(
    snapshot: Snapshot[LightFieldCamera],
    decoder: str = "lmmse",
    *,
    prior: str | Path | GaussianPrior | None = None,
    dictionary: str | Path | PatchDictionary | None = None,
    tv_weight: float | None = None,
    weights: str | Path | Weights | None = None,
    uncertainty: bool = False,
    truth: xr.DataArray | None = None,
    progress: Callable[..., None] | None = None,
) -> LightFieldReconstruction:
    """Recover the light field of a snapshot.

    Args:
        snapshot: with its camera.
        decoder: one of ``tmca.decoders.LIGHT_FIELD_METHODS``.
        prior: a prior, its file, or None for the rendered light fields' one.
        dictionary: a dictionary or its file.
        tv_weight: of the total variation.
        weights: of a trained network, their file, or the folder of their run.
        uncertainty: also estimate the standard deviation of every entry.
        truth: the light field, for metrics.
        progress: told the share that is done and, while a prior is learned, what is done next.
    """
    from tmca.priors import PatchDictionary, find_prior

    if isinstance(weights, str) and weights == "default":
        missing = "'default', of which none come with tmca for light fields"
        raise SettingError("weights", missing, "a file or run of `tmca train light-field`")
    chosen: Any = None
    if decoder == "lmmse" or prior is not None:
        kind = "mixture" if decoder == "mixture" else "gaussian"
        chosen = find_prior(snapshot.camera, prior, kind, progress=progress)
    found = decode_light_field(
        snapshot, decoder, prior=chosen, tv_weight=tv_weight, uncertainty=uncertainty, progress=progress,
        dictionary=PatchDictionary.load(dictionary) if isinstance(dictionary, str | Path) else dictionary,
        weights=Weights.load(weights) if isinstance(weights, str | Path) else weights,
    )  # fmt: skip
    return _labelled(found, decoder, snapshot, truth)


def light_field_files(path: Path, figures: bool) -> list[Path]:
    """What a reconstruction and its pictures will be called."""
    if not figures:
        return [path]
    return [path, path.with_suffix(".png"), path.with_name(f"{path.stem}_refocus.png"), path.with_suffix(".gif")]


def light_field_pictures(
    result: LightFieldReconstruction,
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


def _labelled(
    found: Decoded, decoder: str, snapshot: Snapshot[LightFieldCamera], truth: xr.DataArray | None
) -> LightFieldReconstruction:
    from tmca.data import label_light_field
    from tmca.metrics import light_field_metrics

    def labelled(values: Tensor, meaning: str) -> xr.DataArray:
        array = values.numpy() if len(values) > 1 else values[0].numpy()
        return label_light_field(array, {"long_name": meaning})

    estimate = labelled(found.estimate, f"light field estimated by {decoder}")
    return LightFieldReconstruction(
        light_field=estimate,
        deviation=None if found.deviation is None else labelled(found.deviation, "predicted standard deviation"),
        decoder=decoder,
        seconds=found.seconds,
        metrics={} if truth is None else light_field_metrics(estimate.values, truth.values),
        notes={**snapshot.notes, **found.notes},
    )
