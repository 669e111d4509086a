"""Training of cameras with masks of pixels that are open or shut, whose slots collapse into one code."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.codes import pattern, read_codes, tile_of
from tmca.decoders import Network, SubspaceNetwork, Weights, build_network
from tmca.decoders.nets.tiles import CollapsedNetwork
from tmca.errors import DataError, SettingError
from tmca.operators import TapOperator
from tmca.training.camera_training import CameraTraining, NeededPrior
from tmca.training.coded_system import CodedSystem
from tmca.training.settings import MaskTrainSettings
from tmca.training.system import starts_from_prior

_JITTER = 0.9
"""Of the first logits' distances from the threshold: slots that start alike part ways."""


class MaskTraining(CameraTraining):
    """What the spectral and the light-field camera have in common."""

    def network(self, settings: MaskTrainSettings, camera: Any) -> Network:
        decoder = dict(settings.decoder)
        if "bands" in decoder:
            raise SettingError("decoder.bands", str(decoder["bands"]), "nothing: the data say it", "leave it out")
        if decoder.get("kind") == SubspaceNetwork.kind:
            wanted, remedy = "unet, unrolled or spatial-angular", "studies/shipped/train.py trains that of any bands"
            raise SettingError("decoder.kind", SubspaceNetwork.kind, wanted, remedy)
        if camera.buckets > 1:
            decoder["buckets"] = camera.buckets
        return build_network(decoder.pop("kind", "unrolled"), bands=camera.channels, **decoder)

    def needed_prior(self, settings: MaskTrainSettings, camera: Any, network: Any) -> NeededPrior | None:
        if not starts_from_prior(network):
            return None
        return NeededPrior("mixture" if network.start == "mixture" else "gaussian")

    def validation(self, name: str, channels: NDArray[np.float32], camera: Any) -> list[Tensor]:
        """See `CameraTraining`: the middle."""
        height, width = (min(pair) for pair in zip(channels.shape[1:], camera.size, strict=True))
        top, left = (channels.shape[1] - height) // 2, (channels.shape[2] - width) // 2
        return [torch.from_numpy(np.array(channels[:, top : top + height, left : left + width], dtype=np.float32))]

    def build_system(self, settings: Any, *given: Any, **how: Any) -> CodedSystem:
        codes = settings.codes if isinstance(settings, MaskTrainSettings) else None
        return CodedSystem(*given, codes=codes, **how)

    def decode(self, network: Any, prior: Any, values: Tensor, camera: Any) -> NDArray[np.float32]:
        """See `CameraTraining`; without negative irradiance."""
        collapsed = CollapsedNetwork(network, TapOperator(camera.taps()), camera.noise, prior)
        return collapsed(values).values.clamp_min(0).numpy()


def starting_arguments(settings: MaskTrainSettings, shutter_size: Callable[[], tuple[int, int]]) -> dict[str, Any]:
    """Arguments of the camera with the codes that a run starts from.

    Args:
        settings: of the run.
        shutter_size: (H, W) of the shutter's plane, asked for only where a full frame of it has to be made.

    Raises:
        SettingError: codes that are neither a name nor a file.
        DataError: codes of another period, disperser or number of slots.
    """
    learn = settings.camera.learn
    arguments = settings.camera.model_dump(exclude={"learn"}) | _starting_codes(settings, shutter_size)
    jitter = _JITTER if learn != "none" else 0.0
    return arguments | {"jitter": jitter, "learnable": {"both": True, "none": False}.get(learn, learn)}


def _starting_codes(settings: MaskTrainSettings, shutter_size: Callable[[], tuple[int, int]]) -> dict[str, Any]:
    """Patterns that take the place of the camera's families."""
    start, camera = settings.codes.start, settings.camera
    if start == "random":
        return {}
    if start == "one-hot":
        size = tile_of(camera.period) or shutter_size()
        return {"shutter": pattern("one-hot", camera.slots, size, camera.duty, 2 * camera.seed + 1)}
    if not Path(start).exists():
        raise SettingError("codes.start", repr(start), "'random', 'one-hot', a weights or codes file", "check the path")
    planes, about = _stored_codes(start)
    period, disperser, buckets = about["period"], about.get("disperser"), about.get("buckets", 1)
    if tile_of(period) != tile_of(camera.period) or disperser not in (None, getattr(camera, "disperser", None)):
        raise DataError(start, f"codes of period {period}", f"period {camera.period}", "set camera.period")
    slots = len(planes["aperture"])
    if slots not in (1, camera.slots):
        raise DataError(start, f"{slots} slots", f"1 or {camera.slots}", "set camera.slots")
    if buckets != camera.buckets:
        raise DataError(start, f"codes of {buckets} buckets", f"{camera.buckets}", f"set camera.buckets={buckets}")
    return {
        name: plane if plane.ndim == 4 else plane.expand(camera.slots, -1, -1).clone() for name, plane in planes.items()
    }


def _stored_codes(start: str) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Planes of weights or of a file of `tmca design`, and what it says: period, disperser and buckets if it does."""
    if Path(start).suffix == ".nc":
        stored = read_codes(start).settings()
        return {name: stored.pop(name) for name in ("aperture", "shutter")}, stored
    weights = Weights.load(start)
    weights.check_codes()
    planes = {name: weights.codes[name] for name in ("aperture", "shutter")}
    return planes, {**weights.variables.attrs, "period": weights.period}
