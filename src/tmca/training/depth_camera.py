"""The spectral-depth camera that a training run starts from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from tmca.cameras import SpectralDepthCamera
from tmca.cameras.checks import check_holds
from tmca.cameras.phase_codes import read_phase_codes
from tmca.cameras.presets import SPECTRAL_DEPTH_PRESETS
from tmca.decoders.depth_weights import DepthWeights
from tmca.errors import DataError, SettingError, ShapeError
from tmca.optics import PhaseMaskBench, Stroke, changed_bench
from tmca.training.depth_settings import SpectralDepthTrainSettings, usual_margin

_OF_MASKS = ("mask", "bench", "stroke", "depth", "planes", "energy")
"""What is taken over of a static code that starts all slots."""
_ASKED = ("depth", "planes", "filters", "channels", "exposure", "period")
"""What a run may ask for beside codes to start from, if it is what they were made for."""


def training_camera(settings: SpectralDepthTrainSettings) -> SpectralDepthCamera:
    """The camera with the codes that a run starts from: the preset's, those of earlier weights, or of `tmca design`.

    It sees a patch with its margin. Codes that were designed or learned bring the camera that they were made for; those
    of one slot show their mask in every slot.

    Raises:
        SettingError, DataError: an impossible camera, or codes that do not fit it.
    """
    given = {name: value for name, value in settings.camera.model_dump().items() if value is not None}
    learn, preset = given.pop("learn"), SPECTRAL_DEPTH_PRESETS.get(settings.camera.preset, {})
    stroke, levels, bench = given.pop("stroke", None), given.pop("levels", None), given.pop("bench")
    given |= {} if stroke is None else {"stroke": Stroke(stroke[0], stroke[1], levels)}
    given |= {"bench": changed_bench(preset.get("bench", PhaseMaskBench()), bench)} if bench else {}
    if "slots" not in settings.camera.model_fields_set:
        given["slots"] = preset.get("slots", given["slots"])
    given["learnable"] = False if learn == "none" else learn
    start = settings.codes.start
    if start in ("random", "one-hot"):
        given |= {"shutter": "one-hot"} if start == "one-hot" else {}
        return SpectralDepthCamera.from_preset(given.pop("preset"), **_with_margin(given, settings))
    given |= _started(Path(start), given, settings)
    given = _with_margin(given, settings)
    try:
        return SpectralDepthCamera.from_preset(given.pop("preset"), **given)
    except ShapeError as error:
        known = f"those of a camera like {settings.camera.preset}"
        raise DataError(start, f"codes that do not fit ({error})", known, "set camera.preset") from None


def _with_margin(given: dict[str, Any], settings: SpectralDepthTrainSettings) -> dict[str, Any]:
    """Arguments of the camera with the size of a patch and its margin, of whole tiles.

    Raises:
        SettingError: another margin, a patch narrower than its blur, or scenes that need not hold patch and margin.
    """
    own = {"period": 1, "bench": PhaseMaskBench(), **SPECTRAL_DEPTH_PRESETS.get(settings.camera.preset, {}), **given}
    period, margin = own["period"], settings.data.margin
    if margin is None:
        margin = usual_margin(own["bench"].window, period)
    if margin % period:
        raise SettingError("data.margin", f"{margin} pixels", f"whole tiles of {period} pixels")
    check_holds(settings.camera.size, own["bench"].window)
    size = tuple(side + 2 * margin for side in settings.camera.size)
    if settings.data.side < max(size):
        known = f"at least a patch and its margin, {max(size)} pixels"
        raise SettingError("data.side", f"{settings.data.side} pixels", known, "set it larger, or smaller patches")
    return {**given, "size": size}


def _started(start: Path, given: dict[str, Any], settings: SpectralDepthTrainSettings) -> dict[str, Any]:
    """Arguments of the camera that show the codes of weights, or of a file of `tmca design`, with all these were for.

    Raises:
        DataError: other numbers of slots.
        SettingError: another camera is asked for than the one that the codes were made for.
    """
    found = read_phase_codes(start) if start.suffix == ".nc" else _of_weights(start)
    slots = len(found["mask"])
    if slots not in (1, given["slots"]):
        raise DataError(start, f"{slots} slots", f"1 or {given['slots']}", "set camera.slots")
    said = _OF_MASKS if slots != given["slots"] else tuple(found)
    for name in {*_ASKED} & {*said} & settings.camera.model_fields_set:
        if given.get(name) != found[name] and not isinstance(found[name], torch.Tensor):
            known = f"{found[name]}, as in {start}"
            raise SettingError(f"camera.{name}", str(given.get(name)), known, "leave it out, or start from other codes")
    taken = {name: found[name] for name in said if name in found and name not in ("mask", "slots")}
    return taken | {"mask": found["mask"].expand(given["slots"], -1, -1).clone()}


def _of_weights(start: Path) -> dict[str, Any]:
    """The same of a trained camera."""
    before = DepthWeights.load(start).camera
    heights = before.spread.heights
    found = {"mask": heights().detach(), "shutter": before.tile()[1].detach(), "bench": before.bench}
    found |= {"stroke": heights.stroke, "depth": (before.planes.near, before.planes.far), "planes": before.planes.count}
    found |= {"filters": before.filters.filters, "cells": before.filters.cells(), "period": before.period}
    return found | {"channels": before.response, "exposure": before.exposure, "energy": before.spread.energy}
