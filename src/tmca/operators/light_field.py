"""The light-field camera's operator: a coded mask in front of a shuttered sensor (thesis eqs 6–13, errata)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import torch
from torch import Tensor

from tmca.errors import check_shape
from tmca.operators.kernels import sheared_code
from tmca.operators.linear import exposure_weight
from tmca.operators.taps import TapOperator, Taps
from tmca.optics import ViewShear, view_coordinates


def coded_mask(
    aperture: Tensor,
    shutter: Tensor,
    shear: ViewShear,
    vignetting: Tensor | None = None,
    exposure: str = "equal",
) -> TapOperator:
    """``y_m = Σ_ℓ ω_ℓ T̂_{m,ℓ} x_{m,ℓ}`` (13), on scenes (B, V·U, H, W) whose views lie row by row.

    Args:
        aperture: (K, Hm, Wm) T^k in [0, 1], as large as ``shear.mask_size``.
        shutter: (K, H, W) S^k in [0, 1].
        shear: views, and where their rays cross the mask.
        vignetting: (V, U) share ω of the light of every view; ones if None.
        exposure: ``"equal"`` or ``"per-slot"``.

    Raises:
        ShapeError: mask, shutter or vignetting do not fit.
    """
    code = mask_code(aperture, shutter, shear).flatten(0, 1)
    views = len(code)
    scale = code.new_full((views,), exposure_weight(exposure, len(shutter)))
    if vignetting is not None:
        check_shape("vignetting", vignetting, shear.views, "one value per view")
        scale = scale * vignetting.to(scale).flatten()
    return TapOperator(Taps(code * scale[:, None, None], tuple(range(views)), (0,) * views, views, code.shape[2]))


def mask_code(aperture: Tensor, shutter: Tensor, shear: ViewShear) -> Tensor:
    """(V, U, H, W) sum over slots ``Σ_k S^k_m T^k_{m + shear·ℓ}`` (12); between its pixels the mask is bilinear.

    Args:
        aperture: (K, Hm, Wm).
        shutter: (K, H, W).
        shear: views and shear.
    """
    size = (shutter.shape[1], shutter.shape[2])
    wanted = (len(shutter), *shear.mask_size(size))
    check_shape("aperture", aperture, wanted, "it is as large as the sensor and the views' shear around it")
    if shear.whole:
        parts = zip(shear.border(size), shear.step, shear.views, strict=True)
        tops, lefts = ([edge + int(step) * v for v in view_coordinates(count)] for edge, step, count in parts)
        return sheared_code(shutter, aperture, list(product(tops, lefts))).unflatten(0, shear.views)
    rows, columns = (_on_mask(shear, axis, size) for axis in (0, 1))
    return _between_pixels(shutter, aperture, rows, columns)


def code_through_mask(aperture: Tensor, shutter: Tensor, shear: ViewShear) -> Tensor:
    """(V, U, Hm, Wm) the same code seen from the mask, (10): response to the rays through mask pixel n of every view,
    ``(1/K) Σ_k S^k_{n - shear·ℓ} T^k_n``; the picture of the thesis' figure 15. Rays that miss the sensor give 0.

    Args:
        aperture: (K, Hm, Wm).
        shutter: (K, H, W).
        shear: views and shear.
    """
    rows, columns = (_on_sensor(shear, axis, (shutter.shape[1], shutter.shape[2])) for axis in (0, 1))
    return _between_pixels(aperture, shutter, rows, columns) / len(shutter)


def _on_mask(shear: ViewShear, axis: int, size: tuple[int, int]) -> list[Tensor]:
    """Mask coordinate of every sensor pixel along one axis, for every view."""
    middle = (size[axis] - 1) / 2
    start = shear.scale * (torch.arange(size[axis], dtype=torch.float64) - middle) + middle + shear.border(size)[axis]
    return [start + shear.step[axis] * v for v in view_coordinates(shear.views[axis])]


def _on_sensor(shear: ViewShear, axis: int, size: tuple[int, int]) -> list[Tensor]:
    """Sensor coordinate of every mask pixel along one axis, for every view."""
    middle, length = (size[axis] - 1) / 2, shear.mask_size(size)[axis]
    place = torch.arange(length, dtype=torch.float64) - shear.border(size)[axis] - middle
    return [(place - shear.step[axis] * v) / shear.scale + middle for v in view_coordinates(shear.views[axis])]


def _between_pixels(near: Tensor, far: Tensor, rows: Sequence[Tensor], columns: Sequence[Tensor]) -> Tensor:
    """(V, U, H, W) sum over slots of the near planes times the far ones, read at the places of every view."""
    view_rows = []
    for row in rows:
        across = _read(far, 1, row)
        view_rows.append(torch.stack([(near * _read(across, 2, column)).sum(0) for column in columns]))
    return torch.stack(view_rows)


def _read(planes: Tensor, axis: int, positions: Tensor) -> Tensor:
    """Planes read between their pixels along one axis, linearly; zero beyond them."""
    length = planes.shape[axis]
    left = positions.round(decimals=9).floor()
    part = (positions - left).clamp(0, 1).to(planes)
    shape = [1, 1, 1]
    shape[axis] = -1

    def at(index: Tensor, weight: Tensor) -> Tensor:
        weight = weight * ((index >= 0) & (index < length)).to(weight)
        inside = index.clamp(0, length - 1).long().to(planes.device)
        return planes.index_select(axis, inside) * weight.to(planes).reshape(shape)

    return at(left, 1 - part) + at(left + 1, part)
