"""Pairs of capture and truth, read and checked: codes, size, bands, light."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

from tmca.cameras import Snapshot, SpectralDepthCamera
from tmca.decoders import Weights
from tmca.decoders.nets.weights import same_bands
from tmca.errors import DataError
from tmca.lab.calibration.apply import RAW, calibrated_snapshot
from tmca.lab.calibration.file import Calibration
from tmca.lab.notes import SATURATED
from tmca.training.captures import Pair
from tmca.tuning.folder import PairFiles

if TYPE_CHECKING:
    import xarray as xr

_SATURATED = 0.01
"""Share of pixels at the top value of a capture above which they are no measurement."""
_LEVELS = 2.0
"""How many times brighter or darker than its capture a truth may be; faults of benches are far less."""


def read_pair(files: PairFiles, weights: Weights, calibration: Calibration | None) -> tuple[Pair, Any]:
    """A capture with its truth, and the camera that took it as it is known.

    Args:
        files: of it.
        weights: that are fine-tuned.
        calibration: of the camera; None for the camera as the snapshot file has it.

    Raises:
        DataError: a capture by another camera or other codes, saturated or dark; a calibration that does not fit; a
            truth of another size, other bands, not in relative irradiance, or far brighter or darker than its capture.
    """
    taken = Snapshot.load(files.capture)
    check_camera(files.capture, taken.camera, weights)
    _check_saturation(files.capture, taken)
    if calibration is not None:
        taken = calibrated_snapshot(taken, calibration)
    elif taken.notes.get("values") == RAW:
        remedy = "name the calibration of its camera (--calibration)"
        raise DataError(files.capture, "a capture in digital numbers", "relative irradiance", remedy)
    _check_light(files.capture, taken)
    truth = _TRUTHS[taken.camera.kind](files.truth, taken)
    _check_level(files.truth, truth, taken)
    return Pair(taken.values, truth, taken.camera.sensor), taken.camera


def check_camera(where: Path, camera: Any, weights: Weights) -> None:
    """Raises DataError unless a capture's camera, before calibration, is the one that a network was trained for."""
    remedy = "take captures with the codes of the run (tmca export, tmca simulate --weights RUN)"
    if camera.kind != weights.kind:
        raise DataError(where, f"a capture of a {camera.kind} camera", f"one of a {weights.kind} camera", remedy)
    if isinstance(camera, SpectralDepthCamera):
        _check_bands(where, camera, weights)
        if other := weights.differences(camera):
            raise DataError(where, f"a camera with other {', '.join(other)} than the run's", "the run's", remedy)
        return
    if camera.channels != weights.network.bands:
        unit = f"{camera.channel}s"
        raise DataError(where, f"{camera.channels} {unit}", f"{weights.network.bands}, those of the run's network")
    _check_bands(where, camera, weights)
    if camera.slots != weights.slots or not weights.same_codes(camera):
        raise DataError(where, "other codes than the run's", "those that its decoder was trained for", remedy)
    trained = weights.camera_for(camera.size)
    for name in ("dispersion", "disperser", "shear", "exposure"):
        if getattr(camera, name, None) != getattr(trained, name, None):
            raise DataError(where, f"another {name} than the run's", "the run's own, before it is calibrated", remedy)


def _check_bands(where: Path, camera: Any, weights: Weights) -> None:
    if weights.wavelengths and not same_bands(weights.wavelengths, camera.wavelengths):
        raise DataError(where, "bands at other wavelengths than the run's", "the same, to a nanometre")


def _check_saturation(where: Path, taken: Snapshot[Any]) -> None:
    """Raises DataError for a capture many of whose pixels are at its top: clipped light is no measurement."""
    values, top = taken.values, taken.values.max()
    clipped = taken.notes.get("values") == RAW or float(top) >= taken.camera.full_scale
    share = float(taken.notes.get(SATURATED, (values >= top).float().mean() if clipped else 0))
    if share > _SATURATED:
        found = f"{share:.0%} of the pixels saturated"
        raise DataError(where, found, f"{_SATURATED:.0%} at most", "expose for less time")


def _check_light(where: Path, taken: Snapshot[Any]) -> None:
    """Raises DataError for a capture that is not brighter than its noise."""
    least = 3 * taken.camera.noise.read / np.sqrt(taken.values.numel())
    if float(taken.values.mean()) <= least:
        raise DataError(where, "a capture without light", "one of a scene", "check lamp, shutter and lens cap")


def _check_level(where: Path, truth: NDArray[np.float32], taken: Snapshot[Any]) -> None:
    """Raises DataError for a truth that is far brighter or darker than what its capture shows."""
    camera, light = taken.camera, torch.from_numpy(truth)
    with torch.no_grad():
        if isinstance(camera, SpectralDepthCamera):
            image = camera.A(light[:, :-1], camera.planes.depth_of(light[:, -1:]))
        else:
            image = camera.operator().A(light)
    times = float(image.mean() / taken.values.mean())
    if not 1 / _LEVELS < times < _LEVELS:
        found, wanted = f"a truth {times:.3g} times as bright as its capture", f"1, within a factor of {_LEVELS:g}"
        raise DataError(where, found, wanted, "give it in relative irradiance, or calibrate the level of the capture")


def _true_cube(path: Path, taken: Snapshot[Any]) -> NDArray[np.float32]:
    """(1, L, H, W)."""
    from tmca.data import nearest_bands
    from tmca.data.scenes import load_scene

    cube = load_scene(path, bands=None, negative="keep")
    check_size(path, cube, taken.camera.size)
    check_scale(path, cube)
    return np.asarray(nearest_bands(cube, taken.camera.wavelengths).values, dtype=np.float32)[None]


def check_size(where: Path, scene: xr.DataArray | xr.Dataset, size: tuple[int, int]) -> None:
    """Raises DataError unless a truth has the pixels of its capture."""
    found = (scene.sizes["y"], scene.sizes["x"])
    if found != tuple(size):
        own, wanted = ("×".join(map(str, n)) for n in (found, size))
        raise DataError(where, f"a truth of {own} pixels", f"{wanted}, those of the capture's scene", "crop it")


def check_scale(where: Path, scene: xr.DataArray) -> None:
    """Raises DataError for a truth whose white nobody knows: a capture has a scale of its own."""
    if scene.attrs.get("scale_from") == "maximum":
        found = f"values up to {float(scene.attrs.get('scale', np.nan)):g}"
        raise DataError(where, found, "relative irradiance from 0 to 1", "divide it by the level of white")
    if count := int((scene.values < 0).sum()):
        found = f"{count} negative value{'s' if count > 1 else ''}, down to {float(scene.min()):.3g}"
        raise DataError(where, found, "relative irradiance from 0 to 1", "set them to 0 in the file")


def _true_views(path: Path, taken: Snapshot[Any]) -> NDArray[np.float32]:
    """(B, V·U, H, W), B the colours."""
    from tmca.data.light_field_scenes import as_batch, load_light_field

    camera = taken.camera
    field = load_light_field(str(path), views=None, colour=len(taken.values) > 1)
    views = (field.sizes["view_v"], field.sizes["view_u"])
    if views != camera.views:
        own, wanted = ("×".join(map(str, n)) for n in (views, camera.views))
        raise DataError(path, f"a truth of {own} views", f"{wanted}, those of the camera")
    check_size(path, field, camera.size)
    check_scale(path, field)
    return as_batch(field).flatten(1, 2).numpy()


def _true_depth(path: Path, taken: Snapshot[Any]) -> NDArray[np.float32]:
    """(1, L + 1, H, W), the last channel inverse depth."""
    from tmca.data.depth_scenes import load_spectral_depth
    from tmca.training.spectral_depth import depth_channels

    camera = taken.camera
    near, far = camera.planes.near, camera.planes.far
    scene = load_spectral_depth(str(path), camera.wavelengths, near=near, far=far, fitted=False)
    check_size(path, scene, camera.size)
    check_scale(path, scene["radiance"])
    found = depth_channels(scene, camera)
    if not np.isfinite(found[-1]).any():
        metres = scene["depth"].values
        said = f"depths of {np.nanmin(metres):.3g} to {np.nanmax(metres):.3g} m"
        raise DataError(path, said, f"some of the camera's {near:g} to {far:g} m", "capture nearer or farther scenes")
    return found[None]


_TRUTHS: dict[str, Callable[[Path, Snapshot[Any]], NDArray[np.float32]]] = {
    "spectral": _true_cube, "light-field": _true_views, "spectral-depth": _true_depth,
}  # fmt: skip
