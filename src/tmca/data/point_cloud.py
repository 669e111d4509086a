"""Depth maps as clouds of coloured points before a pinhole camera, and their PLY files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.data.atomic import atomic_path
from tmca.errors import OutputError, check_range, check_shape

FOCAL = "focal_px"
"""Attribute: distance from the pinhole to the sensor, in pixels of the scene."""

FOCAL_OF = "focal_of"
"""Attribute: whose that is, of the "bench" or the "scene"."""
_IN_PIXELS = (FOCAL, "offset_px")
_NUMBERS = (int, float, np.number)


def scaled_lengths(attrs: Mapping[str, Any], by: int | None) -> dict[str, Any]:
    """Attributes of a scene of which ``by`` pixels per axis became one: lengths in pixels are shorter."""
    lengths = {name: attrs[name] / by for name in _IN_PIXELS if by and isinstance(attrs.get(name), _NUMBERS)}
    return {**attrs, **lengths}


def points_of(
    depth: Any, colours: Any, focal_px: float, known: Any = None
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """The points that the pixels of a depth map are of, seen through a pinhole before the middle of the picture.

    Pixel (y, x) of depth z is the point ((x - (W-1)/2) z / f, -(y - (H-1)/2) z / f, -z): x to the right, y up, the
    camera at the origin.

    Args:
        depth: ``(H, W)`` metres along the optical axis; what is not finite or not above 0 is left out.
        colours: ``(H, W, 3)`` in [0, 1].
        focal_px: f, pixels.
        known: ``(H, W)``, False where a pixel is left out too.

    Returns:
        Points ``(N, 3)`` in metres and their colours ``(N, 3)``.

    Raises:
        ShapeError: sizes that differ.
        SettingError: a focal length that is not above 0.
    """
    metres, shown = np.asarray(depth, np.float64), np.asarray(colours)
    check_shape("depth", metres, ("H", "W"))
    check_shape("colours", shown, (*metres.shape, 3))
    check_range("focal", focal_px, above=0, unit="px")
    taken = np.isfinite(metres) & (metres > 0)
    if known is not None:
        check_shape("known", known, metres.shape)
        taken &= np.asarray(known, bool)
    y, x = np.nonzero(taken)
    z = metres[taken]
    middle = (np.array(metres.shape) - 1) / 2
    points = np.stack(((x - middle[1]) * z / focal_px, -(y - middle[0]) * z / focal_px, -z), axis=1)
    return points.astype(np.float32), np.round(255 * np.clip(shown[taken], 0, 1)).astype(np.uint8)


def write_ply(
    points: NDArray[np.float32],
    colours: NDArray[np.uint8],
    path: str | Path,
    *,
    comment: str = "",
    overwrite: bool = False,
) -> Path:
    """Write coloured points as binary little-endian PLY, whole or not at all.

    Args:
        points: ``(N, 3)`` metres.
        colours: ``(N, 3)``.
        path: ending in ``.ply``.
        comment: one line for the head of the file.
        overwrite: replace an existing file.

    Raises:
        OutputError: another suffix, the file exists, or it cannot be written.
        ShapeError: other numbers of points and colours.
    """
    path = Path(path)
    if path.suffix.lower() != ".ply":
        raise OutputError(path, f"the suffix {path.suffix!r}", ".ply", "rename the output")
    check_shape("points", points, ("N", 3))
    check_shape("colours", colours, (len(points), 3))
    vertices = np.empty(len(points), dtype=[("place", "<f4", 3), ("colour", "u1", 3)])
    vertices["place"], vertices["colour"] = points, colours
    properties = [f"property float {name}" for name in "xyz"]
    properties += [f"property uchar {name}" for name in ("red", "green", "blue")]
    said = [f"comment {' '.join(comment.split())}"] if comment else []
    lines = ["ply", "format binary_little_endian 1.0", *said, f"element vertex {len(points)}", *properties]
    head = "\n".join([*lines, "end_header", ""])
    with atomic_path(path, overwrite=overwrite) as temporary:
        temporary.write_bytes(head.encode("ascii", "replace") + vertices.tobytes())
    return path
