"""The decoders of the report on real captures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders import Estimate, Weights, decode
from tmca.errors import SettingError

_METHODS = {"admm-tv": "admm-tv-joint", "pnp": "pnp-subspace", "network": "network"}
REAL_DECODERS = tuple(_METHODS)


def decode_real(snapshot: Snapshot[SpectralCamera], method: str, weights: Weights | None = None) -> Estimate:
    """The scene of a real capture.

    Args:
        snapshot: with its camera.
        method: ``"admm-tv"`` (total variation over all bands together), ``"pnp"`` (plug-and-play ADMM in the cube's own
            spectral subspace), ``"network"``; for `tmca.decoders.decode` admm-tv-joint, pnp-subspace, network.
        weights: of the network.

    Raises:
        SettingError: another method, or no weights for the network.
    """
    if method not in _METHODS:
        raise SettingError("decoder", repr(method), f"one of {', '.join(REAL_DECODERS)}")
    settings: dict[str, Any] = {"weights": weights} if method == "network" else {}
    return decode(snapshot, _METHODS[method], **settings)


def check_real_decoders(names: Sequence[str], weights: object) -> None:
    """Raises SettingError for unknown decoders, or a network without weights."""
    for name in names:
        if name not in REAL_DECODERS:
            raise SettingError("--decoders", repr(name), f"some of {', '.join(REAL_DECODERS)}")
    if "network" in names and weights is None:
        raise SettingError("--weights", "none", "a run of `tmca train spectral --snapshot`", "or leave network out")
