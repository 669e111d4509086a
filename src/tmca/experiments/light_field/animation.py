"""Moving pictures of light fields."""

from __future__ import annotations

from math import ceil, isqrt
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tmca.errors import OutputError
from tmca.experiments.light_field.views import brightest, colour_views, shown

if TYPE_CHECKING:
    from PIL import Image

_PIXELS, _REPEATED = 2.4e6, 4e6
"""Of all frames together, about a megabyte; repeated pixels take half as many bytes."""
_SIDE = 360
"""Pixels along the longer side that small views are enlarged to."""
_COLOURS = 64


def border_walk(rows: int, columns: int) -> list[tuple[int, int]]:
    """Views along the border, one step at a time and back to the first; to and fro where there is only one line."""
    if min(rows, columns) == 1:
        line = [(v, u) for v in range(rows) for u in range(columns)]
        return line + line[-2:0:-1]
    top = [(0, u) for u in range(columns)]
    right = [(v, columns - 1) for v in range(1, rows)]
    bottom = [(rows - 1, u) for u in range(columns - 2, -1, -1)]
    left = [(v, 0) for v in range(rows - 2, 0, -1)]
    return top + right + bottom + left


def views_gif(light_field: np.ndarray, path: str | Path, *, seconds: float = 1.6, overwrite: bool = False) -> Path:
    """Write an animated GIF that goes once round the border views and starts again.

    The views share 64 colours without dithering. They are made smaller where they have more than 2.4 million pixels in
    all, and small ones are enlarged by a whole factor towards 360 pixels along the longer side: the file stays near a
    megabyte.

    Args:
        light_field: ``(V, U, H, W)``, or ``(3, V, U, H, W)`` with colours first.
        path: ends in ``.gif``.
        seconds: of one round.
        overwrite: replace an earlier file.

    Raises:
        OutputError: another suffix, the file exists, or it cannot be written.
        ShapeError: not a light field.
    """
    from PIL import Image

    from tmca.data import atomic_path

    if Path(path).suffix.lower() != ".gif":
        raise OutputError(path, f"the suffix {Path(path).suffix!r}", ".gif", "rename the animation")
    views, white = colour_views(light_field), brightest(light_field)
    walk = border_walk(*views.shape[:2])
    pixels = len(walk) * views[0, 0, ..., 0].size
    scale, times = min(1.0, (_PIXELS / pixels) ** 0.5), _enlargement(pixels, max(views.shape[2:4]))
    frames = [_frame(views[place], white, scale) for place in walk]
    palette = Image.fromarray(np.hstack([np.asarray(f) for f in frames[:: max(1, len(frames) // 4)]]))
    palette = palette.quantize(_COLOURS, method=Image.Quantize.MEDIANCUT)
    drawn = [_enlarged(frame.quantize(palette=palette, dither=Image.Dither.NONE), times) for frame in frames]
    with atomic_path(path, overwrite=overwrite) as temporary:
        duration = max(20, round(1000 * seconds / len(drawn)))
        drawn[0].save(temporary, format="GIF", save_all=True, append_images=drawn[1:], duration=duration, loop=0)
    return Path(path)


def _enlargement(pixels: int, side: int) -> int:
    """Whole factor for views with so many pixels in all and along the longer side; 1 leaves them."""
    return max(1, min(ceil(_SIDE / side), isqrt(int(_REPEATED / pixels))))


def _enlarged(frame: Image.Image, times: int) -> Image.Image:
    from PIL import Image

    return frame.resize((times * frame.width, times * frame.height), Image.Resampling.NEAREST)


def _frame(view: np.ndarray, white: float, scale: float) -> Image.Image:
    """A view ``(H, W, C)`` as an 8-bit image, made smaller by ``scale``."""
    from PIL import Image

    frame = Image.fromarray((255 * shown(view, white)).round().astype(np.uint8))
    size = (max(1, round(scale * frame.width)), max(1, round(scale * frame.height)))
    return frame if scale == 1 else frame.resize(size, Image.Resampling.LANCZOS)
