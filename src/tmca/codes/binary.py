"""Hard binary codes with a smooth derivative, so that devices show what training optimised."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor


class _HardThreshold(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, logits: Tensor, slope: float) -> Tensor:
        ctx.save_for_backward(logits)
        ctx.slope = slope
        return (logits > 0).to(logits.dtype)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None]:
        (logits,) = ctx.saved_tensors
        open_share = torch.sigmoid(ctx.slope * logits)
        return grads[0] * ctx.slope * open_share * (1 - open_share), None


def hard_threshold(logits: Tensor, slope: float = 4.0) -> Tensor:
    """Binary code ``1[logits > 0]`` with the derivative of ``sigmoid(slope · logits)``.

    Args:
        logits: any shape; its sign is the code.
        slope: steepness of the smooth stand-in, 1/unit of the logits; raised during training (annealing).

    Source: Martel et al. 2020, "Neural sensors", as used in thesis sections 3.1 and 4.2.
    """
    return _HardThreshold.apply(logits, float(slope))


def one_hot_slots(logits: Tensor, slope: float = 4.0) -> Tensor:
    """One-hot choice over the slot axis: 1 in the slot with the largest logit, derivative of the softmax.

    Args:
        logits: (K, H, W).
        slope: inverse temperature of the softmax.
    """
    soft = torch.softmax(slope * logits, dim=0)
    hard = torch.zeros_like(soft).scatter_(0, logits.argmax(0, keepdim=True), 1.0)
    return soft + (hard - soft).detach()
