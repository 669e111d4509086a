"""The codes that a training run starts from."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from torch import Tensor

from tmca.codes import pattern, read_codes
from tmca.decoders import Weights
from tmca.errors import DataError, SettingError
from tmca.training.settings import TrainSettings

_JITTER = 0.9
"""Of the first logits' distances from the threshold: slots that start alike part ways."""


def starting_settings(settings: TrainSettings, shutter_size: Callable[[], tuple[int, int]]) -> dict[str, Any]:
    """Arguments of the camera with the codes that the run starts from.

    Args:
        settings: of the run.
        shutter_size: (H, W) of the shutter's plane, asked for only where a full frame of it has to be made.
    """
    learn = settings.camera.learn
    described = settings.camera.model_dump(exclude={"learn"})
    learning = {"jitter": _JITTER if learn != "none" else 0.0}
    learnable = {"both": True, "none": False}.get(learn, learn)
    return {**described, **_starting_codes(settings, shutter_size), **learning, "learnable": learnable}


def _starting_codes(settings: TrainSettings, shutter_size: Callable[[], tuple[int, int]]) -> dict[str, Any]:
    """Patterns that take the place of the camera's families."""
    start, camera = settings.codes.start, settings.camera
    if start == "random":
        return {}
    if start == "one-hot":
        height, width = _pair(camera.period) or shutter_size()
        return {"shutter": pattern("one-hot", camera.slots, (height, width), camera.duty, 2 * camera.seed + 1)}
    if not Path(start).exists():
        raise SettingError("codes.start", repr(start), "'random', 'one-hot', a weights or codes file", "check the path")
    planes, period, disperser = _stored_codes(start)
    if _pair(period) != _pair(camera.period) or disperser not in (None, getattr(camera, "disperser", None)):
        raise DataError(start, f"codes of period {period}", f"period {camera.period}", "set camera.period")
    slots = len(planes["aperture"])
    if slots not in (1, camera.slots):
        raise DataError(start, f"{slots} slots", f"1 or {camera.slots}", "set camera.slots")
    return {name: plane.expand(camera.slots, -1, -1).clone() for name, plane in planes.items()}


def _pair(period: Any) -> tuple[int, int] | None:
    """(rows, columns) of a period."""
    if period is None:
        return None
    return (period, period) if isinstance(period, int) else (int(period[0]), int(period[1]))


def _stored_codes(start: str) -> tuple[dict[str, Tensor], Any, str | None]:
    """Planes, period and disperser (None where the file does not say) of weights, or of a file of `tmca design`."""
    if Path(start).suffix == ".nc":
        found = read_codes(start).settings()
        return {name: found[name] for name in ("aperture", "shutter")}, found["period"], None
    weights = Weights.load(start)
    planes = {name: weights.codes[name] for name in ("aperture", "shutter")}
    return planes, weights.period, weights.variables.attrs.get("disperser")
