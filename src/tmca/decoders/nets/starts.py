"""First estimates that networks start from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from tmca.arguments import described
from tmca.decoders.admm import least_variation, usual_weight
from tmca.decoders.batches import one_by_one
from tmca.decoders.decoder import Progress
from tmca.decoders.least_squares import tikhonov
from tmca.decoders.lmmse import PatchEstimator
from tmca.decoders.nets.network import NEED_PRIOR, STARTS
from tmca.errors import SettingError, check_choice
from tmca.operators import TapOperator
from tmca.priors import GaussianMixturePrior, GaussianPrior
from tmca.sensor import Noise

VARIATION = "admm-tv-joint"
"""Name of a first estimate that no network learned from: it needs no prior of scenes, which real ones may be unlike."""
_LEAST_READ_NOISE = 5e-4
"""Snapshot units: float32 is enough above it, and networks have no use for more."""
Start = Callable[[Tensor, Progress | None], Tensor]
"""Makes first estimates (B, L, H, W) of snapshots (B, R, H, W')."""
Starts = Callable[[TapOperator], Start]


@dataclass(frozen=True)
class PatchStart:
    """First estimates (B, L, H, W) by the patch LMMSE or mixture."""

    estimator: PatchEstimator

    def __call__(self, snapshot: Tensor, progress: Progress | None) -> Tensor:
        return self.estimator(snapshot, progress=progress).estimate.to(snapshot.dtype)


def prepared_start(
    kind: str,
    operator: TapOperator,
    noise: Noise,
    prior: GaussianPrior | GaussianMixturePrior | None = None,
    *,
    differentiable: bool = False,
) -> Start:
    """What makes first estimates (B, L, H, W) of snapshots (B, 1, H, W') of one camera.

    Args:
        kind: ``"adjoint"`` (Φᵀy, the thesis' start), ``"dagger"`` (least-norm scene), ``"tikhonov"`` (least squares
            with a smooth scene), ``"lmmse"`` or ``"mixture"``.
        operator: that took the snapshots.
        noise: of the sensor.
        prior: for the LMMSE, or of the mixture.
        differentiable: let gradients reach code and snapshot through Tikhonov's or the LMMSE too.

    Raises:
        SettingError: unknown kind, no prior, or one of the other kind.
    """

    def smooth(snapshot: Tensor, progress: Progress | None) -> Tensor:
        with torch.set_grad_enabled(differentiable and torch.is_grad_enabled()):
            return tikhonov(operator, snapshot, progress=progress)

    check_choice("start", kind, STARTS)
    if kind not in NEED_PRIOR:
        adjoint, dagger = operator.A_adjoint, operator.A_dagger
        return {"adjoint": lambda y, _: adjoint(y), "dagger": lambda y, _: dagger(y), "tikhonov": smooth}[kind]
    if not isinstance(prior, GaussianPrior if kind == "lmmse" else GaussianMixturePrior):
        found = "none" if prior is None else described(prior)
        raise SettingError("prior", found, f"one for a network that starts from {kind}")
    quiet = Noise(max(noise.read, _LEAST_READ_NOISE), noise.shot)
    return PatchStart(PatchEstimator(prior, operator.taps, quiet, dtype=torch.float32, differentiable=differentiable))


def first_estimate(
    kind: str,
    snapshot: Tensor,
    operator: TapOperator,
    noise: Noise,
    prior: GaussianPrior | GaussianMixturePrior | None = None,
    *,
    differentiable: bool = False,
) -> Tensor:
    """(B, 1, H, W') → (B, L, H, W); arguments and errors as in `prepared_start`."""
    return prepared_start(kind, operator, noise, prior, differentiable=differentiable)(snapshot, None)


@dataclass(frozen=True)
class VariationStart:
    """First estimates of least total variation, see `tmca.decoders.admm.least_variation`.

    Args:
        operator: that took the snapshots.
        noise: of the sensor.
        gain: see `tmca.decoders.least_squares.exposure_gain`.
    """

    operator: TapOperator
    noise: Noise
    gain: float = 1.0

    @torch.no_grad()
    def __call__(self, snapshot: Tensor, progress: Progress | None) -> Tensor:
        return torch.cat([self._of_one(one, report) for one, report in one_by_one(snapshot, progress)])

    def _of_one(self, snapshot: Tensor, progress: Progress | None) -> Tensor:
        weight = usual_weight(float(self.noise.variance(snapshot).mean().sqrt()), self.gain)
        return least_variation(self.operator, snapshot, weight, joint=True, progress=progress).estimate
