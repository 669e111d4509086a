"""Captures behind a per-pixel shutter: frames by several decoders, and how well they predict withheld pixels."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import torch
from scipy.ndimage import gaussian_filter, median_filter
from torch import Tensor

from studies.real.merit import neighbours_error, prediction_error, reprojection_error, withheld
from studies.real.records import MovieRow
from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders import decode, frame_operator
from tmca.metrics import psnr

_HOW: dict[str, dict[str, Any]] = {
    "kriging": {"decoder": "kriging"},
    "kriging, all changes": {"decoder": "kriging", "changing": 1.0, "lifetime": 48.0},
    "space-time-dct": {"decoder": "space-time-dct"},
}


class _Decoded(NamedTuple):
    """Frames (F, 1, H, W), those without the withheld pixels, and processor seconds of the first."""

    frames: Tensor
    blind: Tensor
    seconds: float


def study_movie(
    snapshot: Snapshot[SpectralCamera], capture: str, frames: int = 16, told: Callable[[str], None] | None = None
) -> tuple[list[MovieRow], dict[str, np.ndarray]]:
    """Rows of the table and frames (F, H, W) of every decoder for one capture."""
    blind, hidden = withheld(snapshot)
    found: dict[str, _Decoded] = {}
    for method, how in _HOW.items():
        if told:
            told(method)
        start = time.process_time()
        whole = decode(snapshot, frames=frames, **how).values[0]
        seconds = time.process_time() - start
        found[method] = _Decoded(whole, decode(blind, frames=frames, **how).values[0], seconds)
    shown = {method: decoded.frames[:, 0].numpy() for method, decoded in found.items()}
    agreement = float(psnr(*(np.clip(shown[name], 0, 1) for name in ("kriging", "space-time-dct"))))
    moving = hidden & moving_part(snapshot)
    rows = [_row(snapshot, capture, method, own, (hidden, moving), agreement) for method, own in found.items()]
    return rows, shown


def _row(
    snapshot: Snapshot[SpectralCamera], capture: str, method: str, decoded: _Decoded, parts: tuple[Tensor, Tensor],
    agreement: float,
) -> MovieRow:  # fmt: skip
    """What the frames explain of the capture, and those without some pixels predict of these and of moving ones."""
    operator, values = frame_operator(snapshot.camera, len(decoded.frames)), snapshot.values
    errors, moving = (prediction_error(operator, decoded.blind[None], values, part) for part in parts)
    return {
        "capture": capture, "decoder": method, "seconds": decoded.seconds,
        "reprojection": reprojection_error(operator, decoded.frames[None], values),
        "withheld": errors, "neighbours": neighbours_error(values, parts[0]),
        "withheld_moving": moving, "neighbours_moving": neighbours_error(values, parts[1]),
        "agreement_psnr": agreement,
    }  # fmt: skip


def moving_part(snapshot: Snapshot[SpectralCamera]) -> Tensor:
    """(H, W) True where neighbours, which saw other slots, differ: something moved there."""
    values = snapshot.values[0, 0].numpy()
    rough = gaussian_filter((values - median_filter(values, 5)) ** 2, 4)
    return torch.from_numpy(rough > 0.1 * np.quantile(rough, 0.99))
