"""The three faces of one trilinear form, each the derivative of the others.

``⟨y, A(code) x⟩ = Σ_t Σ_{b,m,n} y[b, m, n + o_t] · code[t, m, n] · x[b, c_t, m, n]``: ``project`` is its gradient in y
(the forward model), ``backproject`` in x (the adjoint) and ``correlate`` in the code. One multiply-add per tap, in
place, on views of the snapshot: the floor is reading the scene once.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

Layout = tuple[tuple[int, ...], tuple[int, ...], int, int]
"""(channels, offsets, scene channels L, snapshot width W')."""


def project(scene: Tensor, code: Tensor, layout: Layout) -> Tensor:
    """(B, L, H, W), (t, H, W) → snapshot (B, 1, H, W')."""
    return _Project.apply(scene, code, layout)


def backproject(snapshot: Tensor, code: Tensor, layout: Layout) -> Tensor:
    """(B, 1, H, W'), (t, H, W) → scene (B, L, H, W)."""
    return _Backproject.apply(snapshot, code, layout)


def correlate(scene: Tensor, snapshot: Tensor, layout: Layout) -> Tensor:
    """(B, L, H, W), (B, 1, H, W') → code (t, H, W)."""
    return _Correlate.apply(scene, snapshot, layout)


class _Project(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, scene: Tensor, code: Tensor, layout: Layout) -> Tensor:
        ctx.save_for_backward(scene, code)
        ctx.layout = layout
        channels, offsets, _, width = layout
        snapshot = scene.new_zeros(scene.shape[0], 1, scene.shape[2], width)
        columns = code.shape[2]
        for t, (channel, offset) in enumerate(zip(channels, offsets, strict=True)):
            snapshot[:, 0, :, offset : offset + columns].addcmul_(scene[:, channel], code[t])
        return snapshot

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        scene, code = ctx.saved_tensors
        to_scene = backproject(grads[0], code, ctx.layout) if ctx.needs_input_grad[0] else None
        to_code = correlate(scene, grads[0], ctx.layout) if ctx.needs_input_grad[1] else None
        return to_scene, to_code, None


class _Backproject(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, snapshot: Tensor, code: Tensor, layout: Layout) -> Tensor:
        ctx.save_for_backward(snapshot, code)
        ctx.layout = layout
        channels, offsets, scene_channels, _ = layout
        columns = code.shape[2]
        scene = snapshot.new_empty(snapshot.shape[0], scene_channels, *code.shape[1:])
        seen: set[int] = set()
        for t, (channel, offset) in enumerate(zip(channels, offsets, strict=True)):
            light = snapshot[:, 0, :, offset : offset + columns]
            if channel in seen:
                scene[:, channel].addcmul_(light, code[t])
            else:
                torch.mul(light, code[t], out=scene[:, channel])
                seen.add(channel)
        for channel in set(range(scene_channels)) - seen:
            scene[:, channel] = 0
        return scene

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        snapshot, code = ctx.saved_tensors
        to_snapshot = project(grads[0], code, ctx.layout) if ctx.needs_input_grad[0] else None
        to_code = correlate(grads[0], snapshot, ctx.layout) if ctx.needs_input_grad[1] else None
        return to_snapshot, to_code, None


class _Correlate(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, scene: Tensor, snapshot: Tensor, layout: Layout) -> Tensor:
        ctx.save_for_backward(scene, snapshot)
        ctx.layout = layout
        channels, offsets, _, _ = layout
        batch, _, rows, columns = scene.shape
        code = scene.new_empty(len(channels), rows, columns)
        for t, (channel, offset) in enumerate(zip(channels, offsets, strict=True)):
            light = snapshot[:, 0, :, offset : offset + columns]
            torch.mul(scene[0, channel], light[0], out=code[t])
            for b in range(1, batch):
                code[t].addcmul_(scene[b, channel], light[b])
        return code

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        scene, snapshot = ctx.saved_tensors
        to_scene = backproject(snapshot, grads[0], ctx.layout) if ctx.needs_input_grad[0] else None
        to_snapshot = project(scene, grads[0], ctx.layout) if ctx.needs_input_grad[1] else None
        return to_scene, to_snapshot, None
