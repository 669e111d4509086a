"""Scene → snapshot → scene again, and how good it is: the same for every camera."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from tmca.applications.base import Application, application_of
from tmca.cameras import Camera, Hardware, Snapshot, imperfect, moving_scenes
from tmca.cameras.motion import check_displacement
from tmca.decoders import Estimate
from tmca.decoders.estimate import PLANES
from tmca.errors import DataError, SettingError
from tmca.optics import DepthPlanes

if TYPE_CHECKING:
    import xarray as xr

    Scene = str | xr.DataArray | xr.Dataset

NOISE_STREAM = 0x9E3779B9
"""Added to the seed of the noise: codes draw from seeds below it (torch uses the lower 32 bits only)."""


def simulate(
    scene: Scene | Sequence[Scene],
    camera: Camera,
    *,
    seed: int = 0,
    motion: tuple[float, float] = (0.0, 0.0),
    hardware: Hardware | None = None,
    progress: Callable[[float], None] | None = None,
) -> Snapshot[Any]:
    """Take a snapshot of a scene.

    Args:
        scene: of the camera's kind, as `tmca.read` gives it, or what it reads; or one scene for each slot. What the
            camera's constructor left out, size and bands or views, is taken from it; of a larger scene the middle.
        camera: that takes it; the snapshot holds it, bound to the scene.
        seed: of the sensor's noise, whose stream no code shares.
        motion: rows and columns by which the scene moves from the beginning to the end of the exposure, pixels; the
            scene is its place in the middle.
        hardware: faults of the bench that takes it; the snapshot's camera is the one that is known.
        progress: called with the share that is done.

    Raises:
        SettingError: faults that this camera cannot have, another number of scenes than slots, or several that move.
        DataError: a scene that the camera cannot image.
    """
    application = application_of(camera)
    several = list(scene) if isinstance(scene, Sequence) and not isinstance(scene, str) else [scene]
    scenes = [application.read(one) if isinstance(one, str) else one for one in several]
    camera = camera.bound_to(**application.parts(scenes[0]))
    name = str(scenes[0].attrs.get("name", ""))
    fitted = [application.fitted(one, camera, name or "scene") for one in scenes]
    faults = hardware or Hardware()
    moved = motion if any(motion) else faults.movement
    check_displacement(moved, camera.size, "motion" if any(motion) else "hardware's motion")
    light, *depth = _slots([application.tensors(one) for one in fitted], camera, moved)
    notes: dict[str, Any] = {"scene": name, "noise_seed": seed, **application.check(fitted[0], camera)}
    notes |= {"motion_pixels": list(moved)} if any(moved) else {}
    with torch.no_grad():
        bench = imperfect(camera, faults, seed)
        values = bench(light, *depth, generator=NOISE_STREAM + seed, progress=progress)
    notes |= {"hardware": faults.described()} if faults.faults() else {}
    return Snapshot(values, camera, notes)


def _slots(scenes: Sequence[tuple[Tensor, ...]], camera: Camera, motion: tuple[float, float]) -> tuple[Tensor, ...]:
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


def evaluate(estimate: Estimate | xr.Dataset | str | Path, truth: Scene) -> dict[str, float]:
    """Figures of merit of an estimate, against the scene that it is of.

    Args:
        estimate: of a decoder, its file, or what it holds.
        truth: the scene, as `tmca.read` gives it, or what it reads; brought to the bands and size of the estimate.

    Raises:
        DataError: a truth that is smaller than the estimate, or has fewer bands.
    """
    if isinstance(estimate, Estimate):
        application = application_of(estimate.camera)
        fitted = fitted_truth(application, truth, estimate.camera)
        parts = {"values": estimate.values.numpy(force=True)}
        if estimate.depth is not None:
            parts["depth"] = estimate.depth[0, 0].numpy(force=True)
        return application.metrics(parts, fitted, estimate.camera)
    return _evaluate_file(estimate, truth)


def fitted_truth(application: Application, truth: Scene, camera: Any) -> Any:
    """A scene, or what reads as one, as a camera sees it."""
    scene = application.read(truth) if isinstance(truth, str) else truth
    return application.fitted(scene, camera, str(scene.attrs.get("name", "truth")))


def _evaluate_file(estimate: xr.Dataset | str | Path, truth: Scene) -> dict[str, float]:
    """`evaluate` of what an estimate's file holds."""
    from tmca.data import read_dataset

    where = "estimate" if not isinstance(estimate, str | Path) else str(estimate)
    stored = read_dataset(estimate) if isinstance(estimate, str | Path) else estimate
    name = next((part for part in ("radiance", "estimate") if part in stored), None)
    if name is None:
        raise DataError(where, f"only {', '.join(map(str, stored))}", "estimate, or radiance and depth")
    values, seen = stored[name], _as_seen(stored, stored[name], where)
    application = application_of(seen.kind)
    parts = {"values": values.values if seen.colours else values.values[None]}
    parts |= {"depth": stored["depth"].values} if seen.planes else {}
    return application.metrics(parts, fitted_truth(application, truth, seen), seen)


@dataclass(frozen=True)
class _Seen:
    """What an estimate's file says of the camera that it is of; enough to fit a truth to it."""

    kind: str
    size: tuple[int, int]
    wavelengths: tuple[float, ...] = ()
    views: tuple[int, int] = (1, 1)
    planes: DepthPlanes | None = None
    colours: bool = False


def _as_seen(stored: xr.Dataset, values: xr.DataArray, where: str) -> _Seen:
    size = (values.sizes["y"], values.sizes["x"])
    if "view_v" in values.sizes:
        views = (values.sizes["view_v"], values.sizes["view_u"])
        return _Seen("light-field", size, views=views, colours="colour" in values.sizes)
    waves = tuple(values["wavelength"].values.tolist())
    if "depth" not in stored:
        return _Seen("spectral", size, waves)
    if PLANES not in stored.attrs:
        raise DataError(where, f"no attribute {PLANES}", "the depth planes of the camera", "reconstruct it again")
    return _Seen("spectral-depth", size, waves, planes=DepthPlanes(**json.loads(stored.attrs[PLANES])))
