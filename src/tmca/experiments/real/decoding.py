"""The decoders of the report on real captures."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders import Weights, decode, pnp_admm
from tmca.decoders.decoding import Decoded
from tmca.decoders.iterative.subspace import subspace_denoiser
from tmca.errors import SettingError

REAL_DECODERS = ("admm-tv", "pnp", "network")
_RANK, _ITERATIONS, _FALLING = 6, 40, (0.3, 0.02)


def decode_real(snapshot: Snapshot[SpectralCamera], method: str, weights: Weights | None = None) -> Decoded:
    """The scene of a real capture.

    Args:
        snapshot: with its camera.
        method: ``"admm-tv"`` (total variation over all bands together), ``"pnp"`` (plug-and-play ADMM, the components
            of the cube's own spectral subspace denoised one by one), ``"network"``.
        weights: of the network.

    Raises:
        SettingError: another method, or no weights for the network.
    """
    if method == "admm-tv":
        return decode(snapshot, "admm-tv-joint")
    if method == "pnp":
        return _plug_and_play(snapshot)
    if method == "network":
        return decode(snapshot, "network", weights=weights)
    raise SettingError("decoder", repr(method), f"one of {', '.join(REAL_DECODERS)}")


def check_real_decoders(names: Sequence[str], weights: object) -> None:
    """Raises SettingError for unknown decoders, or a network without weights."""
    for name in names:
        if name not in REAL_DECODERS:
            raise SettingError("--decoders", repr(name), f"some of {', '.join(REAL_DECODERS)}")
    if "network" in names and weights is None:
        raise SettingError("--weights", "none", "a run of `tmca train spectral --snapshot`", "or leave network out")


@torch.no_grad()
def _plug_and_play(snapshot: Snapshot[SpectralCamera]) -> Decoded:
    from skimage.restoration import denoise_tv_chambolle

    camera, start = snapshot.camera, time.perf_counter()
    level = float(camera.noise.variance(snapshot.values).mean().sqrt())

    def denoise(image: NDArray[np.floating], sigma: float) -> NDArray[np.floating]:
        return denoise_tv_chambolle(image, weight=sigma, max_num_iter=15)

    result = pnp_admm(
        camera.operator(), snapshot.values, subspace_denoiser(denoise, _RANK), noise_sigma=max(level, 1e-3),
        sigma=_FALLING, max_iterations=_ITERATIONS,
    )  # fmt: skip
    notes = {"iterations": result.iterations, "converged": result.converged, "rank": _RANK}
    return Decoded(result.estimate, seconds=time.perf_counter() - start, notes=notes)
