"""The light-field camera's operator: a coded mask in front of a shuttered sensor (thesis eqs 6–13, errata)."""

from __future__ import annotations

import torch
from torch import Tensor

from tmca.errors import ShapeError
from tmca.operators.exposure import exposure_weight
from tmca.operators.sheared_code import sheared_code
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
    scale = torch.full((len(code),), exposure_weight(exposure, len(shutter)), dtype=code.dtype, device=code.device)
    if vignetting is not None:
        if tuple(vignetting.shape) != shear.views:
            raise ShapeError("vignetting", f"shape {tuple(vignetting.shape)}", f"{shear.views}, one value per view")
        scale = scale * vignetting.to(scale).flatten()
    views = len(code)
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
    if tuple(aperture.shape) != wanted:
        there = f"shape {tuple(aperture.shape)}"
        raise ShapeError(
            "aperture", there, f"{wanted}: the sensor's {tuple(shutter.shape)} and the views' shear around it"
        )
    if shear.whole:
        return sheared_code(shutter, aperture, _shifts(shear, size)).unflatten(0, shear.views)
    rows, columns = (_positions(shear, axis, size) for axis in (0, 1))
    view_rows = []
    for row in rows:
        across = _read(aperture, 1, row)
        view_rows.append(torch.stack([(shutter * _read(across, 2, column)).sum(0) for column in columns]))
    return torch.stack(view_rows)


def code_through_mask(aperture: Tensor, shutter: Tensor, shear: ViewShear) -> Tensor:
    """(V, U, Hm, Wm) the same code seen from the mask, (10): response to the rays through mask pixel n of every view,
    ``(1/K) Σ_k S^k_{n - shear·ℓ} T^k_n``; the picture of the thesis' figure 15. Rays that miss the sensor give 0.

    Args:
        aperture: (K, Hm, Wm).
        shutter: (K, H, W).
        shear: views and shear.
    """
    size = (shutter.shape[1], shutter.shape[2])
    rows, columns = (_seen_from_mask(shear, axis, size) for axis in (0, 1))
    view_rows = []
    for row in rows:
        across = _read(shutter, 1, row)
        view_rows.append(torch.stack([(aperture * _read(across, 2, column)).mean(0) for column in columns]))
    return torch.stack(view_rows)


def _shifts(shear: ViewShear, size: tuple[int, int]) -> list[tuple[int, int]]:
    """Corner of every view's window of the mask, row by row."""
    border = shear.border(size)
    rows, columns = (
        [border[axis] + int(shear.step[axis]) * v for v in view_coordinates(shear.views[axis])] for axis in (0, 1)
    )
    return [(row, column) for row in rows for column in columns]


def _positions(shear: ViewShear, axis: int, size: tuple[int, int]) -> list[Tensor]:
    """Mask coordinate of every sensor pixel along one axis, for every view."""
    middle = (size[axis] - 1) / 2
    start = shear.scale * (torch.arange(size[axis], dtype=torch.float64) - middle) + middle + shear.border(size)[axis]
    return [start + shear.step[axis] * v for v in view_coordinates(shear.views[axis])]


def _seen_from_mask(shear: ViewShear, axis: int, size: tuple[int, int]) -> list[Tensor]:
    """Sensor coordinate of every mask pixel along one axis, for every view."""
    middle, length = (size[axis] - 1) / 2, shear.mask_size(size)[axis]
    place = torch.arange(length, dtype=torch.float64) - shear.border(size)[axis] - middle
    return [(place - shear.step[axis] * v) / shear.scale + middle for v in view_coordinates(shear.views[axis])]


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
