"""The decoders of the report on real captures; estimates are computed once and used again by the next report."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import torch
from torch import Tensor

from studies.grid import source
from tmca.cameras import Snapshot, SpectralCamera
from tmca.data import atomic_path
from tmca.decoders import Weights, decode
from tmca.errors import SettingError, check_choice

START, ADAPT = "admm-tv-joint", 60
"""Of the network: it starts from total variation, which needs no scenes, and learns from the snapshot, in so many steps
at most."""
_METHODS: dict[str, tuple[str, dict[str, Any]]] = {
    "admm-tv": ("admm-tv-joint", {}),
    "pnp": ("pnp-subspace", {}),
    "network": ("network", {"start": START, "adapt": ADAPT}),
}
"""Decoders of the report, and those of `tmca.decoders.decode` with their settings: total variation over all bands
together, plug-and-play ADMM in the cube's own spectral subspace, a network."""
REAL_DECODERS = tuple(_METHODS)


def check_real_decoders(names: Sequence[str]) -> None:
    """Raises SettingError for no or unknown decoders."""
    if not names:
        raise SettingError("--decoders", "none", f"some of {', '.join(REAL_DECODERS)}")
    for name in names:
        check_choice("--decoders", name, REAL_DECODERS)


def stored_estimate(
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
    if (stored := _stored(file)) is not None:
        return stored
    start = time.process_time()
    method, settings = _METHODS[decoder]
    learned: dict[str, Any] = {"weights": weights} if decoder == "network" else {}
    estimate = decode(snapshot, method, **settings, **learned).values.float()
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
    digest = hashlib.sha256(repr((source("real/decoding.py"), *map(repr, optics))).encode())
    learned = weights.network.state_dict().values() if weights is not None and decoder == "network" else ()
    for values in (snapshot.values, *camera.codes(), *learned):
        digest.update(values.detach().float().numpy().tobytes())
    return digest.hexdigest()[:12]
