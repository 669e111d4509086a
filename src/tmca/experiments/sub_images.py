"""What every point of a mask does to the rays that cross it (thesis figure 15)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from tmca.errors import ShapeError
from tmca.experiments.figures import add_bar, bare, grid

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def at_mask(code: np.ndarray, shear: tuple[float, float] = (1.0, 1.0)) -> np.ndarray:
    """The code of the sensor pixels, ``T̂[ℓ, m]``, seen from the mask: ``T̂[ℓ, p - shear·ℓ]`` for mask point p.

    Thesis eq. (10) with its sign mended: the ray of view ℓ through mask point p ends at sensor pixel p - shear·ℓ, or
    the nearest one to it.

    Args:
        code: ``(V, U, H, W)``.
        shear: mask pixels per view, down and right.

    Returns:
        ``(V, U, H', W')`` at the mask points that all views see: ``H' = H - 2·ceil(|shear|·(V-1)/2)``, and likewise W'.

    Raises:
        ShapeError: not such a code, V or U even, or no mask point that all views see.
    """
    if np.ndim(code) != 4 or not (code.shape[0] & code.shape[1] & 1):
        raise ShapeError("code", f"shape {np.shape(code)}", "(V, U, H, W), V and U odd")
    half = [n // 2 for n in code.shape[:2]]
    margin = [int(np.ceil(abs(s) * h)) for s, h in zip(shear, half, strict=True)]
    height, width = (n - 2 * m for n, m in zip(code.shape[2:], margin, strict=True))
    if min(height, width) < 1:
        raise ShapeError(
            "code", f"{code.shape[2]} × {code.shape[3]} pixels", f"more than {2 * margin[0]} × {2 * margin[1]}"
        )
    result = np.empty((*code.shape[:2], height, width), dtype=code.dtype)
    for v, u in np.ndindex(*code.shape[:2]):
        y = margin[0] - round(shear[0] * (v - half[0]))
        x = margin[1] - round(shear[1] * (u - half[1]))
        result[v, u] = code[v, u, y : y + height, x : x + width]
    return result


def sub_images(code: np.ndarray) -> np.ndarray:
    """A code at the mask ``(V, U, H, W)`` as an array of sub-images, one of V × U pixels for each mask point.

    Returns:
        ``(H·(V+1) - 1, W·(U+1) - 1)``, not a number between the sub-images.
    """
    v, u, height, width = code.shape
    sheet = np.full((height, v + 1, width, u + 1), np.nan)
    sheet[:, :v, :, :u] = np.transpose(code, (2, 0, 3, 1))
    return sheet.reshape(height * (v + 1), width * (u + 1))[:-1, :-1]


def sub_images_figure(codes: Mapping[str, np.ndarray], corner: int = 10) -> Figure:
    """Sub-images of the first mask points of each code, on one scale (thesis figure 15).

    A static code answers alike to all rays through a mask point; a time-multiplexed one tells their angles apart.

    Args:
        codes: name → ``(V, U, H, W)`` transmittance seen from the mask, as :func:`at_mask` gives it.
        corner: mask points shown along each side.
    """
    sheets = {name: sub_images(np.asarray(code)[:, :, :corner, :corner]) for name, code in codes.items()}
    height, width = next(iter(sheets.values())).shape
    figure, axes = grid(1, len(sheets), width=4.4, aspect=min(height / width, 2.5) + 0.06)
    top = max(float(np.nanmax(sheet)) for sheet in sheets.values()) or 1.0
    for axis, (name, sheet) in zip(axes[0], sheets.items(), strict=True):
        axis.set_facecolor("#8fb8de")
        drawn = axis.imshow(sheet, cmap="gray", vmin=0, vmax=top, interpolation="nearest")
        views, points = codes[name].shape[:2], [min(corner, n) for n in codes[name].shape[2:]]
        bare(axis, f"{name}\n{points[0]} × {points[1]} mask points, {views[0]} × {views[1]} angles each")
    add_bar(axes[0, -1], drawn, "mean transmittance over the exposure")
    return figure
