"""Kernels of the collapsed cameras: two trilinear forms, each with three faces that are the derivatives of each other.

**Taps**, ``Σ_t Σ_{b,m,n} y[b, r_t, m, n + o_t] · code[t, m, n] · x[b, c_t, m, n]``: the face of y is the forward model,
that of x the adjoint; r_t is the bucket that a tap fills. One multiply-add per tap, in place, on views of the
snapshot: the floor is reading the scene once.

**Sheared codes**, ``Σ_t Σ_k code[t] · near[k] · wide[k, r_t : r_t + H, c_t : c_t + W]``: the face of the code is the
time-multiplexed code cube (thesis eqs 12, 20), one plane of codes seen through a shifted copy of the other. The single
disperser has the aperture near the scene and the wider shutter behind the prism; the dual disperser and the light-field
camera have the wider aperture in front of the shutter. The K slots are summed once here, so that the cost of a batch no
longer depends on K.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import pad

Layout = tuple[tuple[int, ...], tuple[int, ...], int, int, int]
"""(channels, offsets, scene channels L, snapshot width W', buckets R) of taps, those of a bucket after each other."""
Offsets = Sequence[tuple[int, int]]
"""(row, column) at which every window of the wide planes begins, ≥ 0."""
Faces = tuple[Callable[[Tensor, Tensor, Any], Tensor], ...]
"""Derivatives of a form in its three arguments: functions of the two that follow, the first after the third."""


def project(scene: Tensor, code: Tensor, layout: Layout) -> Tensor:
    """(B, L, H, W), (t, H, W) → snapshot (B, R, H, W')."""
    return _Face.apply(_TAPS, 0, scene, code, layout)


def backproject(snapshot: Tensor, code: Tensor, layout: Layout) -> Tensor:
    """(B, R, H, W'), (t, H, W) → scene (B, L, H, W)."""
    return _Face.apply(_TAPS, 1, code, snapshot, layout)


def sheared_code(near: Tensor, wide: Tensor, offsets: Offsets) -> Tensor:
    """(K, H, W), (K, H', W') → sum over slots of the product for every offset, (t, H, W)."""
    return _Face.apply(_SHEAR, 0, near, wide, (offsets, wide.shape[1:]))


class _Face(torch.autograd.Function):
    """One face of a form, whose derivatives are the other two."""

    @staticmethod
    def forward(ctx: Any, faces: Faces, place: int, one: Tensor, other: Tensor, layout: Any) -> Tensor:
        ctx.save_for_backward(one, other)
        ctx.form = faces, place, layout
        return faces[place](one, other, layout)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[None, None, Tensor | None, Tensor | None, None]:
        (one, other), (faces, place, layout) = ctx.saved_tensors, ctx.form
        following, last = (place + 1) % 3, (place + 2) % 3
        to_one = _Face.apply(faces, following, other, grads[0], layout) if ctx.needs_input_grad[2] else None
        to_other = _Face.apply(faces, last, grads[0], one, layout) if ctx.needs_input_grad[3] else None
        return None, None, to_one, to_other, None


def _taps(layout: Layout) -> Iterator[tuple[int, int]]:
    """(index, channel) of every tap, those of all buckets together: they read the same channel."""
    channels, *_, buckets = layout
    share = len(channels) // buckets
    for t in range(share):
        for bucket in range(buckets):
            yield bucket * share + t, channels[t]


def _windows(snapshot: Tensor, columns: int, layout: Layout) -> list[Tensor]:
    """(B, H, columns) what every tap reads of a snapshot, or fills, views. Slicing once for each tap would take as
    long as the products of a small scene."""
    _, offsets, _, _, buckets = layout
    share, step = len(offsets) // buckets, _even_step(layout)
    if not step:
        planes = snapshot.unbind(1)
        return [planes[t // share].narrow(-1, offset, columns) for t, offset in enumerate(offsets)]
    return [one for plane in snapshot.unbind(1) for one in plane.unfold(-1, columns, step).unbind(2)[:share]]


def _even_step(layout: Layout) -> int | None:
    """Columns from tap to tap where every channel has one and they lie in even steps from column 0; None otherwise."""
    channels, offsets, count, _, buckets = layout
    share = len(channels) // buckets
    step = offsets[1] if share > 1 else 0
    even = channels[:share] == tuple(range(count)) and offsets[:share] == tuple(step * t for t in range(share))
    return step if even else None


def _in_one_go(tensor: Tensor, layout: Layout) -> bool:
    """Whether all taps are computed at once: on a device where launching an operation costs more than it does."""
    return tensor.device.type != "cpu" and _even_step(layout) is not None


def sheared_snapshot(scene: Tensor, code: Tensor, layout: Layout) -> Tensor:
    """``_snapshot_of_taps`` in two passes over all taps: products with room for the light that is displaced, and their
    sum in a view that reads every tap so many columns earlier, where the one before ends in zeros."""
    *_, width, buckets = layout
    light = pad(scene[:, None] * code.unflatten(0, (buckets, -1)), (0, width - code.shape[2])).contiguous()
    strides = list(light.stride())
    strides[2] -= _even_step(layout) or 0
    return light.as_strided(light.shape, strides).sum(2)


def _light_of_taps(snapshot: Tensor, columns: int, layout: Layout) -> Tensor:
    """(B, R, L, H, W) what every tap of every bucket reads of a snapshot, a view."""
    step, count = _even_step(layout), layout[2]
    if not step:
        return snapshot[:, :, None, :, :columns].expand(-1, -1, count, -1, -1)
    return snapshot.unfold(-1, columns, step)[:, :, :, :count].transpose(2, 3)


def _snapshot_of_taps(scene: Tensor, code: Tensor, layout: Layout) -> Tensor:
    if _in_one_go(scene, layout):
        return sheared_snapshot(scene, code, layout)
    *_, width, buckets = layout
    snapshot = scene.new_zeros(scene.shape[0], buckets, scene.shape[2], width)
    windows, bands, codes = _windows(snapshot, code.shape[2], layout), scene.unbind(1), code.unbind(0)
    for t, channel in _taps(layout):
        windows[t].addcmul_(bands[channel], codes[t])
    return snapshot


def sheared_scene(code: Tensor, snapshot: Tensor, layout: Layout) -> Tensor:
    """``_scene_of_taps`` of all taps at once."""
    light, codes = _light_of_taps(snapshot, code.shape[2], layout), code.unflatten(0, (layout[4], -1))
    return (light[:, 0] * codes[0] if layout[4] == 1 else (light * codes).sum(1)).contiguous()


def sheared_taps(snapshot: Tensor, scene: Tensor, layout: Layout) -> Tensor:
    """``_code_of_taps`` of all taps at once."""
    return (_light_of_taps(snapshot, scene.shape[3], layout) * scene[:, None]).sum(0).flatten(0, 1)


def _scene_of_taps(code: Tensor, snapshot: Tensor, layout: Layout) -> Tensor:
    if _in_one_go(snapshot, layout):
        return sheared_scene(code, snapshot, layout)
    scene = snapshot.new_empty(snapshot.shape[0], layout[2], *code.shape[1:])
    windows, bands, codes = _windows(snapshot, code.shape[2], layout), scene.unbind(1), code.unbind(0)
    seen: set[int] = set()
    for t, channel in _taps(layout):
        if channel in seen:
            bands[channel].addcmul_(windows[t], codes[t])
        else:
            torch.mul(windows[t], codes[t], out=bands[channel])
            seen.add(channel)
    for channel in set(range(layout[2])) - seen:
        bands[channel].zero_()
    return scene


def _code_of_taps(snapshot: Tensor, scene: Tensor, layout: Layout) -> Tensor:
    if _in_one_go(scene, layout):
        return sheared_taps(snapshot, scene, layout)
    batch, _, rows, columns = scene.shape
    code = scene.new_empty(len(layout[0]), rows, columns)
    windows, bands, codes = _windows(snapshot, columns, layout), scene.unbind(1), code.unbind(0)
    for t, channel in _taps(layout):
        torch.mul(bands[channel][0], windows[t][0], out=codes[t])
        for b in range(1, batch):
            codes[t].addcmul_(bands[channel][b], windows[t][b])
    return code


def _code_of_planes(near: Tensor, wide: Tensor, layout: tuple[Offsets, Any]) -> Tensor:
    """All taps at once as long as their offsets rise evenly in memory (one strided view of each slot, measured 2.5×
    faster)."""
    offsets, _ = layout
    slots, rows, columns = near.shape
    code, wide = near.new_empty(len(offsets), rows, columns), wide.contiguous()
    line = wide.stride(1)
    places = [row * line + column for row, column in offsets]
    for first, count, step in _even_runs(places):
        shape, strides = (count, rows, columns), (step, line, 1)
        shifted = [slot.as_strided(shape, strides, slot.storage_offset() + places[first]) for slot in wide]
        part = code[first : first + count]
        torch.mul(near[0], shifted[0], out=part)
        for k in range(1, slots):
            part.addcmul_(near[k], shifted[k])
    return code


def _even_runs(places: list[int]) -> Iterator[tuple[int, int, int]]:
    """(first, count, step) of the longest runs of numbers that rise in even steps, one after the other."""
    first = 0
    while first < len(places):
        step = places[first + 1] - places[first] if first + 1 < len(places) else 0
        last = first
        while step >= 0 and last + 1 < len(places) and places[last + 1] - places[last] == step:
            last += 1
        yield first, last - first + 1, max(step, 0)
        first = last + 1


def _near_of_planes(wide: Tensor, code: Tensor, layout: tuple[Offsets, Any]) -> Tensor:
    near = code.new_zeros(wide.shape[0], *code.shape[1:])
    for t, offset in enumerate(layout[0]):
        near.addcmul_(_window(wide, offset, near), code[t])
    return near


def _wide_of_planes(code: Tensor, near: Tensor, layout: tuple[Offsets, Any]) -> Tensor:
    offsets, size = layout
    wide = near.new_zeros(near.shape[0], *size)
    for t, offset in enumerate(offsets):
        _window(wide, offset, near).addcmul_(near, code[t])
    return wide


def _window(wide: Tensor, offset: tuple[int, int], like: Tensor) -> Tensor:
    """(K, H, W) part of the wide planes under one tap."""
    (row, column), (rows, columns) = offset, like.shape[-2:]
    return wide[:, row : row + rows, column : column + columns]


_TAPS: Faces = (_snapshot_of_taps, _scene_of_taps, _code_of_taps)
_SHEAR: Faces = (_code_of_planes, _near_of_planes, _wide_of_planes)
