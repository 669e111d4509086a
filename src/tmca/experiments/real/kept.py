"""Estimates of real captures that are computed once and used again by the next report."""

from __future__ import annotations

import hashlib
import time
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import torch
from torch import Tensor

from tmca.cameras import Snapshot, SpectralCamera
from tmca.data.files import atomic_path
from tmca.decoders import Weights
from tmca.experiments.real.decoding import decode_real
from tmca.experiments.source import source_digest


def kept_estimate(
    folder: Path, name: str, snapshot: Snapshot[SpectralCamera], decoder: str, weights: Weights | None = None
) -> tuple[Tensor, float]:
    """An estimate and the processor seconds it took, read where the same input was decoded before.

    Args:
        folder: of the files, which exists.
        name: of this estimate.
        snapshot: with its camera.
        decoder: of ``REAL_DECODERS``.
        weights: of the network.

    Returns:
        (1, L, H, W) and seconds.
    """
    file = folder / f"{name}-{_input_digest(snapshot, decoder, weights)}.npz"
    known = _stored(file)
    if known is not None:
        return known
    start = time.process_time()
    estimate = decode_real(snapshot, decoder, weights).values.float()
    seconds = time.process_time() - start
    with atomic_path(file, overwrite=True) as part:
        np.savez(part, estimate=estimate.numpy(), seconds=seconds)
    return estimate, seconds


def _stored(file: Path) -> tuple[Tensor, float] | None:
    """What was computed before; None where there is no file, or one that is cut short."""
    try:
        with np.load(file) as stored:
            return torch.from_numpy(stored["estimate"]), float(stored["seconds"])
    except (OSError, EOFError, KeyError, ValueError, BadZipFile):
        return None


def _input_digest(snapshot: Snapshot[SpectralCamera], decoder: str, weights: Weights | None) -> str:
    """Of what an estimate depends on: the source of the decoders, values, camera, and a network's weights."""
    camera = snapshot.camera
    optics = (camera.dispersion, camera.response, camera.exposure, camera.noise)
    found = hashlib.sha256(repr((source_digest("tmca.experiments.real.decoding"), *map(repr, optics))).encode())
    learned = weights.network.state_dict().values() if weights is not None and decoder == "network" else ()
    for values in (snapshot.values, *camera.codes(), *learned):
        found.update(values.detach().float().numpy().tobytes())
    return found.hexdigest()[:12]
