"""The decoders of the report on real captures."""

from __future__ import annotations

import time
from collections.abc import Sequence

import torch

from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders import Weights, decode, pnp_admm
from tmca.decoders.decoding import Decoded
from tmca.decoders.subspace import subspace_denoiser
from tmca.errors import SettingError

REAL_DECODERS = ("admm-tv", "pnp", "network")
_RANK, _ITERATIONS, _FALLING = 4, 30, (0.3, 0.02)


def decode_real(snapshot: Snapshot[SpectralCamera], method: str, weights: Weights | None = None) -> Decoded:
    """The scene of a real capture.

    Args:
        snapshot: with its camera.
        method: ``"admm-tv"`` (total variation over all bands together), ``"pnp"`` (plug-and-play ADMM, non-local means
            on the components of the cube's own spectral subspace), ``"network"``.
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
    from skimage.restoration import denoise_nl_means

    camera, start = snapshot.camera, time.perf_counter()
    level = float(camera.noise.variance(snapshot.values).mean().sqrt())

    def non_local_means(image, sigma):  # type: ignore[no-untyped-def]
        return denoise_nl_means(image, 5, 5, h=0.8 * sigma, sigma=sigma, fast_mode=True)

    result = pnp_admm(
        camera.operator(), snapshot.values, subspace_denoiser(non_local_means, _RANK), noise_sigma=max(level, 1e-3),
        sigma=_FALLING, max_iterations=_ITERATIONS,
    )  # fmt: skip
    notes = {"iterations": result.iterations, "converged": result.converged, "rank": _RANK}
    return Decoded(result.estimate, seconds=time.perf_counter() - start, notes=notes)
