"""Scene → snapshot: the same for every camera."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import repeat
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from tmca.applications.base import Application, application_of
from tmca.applications.moving import MOTION
from tmca.arguments import Pair, Seed, checked
from tmca.cameras import Camera, Hardware, Snapshot, imperfect, moving_scenes
from tmca.cameras.motion import check_displacement
from tmca.data.in_memory import check_light
from tmca.data.scene_names import SOURCE_BANDS
from tmca.errors import SettingError
from tmca.progress import Asked, reporting
from tmca.sensor import Sensor

if TYPE_CHECKING:
    import xarray as xr

    Scene = str | Path | xr.DataArray | xr.Dataset | np.ndarray | Tensor
    Scenes = Scene | Sequence[Scene]
else:
    Scene = Scenes = Any

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
    scenes = _scenes(scene, application, camera, metric_depth)
    camera = camera.bound_to(**application.parts(scenes[0]))
    if isinstance(camera.sensor, Sensor):
        camera.sensor.warn_of_electrons()
    name = str(scenes[0].attrs.get("name", ""))
    fitted = list(map(application.fitted, scenes, repeat(camera), repeat(name or "scene")))
    for one in fitted:
        check_light(light_of(one), name or "scene")
    faults = hardware or Hardware()
    moved = motion if any(motion) else faults.movement
    check_displacement(moved, camera.size, "motion" if any(motion) else "hardware motion")
    light, *depth = _slots([application.tensors(one) for one in fitted], camera, moved)
    notes: dict[str, Any] = {"scene": name, "noise_seed": seed, **application.check(fitted[0], camera)}
    notes |= ({MOTION: list(moved)} if any(moved) else {}) | _left_out(scenes[0], fitted[0])
    with torch.no_grad(), reporting(progress, "simulate") as report:
        bench = imperfect(camera, faults, seed)
        values = bench(light, *depth, generator=NOISE_STREAM + seed, progress=report)
    notes |= {"hardware": faults.described()} if faults.faults() else {}
    return Snapshot(values, camera, notes)


def _scenes(given: Any, application: Application, camera: Camera, metric_depth: bool) -> list[Any]:
    """Labelled scenes of what is one or a list of them."""
    several: Sequence[Any] = given if isinstance(given, list | tuple) else [given]
    scenes = [application.scene(one, camera) for one in several]
    if not scenes:
        raise SettingError("scene", "an empty list", "one scene, or one for each slot")
    return [application.in_metres(one) for one in scenes] if metric_depth else scenes


def light_of(scene: Any) -> xr.DataArray:
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
