"""What imperfect devices make of patterns: light through closed pixels, slots that run into each other, planes that do
not lie on each other.

Devices repeat the exposure: before its first slot comes the last one of the exposure before. Times are in slots.
"""

from __future__ import annotations

from math import ceil, radians
from typing import Literal

import torch
from torch import Tensor

from tmca.errors import ShapeError

Outside = Literal["edge", "dark"]
"""What is beside a mask: its edge goes on, or nothing."""


def leaked(patterns: Tensor, share: float) -> Tensor:
    """Patterns whose closed pixels pass a share of the light: ``T + (1 - T) share``; 1/contrast of an aperture.

    Args:
        patterns: of any shape, in [0, 1].
        share: 0 to 1.
    """
    return patterns + (1 - patterns) * share if share else patterns


def slot_overlap(slots: int, starts: Tensor, ends: Tensor, switching: float = 0.0) -> Tensor:
    """How long every shutter pattern sees every aperture pattern, in slots.

    Aperture pattern m appears at time m, over ``switching`` slots in which it takes over linearly from the one
    before; shutter pattern k is shown from ``starts[k]`` to ``ends[k]``.

    Args:
        slots: K.
        starts: (…, K), within ±K of the slots' own; the exposure is repeated without end.
        ends: (…, K), not before the starts.
        switching: share of a slot, 0 to 1.

    Returns:
        (…, K, K) weights of (shutter k, aperture m). Those of one k add up to how long it is shown.
    """
    begun = torch.arange(slots, dtype=starts.dtype, device=starts.device)
    reach = 2 + ceil(max(float(ends.abs().max()), float(starts.abs().max())) / slots)
    overlap = starts.new_zeros(*starts.shape, slots)
    for cycle in range(-reach, reach + 1):
        at = begun + cycle * slots
        until, since = ends[..., None] - at, starts[..., None] - at
        overlap += _shown(until, switching) - _shown(until - 1, switching)
        overlap -= _shown(since, switching) - _shown(since - 1, switching)
    return overlap


def _shown(time: Tensor, switching: float) -> Tensor:
    """Integral up to a time of a pattern's share of the aperture: 0 before it appears, 1 once it has taken over."""
    time = time.clamp_min(0)
    if not switching:
        return time
    return torch.where(time < switching, time**2 / (2 * switching), time - switching / 2)


def through_time(shutter: Tensor, overlap: Tensor) -> Tensor:
    """Shutter patterns as each aperture pattern meets them: ``S'_m = Σ_k overlap[k, m] S_k``.

    The snapshot of the slots as they run, ``∫ T(t) S(t) dt``, is then that of K slots T_m, S'_m.

    Args:
        shutter: (K, H, W) in [0, 1].
        overlap: (K, K), or (H, K, K) where rows differ.

    Raises:
        ShapeError: an overlap of other slots or rows.
    """
    slots, rows, _ = shutter.shape
    if tuple(overlap.shape) not in ((slots, slots), (rows, slots, slots)):
        raise ShapeError("overlap", str(tuple(overlap.shape)), f"({slots}, {slots}) or ({rows}, {slots}, {slots})")
    wide = overlap.to(shutter)
    form = "km,khw->mhw" if wide.ndim == 2 else "hkm,khw->mhw"
    return torch.einsum(form, wide, shutter).clamp_max(1)


def misplaced(
    patterns: Tensor,
    shift: tuple[float, float] = (0.0, 0.0),
    magnification: float = 1.0,
    rotation: float = 0.0,
    size: tuple[int, int] | None = None,
    outside: Outside = "edge",
) -> Tensor:
    """Patterns that are imaged displaced, larger and turned about their middle; bilinear.

    Square pixels that are displaced by a part of a pixel share their light linearly: for displacements this is exact.

    Args:
        patterns: (K, H, W).
        shift: rows and columns by which the image is displaced, pixels.
        magnification: of the image.
        rotation: degrees, from the direction of increasing rows to that of increasing columns, as a registration's.
        size: (H', W') that is seen, around the same middle; the patterns' own without.
        outside: what is seen beside the patterns: their edge continued, or nothing.

    Returns:
        (K, H', W').
    """
    rows, columns = patterns.shape[1:]
    height, width = size or (rows, columns)
    if not any(shift) and magnification == 1 and not rotation and (height, width) == (rows, columns):
        return patterns
    y, x = (torch.arange(n, dtype=torch.float64) - (n - 1) / 2 - s for n, s in zip((height, width), shift, strict=True))
    angle = torch.tensor(radians(rotation), dtype=torch.float64)
    there_y = (angle.cos() * y[:, None] + angle.sin() * x) / magnification
    there_x = (angle.cos() * x - angle.sin() * y[:, None]) / magnification
    grid = torch.stack((2 * there_x / max(columns - 1, 1), 2 * there_y / max(rows - 1, 1)), -1).to(patterns)
    return torch.nn.functional.grid_sample(
        patterns[None], grid[None], padding_mode="border" if outside == "edge" else "zeros", align_corners=True
    )[0].clamp(0, 1)  # fmt: skip
