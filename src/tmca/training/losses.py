"""Training losses by name."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

_EDGE = 1e-3

Loss = Callable[[Tensor, Tensor], Tensor]


def squared(estimate: Tensor, truth: Tensor) -> Tensor:
    """Mean squared error (the thesis' L2)."""
    return (estimate - truth).square().mean()


def absolute(estimate: Tensor, truth: Tensor) -> Tensor:
    """Mean absolute error."""
    return (estimate - truth).abs().mean()


def charbonnier(estimate: Tensor, truth: Tensor) -> Tensor:
    """Mean of ``√(error² + ε²)``, an absolute error that is smooth at zero (Charbonnier et al. 1994); ε = 1e-3."""
    return ((estimate - truth).square() + _EDGE**2).sqrt().mean()


def logarithmic(estimate: Tensor, truth: Tensor) -> Tensor:
    """Mean over patches of ``log₁₀(mean squared error + ε²)``: 10 times it is the mean PSNR, so that dark patches count
    as much as bright ones; ε = 1e-3."""
    return ((estimate - truth).square().mean((1, 2, 3)) + _EDGE**2).log10().mean()


LOSSES: dict[str, Loss] = {"l2": squared, "l1": absolute, "charbonnier": charbonnier, "log": logarithmic}


def psnr_of(mean_squared_error: float) -> float:
    """dB against a peak of 1."""
    return float(-10 * torch.log10(torch.tensor(max(mean_squared_error, 1e-20))))
