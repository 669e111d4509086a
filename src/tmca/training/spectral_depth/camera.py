"""The spectral-depth camera that a training run starts from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from tmca.cameras import SpectralDepthCamera
from tmca.cameras.phase_codes import read_phase_codes
from tmca.cameras.sensor_tiles import check_holds
from tmca.decoders import Weights
from tmca.errors import DataError, SettingError, ShapeError
from tmca.optics import (
    FreeForm,
    HeightMaps,
    PhaseMaskBench,
    RotationalProfile,
    Stroke,
    ZernikeHeights,
    changed_bench,
)
from tmca.sensor import channel_response, feasible_filters
from tmca.training.spectral_depth.settings import SpectralDepthTrainSettings, usual_margin

_OF_MASKS = ("mask", "bench", "stroke", "depth", "planes", "energy")
"""What is taken over of a static code that starts all slots."""
_OF_CAMERA = ("mask", "rms", "modes")
"""What a run may not ask for beside codes, if it is not what they have."""
_PARTS = ("mask", "shutter", "filters", "channels")
_FAMILIES: dict[str, type[HeightMaps]] = {"zernike": ZernikeHeights, "rotational": RotationalProfile}


def training_camera(settings: SpectralDepthTrainSettings) -> SpectralDepthCamera:
    """The camera with the codes that a run starts from: the preset's, those of earlier weights, or of `tmca design`.

    It sees a patch with its margin. Codes that were designed or learned bring the camera that they were made for; those
    of one slot show their mask in every slot.

    Raises:
        SettingError, DataError: an impossible camera, or codes that do not fit it.
    """
    given = {name: value for name, value in settings.camera.model_dump().items() if value is not None}
    learn, preset = given.pop("learn"), SpectralDepthCamera.presets.get(settings.camera.preset, {})
    stroke, levels, bench = given.pop("stroke", None), given.pop("levels", None), given.pop("bench")
    given |= {} if stroke is None else {"stroke": Stroke(stroke[0], stroke[1], levels)}
    given |= {"bench": changed_bench(preset.get("bench", PhaseMaskBench()), bench)} if bench else {}
    if "slots" not in settings.camera.model_fields_set:
        given["slots"] = preset.get("slots", given["slots"])
    given["learnable"] = False if learn == "none" else learn
    start = settings.codes.start
    if start in ("random", "one-hot"):
        if start == "one-hot":
            given.setdefault("shutter", "one-hot")
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
    own = {
        "period": 1,
        "bench": PhaseMaskBench(),
        **SpectralDepthCamera.presets.get(settings.camera.preset, {}),
        **given,
    }
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

    Masks go on in their family, or free-form if ``camera.mask`` says so.

    Raises:
        DataError: other numbers of slots.
        SettingError: another camera is asked for than the one that the codes were made for.
    """
    found, slots = read_phase_codes(start) if start.suffix == ".nc" else _of_weights(start), given["slots"]
    maps: HeightMaps = found["mask"]
    if len(maps()) not in (1, slots):
        raise DataError(start, f"{len(maps())} slots", f"1 or {slots}", "set camera.slots")
    said = _OF_MASKS if len(maps()) != slots else tuple(found)
    for name in {*_OF_CAMERA, *said} & settings.camera.model_fields_set - {"slots", "bench", "stroke"}:
        if not _alike(name, given.get(name), found):
            own = found.get(name)
            known = f"that of {start}" if own is None or name in _PARTS else f"{own}, as in {start}"
            raise SettingError(f"camera.{name}", str(given.get(name)), known, "leave it out, or start from other codes")
    if given.get("mask") == "free-form":
        maps = FreeForm(maps().detach(), maps.stroke)
    return {name: found[name] for name in said if name in found and name != "slots"} | {"mask": maps.repeated(slots)}


def _alike(name: str, asked: Any, found: dict[str, Any]) -> bool:
    """Whether codes have what is asked for by a setting, a name or numbers."""
    if name == "mask":
        return asked == "free-form" or isinstance(found["mask"], _FAMILIES.get(asked, ()))
    if name == "shutter":
        opened = found["shutter"].sum(0)
        return bool((opened == {"open": len(found["shutter"]), "one-hot": 1}.get(asked, -1)).all())
    own = found.get(name)
    if isinstance(own, Tensor):
        made = feasible_filters if name == "filters" else channel_response
        wanted = made(asked, found["bands"])
        return wanted.shape == own.shape and torch.allclose(wanted.to(own), own, atol=1e-6)
    return bool(asked == own)


def _of_weights(start: Path) -> dict[str, Any]:
    """The same of a trained camera."""
    before = Weights.load(start).camera
    heights = before.point_spread.heights
    found = {"mask": heights, "shutter": before.tile()[1].detach(), "bench": before.bench, "bands": before.wavelengths}
    found |= {"stroke": heights.stroke, "depth": (before.planes.near, before.planes.far), "planes": before.planes.count}
    found |= {"filters": before.filters.filters, "cells": before.filters.cells(), "period": before.period}
    return found | {"channels": before.response, "exposure": before.exposure, "energy": before.point_spread.energy}
