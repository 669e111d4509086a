"""The spectral-depth camera that a training run starts from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from tmca.attributes import attributes_of
from tmca.cameras import SpectralDepthCamera
from tmca.cameras.phase_codes import read_phase_codes
from tmca.cameras.phase_settings import phase_settings
from tmca.cameras.sensor_tiles import check_holds
from tmca.codes.buckets import BURST, burst_pattern
from tmca.decoders import Weights
from tmca.errors import DataError, SettingError, ShapeError
from tmca.optics import (
    FreeForm,
    HeightMaps,
    PhaseAttributes,
    PhaseMaskBench,
    RotationalProfile,
    Stroke,
    ZernikeHeights,
    changed_bench,
)
from tmca.sensor import channel_response, feasible_filters

if TYPE_CHECKING:
    from tmca.training.spectral_depth import SpectralDepthTrainSettings

_OF_MASKS = ("mask", "bench", "stroke", "depth", "planes", "energy")
"""What is taken over of a static code that starts all slots."""
_OF_CAMERA = ("mask", "rms", "modes")
"""What a run may not ask for beside codes, if it is not what they have."""
_PARTS = ("mask", "shutter", "filters", "channels")
_FAMILIES: dict[str, type[HeightMaps]] = {"zernike": ZernikeHeights, "rotational": RotationalProfile}


def starting_camera(settings: SpectralDepthTrainSettings) -> SpectralDepthCamera:
    """The camera with the codes that a run starts from: the preset's, those of earlier weights, or of `tmca design`.

    It sees a patch with its margin. Codes that were designed or learned bring the camera that they were made for; those
    of one slot show their mask in every slot.

    Raises:
        SettingError, DataError: an impossible camera, or codes that do not fit it.
    """
    arguments = {name: value for name, value in settings.camera.model_dump().items() if value is not None}
    learn, preset = arguments.pop("learn"), SpectralDepthCamera.presets.get(settings.camera.preset, {})
    stroke, levels, bench = arguments.pop("stroke", None), arguments.pop("levels", None), arguments.pop("bench")
    arguments |= {} if stroke is None else {"stroke": Stroke(stroke[0], stroke[1], levels)}
    arguments |= {"bench": changed_bench(preset.get("bench", PhaseMaskBench()), bench)} if bench else {}
    if "slots" not in settings.camera.model_fields_set:
        arguments["slots"] = preset.get("slots", arguments["slots"])
    arguments["learnable"] = False if learn == "none" else learn
    start = settings.codes.start
    if start == "one-hot":
        arguments.setdefault("shutter", "one-hot")
    stored = start not in ("random", "one-hot")
    arguments |= _stored_arguments(Path(start), arguments, settings) if stored else {}
    arguments |= {"size": _size(arguments, settings)}
    try:
        return SpectralDepthCamera.from_preset(arguments.pop("preset"), **arguments)
    except ShapeError as error:
        if not stored:
            raise
        wanted = f"those of a camera like {settings.camera.preset}"
        raise DataError(start, f"codes that do not fit ({error})", wanted, "set camera.preset") from None


def usual_margin(window: tuple[int, int], period: int) -> int:
    """Pixels of scene around a patch where none are given: as far as light reaches, in whole tiles.

    Args:
        window: (h, w) of the point spread functions.
        period: of the tile of shutter and filters, pixels.
    """
    return -(-(max(window) // 2) // period) * period


def _size(arguments: dict[str, Any], settings: SpectralDepthTrainSettings) -> tuple[int, ...]:
    """(H, W) of a patch and its margin, of whole tiles.

    Raises:
        SettingError: another margin, a patch narrower than its blur, or scenes that need not hold patch and margin.
    """
    preset = SpectralDepthCamera.presets.get(settings.camera.preset, {})
    camera = {"period": 1, "bench": PhaseMaskBench(), **preset, **arguments}
    period, margin = camera["period"], settings.data.margin
    if margin is None:
        margin = usual_margin(camera["bench"].window, period)
    if margin % period:
        raise SettingError("data.margin", f"{margin} pixels", f"whole tiles of {period} pixels")
    check_holds(settings.camera.size, camera["bench"].window)
    size = tuple(side + 2 * margin for side in settings.camera.size)
    if settings.data.side < max(size):
        wanted = f"at least a patch and its margin, {max(size)} pixels"
        raise SettingError("data.side", f"{settings.data.side} pixels", wanted, "set it larger, or smaller patches")
    return size


def _stored_arguments(start: Path, asked: dict[str, Any], settings: SpectralDepthTrainSettings) -> dict[str, Any]:
    """Arguments of the camera that show the codes of weights, or of a file of `tmca design`, with all these were for.

    Masks go on in their family, or free-form if ``camera.mask`` says so.

    Raises:
        DataError: other numbers of slots.
        SettingError: another camera is asked for than the one that the codes were made for.
    """
    stored, slots = read_phase_codes(start) if start.suffix == ".nc" else _of_weights(start), asked["slots"]
    maps: HeightMaps = stored["mask"]
    if len(maps()) not in (1, slots):
        raise DataError(start, f"{len(maps())} slots", f"1 or {slots}", "set camera.slots")
    taken = _OF_MASKS if len(maps()) != slots else tuple(stored)
    for name in {*_OF_CAMERA, *taken} & settings.camera.model_fields_set - {"slots", "bench", "stroke"}:
        if not _alike(name, asked.get(name), stored):
            plain = name in _PARTS or stored.get(name) is None
            wanted = f"that of {start}" if plain else f"{stored[name]}, as in {start}"
            raise SettingError(
                f"camera.{name}", str(asked.get(name)), wanted, "leave it out, or start from other codes"
            )
    if asked.get("mask") == "free-form":
        maps = FreeForm(maps().detach(), maps.stroke)
    return {name: stored[name] for name in taken if name in stored and name != "slots"} | {"mask": maps.repeated(slots)}


def _alike(name: str, asked: Any, stored: dict[str, Any]) -> bool:
    """Whether codes have what is asked for by a setting, a name or numbers."""
    if name == "mask":
        return asked == "free-form" or isinstance(stored["mask"], _FAMILIES.get(asked, ()))
    if name == "shutter":
        slots, opened = stored["shutter"].shape[-3], stored["shutter"].sum(-3)
        if asked == BURST:
            return torch.equal(stored["shutter"], burst_pattern(slots, stored["shutter"].shape[-2:], stored["buckets"]))
        if stored["shutter"].ndim > 3:
            return False
        return bool((opened == {"open": slots, "one-hot": 1, "balanced": slots // 2}.get(asked, -1)).all())
    value = stored.get(name)
    if isinstance(value, Tensor):
        wanted = (feasible_filters if name == "filters" else channel_response)(asked, stored["bands"])
        return wanted.shape == value.shape and torch.allclose(wanted.to(value), value, atol=1e-6)
    return bool(asked == value)


def _of_weights(start: Path) -> dict[str, Any]:
    """What ``read_phase_codes`` says of a file, of a trained camera."""
    weights = Weights.load(start)
    camera = weights.camera
    sensor = {"filters": camera.filters.filters, "channels": camera.response, "bands": camera.wavelengths,
              "buckets": camera.buckets}  # fmt: skip
    stated = attributes_of(PhaseAttributes, weights.variables.attrs, start)
    return {**phase_settings(weights.variables, str(start), stated), **sensor, "exposure": camera.exposure}
