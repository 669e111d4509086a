"""How good an estimate is beside its scene: the same for every camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from torch import Tensor

from tmca.applications.base import APPLICATIONS, Application, application_of, noted_reading
from tmca.applications.imaging import Scene, light_of
from tmca.applications.moving import FRAMES, frame_pairs, mean_of, moved_by
from tmca.arguments import described
from tmca.attributes import REMEDY
from tmca.cameras import load_cameras
from tmca.data import describe
from tmca.data.fitting import METRES
from tmca.data.in_memory import bare_cube, check_light, warn_of_estimate
from tmca.data.scene_names import compare_scene
from tmca.data.unlabelled import of_array
from tmca.decoders import Estimate
from tmca.errors import DataError, SettingError, ShapeError
from tmca.metrics import certainty
from tmca.plots.estimates import mean_frame

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

_MAPS = ("depth", "depth_deviation")
"""Of an estimate, by which it is measured beside its values."""


@dataclass(frozen=True)
class Evaluation:
    """An estimate beside the scene that it is of.

    Args:
        application: of its camera.
        camera: of the estimate, or what its file says of it.
        estimate: as `Estimate.to_xarray` labels it.
        truth: the scene, brought to the camera.
        metrics: figures of merit.
    """

    application: Application
    camera: Any
    estimate: xr.Dataset
    truth: xr.DataArray | xr.Dataset
    metrics: dict[str, float]

    def figure(self, name: str) -> Figure:
        """Both in one picture, of several frames their mean; ``name`` stands above the estimate."""
        shown = mean_frame(self.estimate.assign_attrs(decoder=name))
        return self.application.figure(shown, self.camera, self.truth)


def evaluate(
    estimate: Estimate | Scene, truth: Scene, *, frames: int | None = None, **reading: Any
) -> dict[str, float]:
    """Figures of merit of an estimate, against the scene that it is of; of an estimate in frames their means.

    The scene of a frame is the truth moved as the snapshot notes.

    Args:
        estimate: of a decoder, its file, or what it holds: labelled, or an array or a tensor of the scene.
        truth: the scene, as `tmca.read` gives it, an array as the camera's scenes are, or what is read: as it was read
            for the snapshot, where that is noted; brought to the bands and size of the estimate.
        frames: of equal length within the exposure, with each of which an estimate without any is compared; the scene
            in the middle of the exposure if None.
        reading: how the truth is read, see `tmca.read`.

    Raises:
        DataError, ShapeError: a truth that is smaller than the estimate, or has fewer bands, or values that are not
            finite; an estimate of several snapshots, which are evaluated one by one.
        SettingError: no estimate.

    Warns:
        SceneWarning: a truth of another name than the scene that is noted, a depth that was mapped onto the camera's
            range, or an estimate far outside 0 to 1.
    """
    return evaluation_of(estimate, truth, frames=frames, **reading).metrics


def evaluation_of(
    estimate: Estimate | Scene,
    truth: Scene,
    application: Application | None = None,
    *,
    frames: int | None = None,
    **reading: Any,
) -> Evaluation:
    """`evaluate` with what was compared; ``application`` is that of the estimate's file, where it is known."""
    file = isinstance(estimate, str | Path)
    where = str(estimate) if file else "estimate"
    application, camera, stored, parts = _labelled_estimate(estimate, truth, application, where, reading)
    if "snapshot" in stored.dims:
        several, remedy = f"{stored.sizes['snapshot']} snapshots", "take estimate.to_xarray().isel(snapshot=0), …"
        raise ShapeError(where, several, "one", remedy)
    for name in {} if file or isinstance(truth, str | Path) else reading:
        raise SettingError(name, "a way to read", "none of a truth in memory", "leave it out")
    scene = _true_scene(truth, application, camera, stored, reading)
    for name, light in ((where, _estimated(stored)), ("truth", light_of(scene))):
        check_light(light, name, -inf)
    _check_deviation(stored, where)
    warn_of_estimate(parts["values"], where)
    moved, count = moved_by(stored.attrs, where), _frames(stored, frames)
    if count is None:
        metrics = _measured(application, parts, scene, camera)
    else:
        pairs = frame_pairs(stored, scene, moved, count)
        metrics = mean_of([_measured(application, _parts(one), true, camera) for one, true in pairs])
    return Evaluation(application, camera, stored, scene, metrics)


def _parts_of_decoder(estimate: Estimate) -> dict[str, np.ndarray]:
    """What an estimate of a decoder is measured by, as `_parts`."""
    planes = {name: plane[0, 0] for name in _MAPS if (plane := getattr(estimate, name)) is not None}
    planes |= {} if estimate.deviation is None else {"deviation": estimate.deviation}
    return {name: values.numpy(force=True) for name, values in {"values": estimate.values, **planes}.items()}


def _labelled_estimate(
    estimate: Any, truth: Any, application: Application | None, where: str, reading: dict[str, Any]
) -> tuple[Application, Any, xr.Dataset, dict[str, np.ndarray]]:
    """Application and camera of an estimate, the estimate with its labels, and what it is measured by.

    Raises:
        SettingError, DataError: no estimate, or a damaged note in it.
    """
    if isinstance(estimate, Estimate):
        return application_of(estimate.camera), estimate.camera, estimate.to_xarray(), _parts_of_decoder(estimate)
    file = isinstance(estimate, str | Path)
    labelled = estimate if file else _as_dataset(estimate, truth)
    application = application or application_for(labelled)
    stored: xr.Dataset = application.stored(where, **reading) if file else labelled
    if not {"radiance", "estimate"} & set(stored):
        raise DataError(where, f"only {', '.join(map(str, stored))}", "estimate, or radiance and depth")
    camera = application.camera_of(stored, where)
    noted_reading(stored.attrs, where)  # refuses a damaged note
    return application, camera, stored, _parts(stored)


def _true_scene(
    truth: Any, application: Application, camera: Any, stored: xr.Dataset, reading: dict[str, Any]
) -> xr.DataArray | xr.Dataset:
    """The truth, brought to the camera of an estimate."""
    if isinstance(truth, str | Path):
        colours = "colour" in _estimated(stored).dims
        scene: xr.DataArray | xr.Dataset = application.truth(str(truth), camera, stored.attrs, colours, **reading)
        compare_scene(stored.attrs, str(truth))
        return scene
    labelled = application.scene(truth, camera, "truth")
    labelled = application.in_metres(labelled) if METRES in stored.attrs else labelled
    return application.fitted(labelled, camera, str(labelled.attrs.get("name", "truth")))


def _measured(application: Application, parts: Mapping[str, np.ndarray], scene: Any, camera: Any) -> dict[str, float]:
    """Figures of merit of the camera, and how well a predicted deviation tells its errors."""
    metrics, light = application.metrics(parts, scene, camera), np.asarray(light_of(scene).values)
    values, deviation = parts["values"], parts.get("deviation")
    if deviation is None or not values.size == light.size == deviation.size:
        return metrics
    return {**metrics, **certainty(values.ravel(), light.ravel(), deviation.ravel())}


def _check_deviation(stored: xr.Dataset, where: str) -> None:
    """Raises DataError for a deviation of every value, or every depth, that can be none."""
    depth = stored.get("depth")
    for name, values in (("deviation", _estimated(stored)), ("depth_deviation", depth)):
        if name not in stored or values is None or stored[name].dims != values.dims:
            continue
        deviation = stored[name]
        if deviation.dtype.kind not in "fiu":
            raise DataError(where, f"a deviation of {deviation.dtype}", "numbers", REMEDY)
        if not (np.isfinite(deviation.values) & (deviation.values >= 0) | np.isinf(values.values)).all():
            raise DataError(where, "deviations below 0, NaN or infinite", "standard deviations", REMEDY)


def _as_dataset(estimate: Any, truth: Any) -> xr.Dataset:
    """An estimate in memory as `Estimate.to_xarray` labels it; of an array with the labels of a truth of its shape.

    Raises:
        SettingError, DataError: no estimate.
    """
    if hasattr(estimate, "data_vars"):
        dataset: xr.Dataset = estimate
        return dataset
    if not isinstance(estimate, np.ndarray | Tensor) and not hasattr(estimate, "dims"):
        expected = "an Estimate, its to_xarray(), an array, or its file"
        raise SettingError("estimate", described(estimate), expected)
    labelled = estimate if hasattr(estimate, "dims") else _labelled(estimate, truth)
    bare = bare_cube(labelled)
    cube: xr.DataArray = labelled if bare is None else of_array(bare, "estimate")
    return cube.to_dataset(name="estimate").assign_attrs(cube.attrs)


def _labelled(values: np.ndarray | Tensor, truth: Any) -> xr.DataArray:
    """An array as a truth of its shape is labelled, a batch of one apart; else by its axes alone."""
    array = values.numpy(force=True) if isinstance(values, Tensor) else values
    shape = getattr(truth, "shape", None) if hasattr(truth, "coords") else None
    if shape is None or array.shape not in (shape, (1, *shape)):
        return of_array(array, "estimate")
    labelled: xr.DataArray = truth.copy(data=array.reshape(shape))
    return labelled


def _frames(stored: xr.Dataset, asked: int | None) -> int | None:
    """Frames to compare with: those of an estimate, or what is asked for."""
    own = stored.sizes.get(FRAMES)
    if own is not None and asked not in (None, own):
        raise SettingError("frames", str(asked), f"{own}, those of the estimate", "leave it out")
    if asked is not None and "depth" in stored:
        raise SettingError("frames", str(asked), "none of an estimate with depth", "leave it out")
    return asked if own is None else own


def application_for(estimate: xr.Dataset | str | Path) -> Application:
    """The application of an estimate, or of its file: of the camera that it names, else of what its axes look like.

    Raises:
        DataError: a file that cannot be described.
    """
    if isinstance(estimate, str | Path):
        about: Mapping[str, Any] = describe(estimate)
        if "snapshot" in about.get("variables", ()):
            raise DataError(estimate, "a snapshot", "an estimate of a scene", "run tmca reconstruct on it first")
    else:
        kind = "light field" if "view_v" in estimate.sizes else "cube"
        about = {"attrs": estimate.attrs, "kind": kind, "variables": set(estimate), "depth": "depth" in estimate}
    named = str(about.get("attrs", {}).get("camera", ""))
    if named and named not in APPLICATIONS:
        load_cameras()
    holders = (one for one in APPLICATIONS.values() if one.holds(about))
    return APPLICATIONS.get(named) or next(holders, APPLICATIONS["spectral"])


def metric_notes(metrics: Mapping[str, float]) -> dict[str, float]:
    """Metrics as attributes of an estimate's file."""
    return {f"metric_{name}": value for name, value in metrics.items()}


def _estimated(stored: xr.Dataset) -> xr.DataArray:
    return stored["radiance" if "radiance" in stored else "estimate"]


def _parts(stored: xr.Dataset) -> dict[str, np.ndarray]:
    """What an estimate is measured by: its values, snapshots or colours first, and its depth with its deviation."""
    values = _estimated(stored)
    several = "colour" in values.sizes or "snapshot" in values.sizes
    parts = {"values": values.values if several else values.values[None]}
    parts |= {name: stored[name].values for name in _MAPS if name in stored}
    spread = stored["deviation"].values if "deviation" in stored else None
    return parts | ({} if spread is None else {"deviation": spread if several else spread[None]})
