"""First estimates from which networks start."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from tmca.decoders.lmmse import PatchLMMSE
from tmca.errors import SettingError
from tmca.operators import TapOperator
from tmca.priors import GaussianPrior
from tmca.sensor import Noise

STARTS = ("adjoint", "dagger", "lmmse")
_LEAST_READ_NOISE = 5e-4
"""Snapshot units: float32 is enough above it, and networks have no use for more."""


def first_estimate(
    kind: str,
    snapshot: Tensor,
    operator: TapOperator,
    noise: Noise,
    prior: GaussianPrior | None = None,
    *,
    differentiable: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Tensor:
    """(B, 1, H, W') → (B, L, H, W).

    Args:
        kind: ``"adjoint"`` (Φᵀy, the thesis' start), ``"dagger"`` (least-norm scene) or ``"lmmse"``.
        snapshot: in snapshot units.
        operator: that took it.
        noise: of the sensor.
        prior: for the LMMSE.
        differentiable: let gradients reach code and snapshot through the LMMSE too.
        progress: told the share of the LMMSE that is done.

    Raises:
        SettingError: unknown kind, or no prior for the LMMSE.
    """
    if kind == "adjoint":
        return operator.A_adjoint(snapshot)
    if kind == "dagger":
        return operator.A_dagger(snapshot)
    if kind != "lmmse":
        raise SettingError("start", repr(kind), f"one of {', '.join(STARTS)}")
    if prior is None:
        raise SettingError("prior", "none", "a Gaussian prior for a network that starts from the LMMSE")
    read = max(noise.read, _LEAST_READ_NOISE)
    decoder = PatchLMMSE(prior, dtype=torch.float32)
    found = decoder(snapshot, operator.taps, read, noise.shot, differentiable=differentiable, progress=progress)
    return found.estimate.to(snapshot.dtype)
