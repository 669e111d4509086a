"""Gradients of the posterior of blocks in their codes, in fewer passes over memory than those that PyTorch records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from tmca.operators.blocks import BlockModel, MeasurementCovariance


def _check_first() -> None:
    """Raises NotImplementedError where gradients are recorded to be differentiated again."""
    if torch.is_grad_enabled():
        raise NotImplementedError("second derivatives through the patch LMMSE: leave create_graph=True out")


class Signal(torch.autograd.Function):
    """(P, m, m) covariance A S Aᵀ of measurements, of weights (P, T, R·h, columns) and the cross (m, P, n), A S.

    S is symmetric: the gradient that reaches the weights through the cross is that of their direct use, so it is
    counted here, and none reaches the cross. Second derivatives raise NotImplementedError.
    """

    @staticmethod
    def forward(ctx: Any, weights: Tensor, cross: Tensor, model: BlockModel) -> Tensor:
        ctx.model = model
        ctx.save_for_backward(cross)
        return model.measure(weights, cross).transpose(0, 1)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None]:
        """Σ over m′ of (g + gᵀ)[m′, m] · (A S)[m′, pixel of tap t and m], of a gradient g (P, m, m)."""
        _check_first()
        (cross,) = ctx.saved_tensors
        return ctx.model.correlate((gradient + gradient.mT).transpose(0, 1).contiguous(), cross), None, None


class DisplacedSignal(torch.autograd.Function):
    """The same covariance of weights alone, under a stationary prior: no cross is made on the way."""

    @staticmethod
    def forward(ctx: Any, weights: Tensor, covariance: MeasurementCovariance) -> Tensor:
        ctx.covariance = covariance
        ctx.save_for_backward(weights)
        return covariance(weights)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        """That of the weights, of a gradient (P, m, m)."""
        _check_first()
        (weights,) = ctx.saved_tensors
        return ctx.covariance.slope(weights, gradient), None


class BlockProducts(torch.autograd.Function):
    """(Σ N, n) vectors (Σ N, m), as many of each block as ``counts`` says, times the block's matrix of (m, P, n); no
    block twice. Second derivatives raise NotImplementedError."""

    @staticmethod
    def forward(ctx: Any, matrices: Tensor, vectors: Tensor, blocks: Sequence[int], counts: Sequence[int]) -> Tensor:
        ctx.blocks, ctx.counts = blocks, counts
        ctx.save_for_backward(matrices, vectors)
        made = vectors.new_empty(len(vectors), matrices.shape[-1])
        for block, some, part in zip(blocks, vectors.split(counts), made.split(counts), strict=True):
            torch.mm(some, matrices[:, block], out=part)
        return made

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, Tensor, None, None]:
        """Those of the matrices, where they are wanted, and of the vectors, of a gradient (Σ N, n)."""
        _check_first()
        matrices, vectors = ctx.saved_tensors
        of_vectors, of_matrices = torch.empty_like(vectors), None
        if ctx.needs_input_grad[0]:
            every = len(ctx.blocks) == matrices.shape[1]
            of_matrices = torch.empty_like(matrices) if every else torch.zeros_like(matrices)
        parts = (part.split(ctx.counts) for part in (vectors, gradient, of_vectors))
        for block, some, slope, made in zip(ctx.blocks, *parts, strict=True):
            torch.mm(slope, matrices[:, block].mT, out=made)
            if of_matrices is not None:
                torch.mm(some.mT, slope, out=of_matrices[:, block])
        return of_matrices, of_vectors, None, None
