"""Captures behind a per-pixel shutter: frames by several decoders, and how well they foretell withheld pixels."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders.space_time import frame_operator
from tmca.experiments.real.merit import foretelling_error, neighbours_error, reprojection_error, withheld
from tmca.lab.movies import Movie, decode_movie
from tmca.metrics import psnr

_HOW: dict[str, dict[str, Any]] = {
    "kriging": {"method": "kriging"},
    "kriging, all changes": {"method": "kriging", "changing": 1.0, "lifetime": 48.0},
    "space-time-dct": {"method": "space-time-dct"},
}


def study_movie(
    snapshot: Snapshot[SpectralCamera], frames: int = 16, told: Callable[[str], None] | None = None
) -> tuple[list[dict[str, Any]], dict[str, np.ndarray]]:
    """Rows of the table and frames (F, H, W) of every decoder for one capture."""
    rows, found = [], {}
    for method, how in _HOW.items():
        if told:
            told(method)
        start = time.process_time()
        movie = decode_movie(snapshot, frames, **how)
        seconds = time.process_time() - start
        rows.append({"decoder": method, "seconds": seconds, **_errors(snapshot, movie, frames, how)})
        found[method] = movie.frames[:, 0].numpy()
    agreed = float(psnr(*(np.clip(found[name], 0, 1) for name in ("kriging", "space-time-dct"))))
    return [{**row, "agreement_psnr": agreed} for row in rows], found


def _errors(snapshot: Snapshot[SpectralCamera], movie: Movie, frames: int, how: dict[str, Any]) -> dict[str, float]:
    """What the frames explain of the capture, and those without some pixels foretell of these and of moving ones."""
    operator, (blind, hidden) = frame_operator(snapshot.camera, frames), withheld(snapshot)
    guessed, values = decode_movie(blind, frames, **how).frames[None], snapshot.values
    errors = {"reprojection": reprojection_error(operator, movie.frames[None], values)}
    for ending, part in (("", hidden), ("_moving", hidden & moving_part(snapshot))):
        errors[f"withheld{ending}"] = foretelling_error(operator, guessed, values, part)
        errors[f"neighbours{ending}"] = neighbours_error(values, part)
    return errors


def moving_part(snapshot: Snapshot[SpectralCamera]) -> Any:
    """(H, W) True where neighbours, which saw other slots, differ: something moved there."""
    import torch
    from scipy.ndimage import gaussian_filter, median_filter

    values = snapshot.values[0, 0].numpy()
    rough = gaussian_filter((values - median_filter(values, 5)) ** 2, 4)
    return torch.from_numpy(rough > 0.1 * np.quantile(rough, 0.99))
