"""First estimates from which networks start."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from tmca.decoders.iterative.tikhonov import tikhonov
from tmca.decoders.patch_based.lmmse import PatchLMMSE
from tmca.decoders.patch_based.mixture import MixtureLMMSE
from tmca.decoders.patch_based.patches import PatchDecoder
from tmca.errors import SettingError
from tmca.operators import TapOperator
from tmca.priors import GaussianMixturePrior, GaussianPrior
from tmca.sensor import Noise

STARTS = ("adjoint", "dagger", "tikhonov", "lmmse", "mixture")
NEED_PRIOR = ("lmmse", "mixture")
_LEAST_READ_NOISE = 5e-4
"""Snapshot units: float32 is enough above it, and networks have no use for more."""


def first_estimate(
    kind: str,
    snapshot: Tensor,
    operator: TapOperator,
    noise: Noise,
    prior: GaussianPrior | GaussianMixturePrior | None = None,
    *,
    differentiable: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Tensor:
    """(B, 1, H, W') → (B, L, H, W).

    Args:
        kind: ``"adjoint"`` (Φᵀy, the thesis' start), ``"dagger"`` (least-norm scene), ``"tikhonov"`` (least squares
            with a smooth scene), ``"lmmse"`` or ``"mixture"``.
        snapshot: in snapshot units.
        operator: that took it.
        noise: of the sensor.
        prior: for the LMMSE, or of the mixture.
        differentiable: let gradients reach code and snapshot through Tikhonov's or the LMMSE too.
        progress: told the share of the LMMSE that is done.

    Raises:
        SettingError: unknown kind, no prior, or one of the other kind.
    """
    if kind == "adjoint":
        return operator.A_adjoint(snapshot)
    if kind == "dagger":
        return operator.A_dagger(snapshot)
    if kind == "tikhonov":
        with torch.set_grad_enabled(differentiable and torch.is_grad_enabled()):
            return tikhonov(operator, snapshot, progress=progress)
    if kind not in NEED_PRIOR:
        raise SettingError("start", repr(kind), f"one of {', '.join(STARTS)}")
    decoder = _patch_decoder(kind, prior)
    read = max(noise.read, _LEAST_READ_NOISE)
    found = decoder(snapshot, operator.taps, read, noise.shot, differentiable=differentiable, progress=progress)
    return found.estimate.to(snapshot.dtype)


def _patch_decoder(kind: str, prior: GaussianPrior | GaussianMixturePrior | None) -> PatchDecoder:
    if kind == "lmmse" and isinstance(prior, GaussianPrior):
        return PatchLMMSE(prior, dtype=torch.float32)
    if kind == "mixture" and isinstance(prior, GaussianMixturePrior):
        return MixtureLMMSE(prior, dtype=torch.float32)
    found = "none" if prior is None else f"a {type(prior).__name__}"
    raise SettingError("prior", found, f"one for a network that starts from {kind}")
