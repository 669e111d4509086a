"""What every point of a mask does to the rays that cross it (thesis figure 15)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from tmca.experiments.figures import add_bar, bare, grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
    """Sub-images of mask points in the middle of each code, on one scale (thesis figure 15).

    A static code answers alike to all rays through a mask point; a time-multiplexed one tells their angles apart. The
    ticks name the views of the first sub-image, from which its rays come.

    Args:
        codes: name → ``(V, U, Hm, Wm)`` transmittance seen from the mask, ``camera.code_through_mask()``.
        corner: mask points shown along each side.
    """
    sheets = {name: sub_images(_middle(np.asarray(code), corner)) for name, code in codes.items()}
    height, width = next(iter(sheets.values())).shape
    figure, axes = grid(1, len(sheets), width=4.4, aspect=min(max(height / width, 0.6), 2.5))
    top = max(float(np.nanmax(sheet)) for sheet in sheets.values()) or 1.0
    for axis, (name, sheet) in zip(axes[0], sheets.items(), strict=True):
        axis.set_facecolor("#8fb8de")
        drawn = axis.imshow(sheet, cmap="gray", vmin=0, vmax=top, interpolation="nearest")
        views, points = codes[name].shape[:2], [min(corner, n) for n in codes[name].shape[2:]]
        bare(axis, f"{name}\n{points[0]} × {points[1]} mask points, {views[0]} × {views[1]} angles each")
        _name_angles(axis, views)
    add_bar(axes[0, -1], drawn, "transmittance over the exposure")
    return figure


def _name_angles(axis: Axes, views: tuple[int, ...]) -> None:
    """Ticks at the outer views of the first sub-image, and at the centre's where there is room."""
    for count, ticks in zip(views, (axis.set_yticks, axis.set_xticks), strict=True):
        places = sorted({0, count - 1, *([count // 2] if count > 4 else [])})
        ticks(places, [f"{place - count // 2}" for place in places], fontsize=6)
    axis.set_xlabel("mask columns, in each the angles of views u", fontsize=8)
    axis.set_ylabel("mask rows, in each the angles of views v", fontsize=8)


def _middle(code: np.ndarray, corner: int) -> np.ndarray:
    """The middle mask points, whose rays meet the sensor in every view."""
    top, left = ((length - min(corner, length)) // 2 for length in code.shape[2:])
    return code[:, :, top : top + corner, left : left + corner]
