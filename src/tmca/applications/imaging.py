"""Scene → snapshot → scene again, and how good it is: the same for every camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from tmca.applications.base import APPLICATIONS, Application, application_of, noted_reading
from tmca.applications.moving import FRAMES, MOTION, frame_pairs, mean_of, moved_by
from tmca.arguments import Pair, Seed, checked, described
from tmca.attributes import REMEDY
from tmca.cameras import Camera, Hardware, Snapshot, imperfect, load_cameras, moving_scenes
from tmca.cameras.motion import check_displacement
from tmca.data import describe
from tmca.data.fitting import METRES
from tmca.data.in_memory import bare_cube, check_light, warn_of_estimate
from tmca.data.scene_names import SOURCE_BANDS, compare_scene
from tmca.data.unlabelled import of_array
from tmca.decoders import Estimate
from tmca.errors import DataError, SettingError, ShapeError
from tmca.metrics import certainty
from tmca.plots.estimates import mean_frame
from tmca.progress import Asked, reporting
from tmca.sensor import Sensor

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    Scene = str | Path | xr.DataArray | xr.Dataset | np.ndarray | Tensor
    Scenes = Scene | Sequence[Scene]
else:
    Scene = Scenes = Any

_MAPS = ("depth", "depth_deviation")
"""Of an estimate, by which it is measured beside its values."""
NOISE_STREAM = 0x9E3779B9
"""Added to the seed of the noise: codes draw from seeds below it (torch uses the lower 32 bits only)."""


@checked
def simulate(
    scene: Scenes,
    camera: Camera,
    *,
    seed: Seed = 0,
    motion: Pair = (0.0, 0.0),
    hardware: Hardware | None = None,
    metric_depth: bool = False,
    progress: Asked = None,
) -> Snapshot[Any]:
    """Take a snapshot of a scene.

    Args:
        scene: of the camera's kind in relative irradiance, 1 = white: as `tmca.read` gives it, what it reads, or an
            array or a tensor as the camera's scenes are; or a list of one scene for each slot. What the camera's
            constructor left out, size and bands or views, is taken from it; of a larger scene the middle.
        camera: that takes it; the snapshot holds it, bound to the scene.
        seed: of the sensor's noise, whose stream no code shares.
        motion: rows and columns by which the scene moves from the beginning to the end of the exposure, pixels; the
            scene is its place in the middle.
        hardware: faults of the bench that takes it; the snapshot's camera is the one that is known.
        metric_depth: keep the depth of a scene in metres. Without it, depth beyond the range of a spectral-depth camera
            is mapped onto this range, evenly in inverse depth.
        progress: called with the share that is done; True for a bar, False for none; None for one that is shown after
            a second in a terminal or a notebook.

    Raises:
        SettingError: faults that this camera cannot have, another number of scenes than slots, several that move, or
            metric_depth of a scene without depth.
        DataError, ShapeError: a scene that the camera cannot image, or one with NaN, infinite or negative values.

    Warns:
        SceneWarning: a scene with values above 1, or depth that was mapped.
        SensorWarning: a read noise that looks like one in electrons.
    """
    application = application_of(camera)
    several: Sequence[Any] = scene if isinstance(scene, list | tuple) else [scene]
    scenes = [application.scene(one, camera) for one in several]
    if not scenes:
        raise SettingError("scene", "an empty list", "one scene, or one for each slot")
    scenes = [application.in_metres(one) for one in scenes] if metric_depth else scenes
    camera = camera.bound_to(**application.parts(scenes[0]))
    if isinstance(camera.sensor, Sensor):
        camera.sensor.warn_of_electrons()
    name = str(scenes[0].attrs.get("name", ""))
    fitted = list(map(application.fitted, scenes, repeat(camera), repeat(name or "scene")))
    for one in fitted:
        check_light(_light(one), name or "scene")
    faults = hardware or Hardware()
    moved = motion if any(motion) else faults.movement
    check_displacement(moved, camera.size, "motion" if any(motion) else "hardware motion")
    light, *depth = _slots([application.tensors(one) for one in fitted], camera, moved)
    notes: dict[str, Any] = {"scene": name, "noise_seed": seed, **application.check(fitted[0], camera)}
    notes |= {MOTION: list(moved)} if any(moved) else {}
    notes |= _left_out(scenes[0], fitted[0])
    with torch.no_grad(), reporting(progress, "simulate") as report:
        bench = imperfect(camera, faults, seed)
        values = bench(light, *depth, generator=NOISE_STREAM + seed, progress=report)
    notes |= {"hardware": faults.described()} if faults.faults() else {}
    return Snapshot(values, camera, notes)


def _light(scene: Any) -> xr.DataArray:
    """The irradiance of a labelled scene."""
    light: xr.DataArray = scene["radiance"] if hasattr(scene, "data_vars") else scene
    return light


def _left_out(scene: Any, fitted: Any) -> dict[str, int]:
    """How many bands there are where only some of them are imaged, as a note."""
    there = int(scene.attrs.get(SOURCE_BANDS, scene.sizes.get("wavelength", 0)))
    return {SOURCE_BANDS: there} if there > fitted.sizes.get("wavelength", 0) else {}


def _slots(scenes: list[tuple[Tensor, ...]], camera: Camera, motion: tuple[float, float]) -> tuple[Tensor, ...]:
    """One scene, one for every slot on an axis of its own, or one that moves; and its depth."""
    if len(scenes) == 1:
        light, *depth = scenes[0]
        return (moving_scenes(light, motion, camera.slots) if any(motion) else light, *depth)
    if len(scenes) != camera.slots:
        raise SettingError("scenes", f"{len(scenes)}", f"one, or one for each of {camera.slots} slots")
    if any(motion):
        both = f"{motion[0]:g},{motion[1]:g} of {len(scenes)} scenes"
        raise SettingError("motion", both, "one scene that moves, or one for each slot, at rest in it")
    return tuple(torch.stack(parts, 1) for parts in zip(*scenes, strict=True))


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
    where = str(estimate) if isinstance(estimate, str | Path) else "estimate"
    if isinstance(estimate, Estimate):
        application, camera, stored = application_of(estimate.camera), estimate.camera, estimate.to_xarray()
        parts = {"values": estimate.values.numpy(force=True)}
        for name in _MAPS:
            plane = getattr(estimate, name)
            parts |= {} if plane is None else {name: plane[0, 0].numpy(force=True)}
        parts |= {} if estimate.deviation is None else {"deviation": estimate.deviation.numpy(force=True)}
    else:
        if not isinstance(estimate, str | Path):
            estimate = _as_dataset(estimate, truth)
        application = application or application_for(estimate)
        stored = application.stored(where, **reading) if isinstance(estimate, str | Path) else estimate
        if not {"radiance", "estimate"} & set(stored):
            raise DataError(where, f"only {', '.join(map(str, stored))}", "estimate, or radiance and depth")
        camera, parts = application.camera_of(stored, where), _parts(stored)
        noted_reading(stored.attrs, where)  # refuses a damaged note
    if "snapshot" in stored.dims:
        found, remedy = f"{stored.sizes['snapshot']} snapshots", "take estimate.to_xarray().isel(snapshot=0), …"
        raise ShapeError(where, found, "one", remedy)
    if isinstance(truth, str | Path):
        colours = "colour" in _estimated(stored).dims
        scene = application.truth(str(truth), camera, stored.attrs, colours, **reading)
        compare_scene(stored.attrs, str(truth))
    else:
        for name in {} if isinstance(estimate, str | Path) else reading:
            raise SettingError(name, "a way to read", "none of a truth in memory", "leave it out")
        labelled = application.scene(truth, camera, "truth")
        labelled = application.in_metres(labelled) if METRES in stored.attrs else labelled
        scene = application.fitted(labelled, camera, str(labelled.attrs.get("name", "truth")))
    for name, light in ((where, _estimated(stored)), ("truth", _light(scene))):
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


def _measured(application: Application, parts: Mapping[str, np.ndarray], scene: Any, camera: Any) -> dict[str, float]:
    """Figures of merit of the camera, and how well a predicted deviation tells its errors."""
    metrics, light = application.metrics(parts, scene, camera), np.asarray(_light(scene).values)
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
