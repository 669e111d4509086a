"""Pairs of capture and truth, read and checked: codes, size, bands, light."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

from tmca.cameras import Snapshot
from tmca.decoders import OtherCodes, Weights
from tmca.errors import DataError, SettingError, ShapeError
from tmca.lab.calibration.apply import RAW, calibrated_snapshot
from tmca.lab.calibration.file import Calibration
from tmca.lab.notes import SATURATED
from tmca.training.camera_training import TRAININGS
from tmca.tuning.captures import Pair
from tmca.tuning.folder import PairFiles

if TYPE_CHECKING:
    import xarray as xr

_SATURATED = 0.01
"""Share of pixels at the top value of a capture above which they are no measurement."""
_LEVELS = 2.0
"""How many times brighter or darker than its capture a truth may be; faults of benches are far less."""


def read_pair(files: PairFiles, weights: Weights, calibration: Calibration | None) -> tuple[Pair, Any]:
    """A capture with its truth, and the camera that took it, calibrated where a calibration is given.

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
    return Pair(taken.values, _truth(files.truth, taken), taken.camera.sensor), taken.camera


def _truth(path: Path, taken: Snapshot[Any]) -> NDArray[np.float32]:
    """(B, L, H, W) what a capture shows, B the colours of a light field."""
    camera, training = taken.camera, TRAININGS[taken.camera.kind]
    scene = training.truth(str(path), camera, len(taken.values) > 1)
    size = (scene.sizes["y"], scene.sizes["x"])
    if size != tuple(camera.size):
        found, wanted = ("×".join(map(str, n)) for n in (size, camera.size))
        raise DataError(path, f"a truth of {found} pixels", f"{wanted}, those of the capture's scene", "crop it")
    _check_scale(path, scene["radiance"] if hasattr(scene, "data_vars") else scene)
    batch = training.batch(scene, camera)
    with torch.no_grad():
        times = float(training.exact(torch.from_numpy(batch), camera).mean() / taken.values.mean())
    if not 1 / _LEVELS < times < _LEVELS:
        found, wanted = f"a truth {times:.3g} times as bright as its capture", f"1, within a factor of {_LEVELS:g}"
        raise DataError(path, found, wanted, "give it in relative irradiance, or calibrate the level of the capture")
    return batch


def check_camera(where: Path, camera: Any, weights: Weights) -> None:
    """Raises DataError unless a capture's camera, before calibration, is the one that a network was trained for."""
    remedy = "take captures with the codes of the run (tmca export, tmca simulate --weights RUN)"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", OtherCodes)
            weights.check(camera)
    except (SettingError, ShapeError, OtherCodes) as error:
        raise DataError(where, f"a capture of another camera ({error})", "one of the run's", remedy) from error
    if not weights.same_codes(camera):
        raise DataError(where, "other codes than the run's", "those that its decoder was trained for", remedy)


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


def _check_scale(where: Path, scene: xr.DataArray) -> None:
    """Raises DataError for a truth whose white nobody knows: a capture has a scale of its own."""
    if scene.attrs.get("scale_from") == "maximum":
        found = f"values up to {float(scene.attrs.get('scale', np.nan)):g}"
        raise DataError(where, found, "relative irradiance from 0 to 1", "divide it by the level of white")
    if count := int((scene.values < 0).sum()):
        found = f"{count} negative value{'s' if count > 1 else ''}, down to {float(scene.min()):.3g}"
        raise DataError(where, found, "relative irradiance from 0 to 1", "set them to 0 in the file")
