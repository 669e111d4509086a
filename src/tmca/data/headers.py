"""What the headers of scenes say of them, nothing read: wavelengths of bands, rows and columns of views."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tmca.data.cubes import locate_cube
from tmca.data.formats.opening import open_contents
from tmca.data.light_fields import find_light_field, not_spectral, open_light_field
from tmca.data.rendering import is_rendered, rendered_names
from tmca.data.rendering.photographs import linear_rgb, no_such_scene, photograph
from tmca.data.rendering.pictures import checked_wavelengths
from tmca.data.rgbd import refuse_rgbd
from tmca.errors import DataError


def wavelengths_of(
    source: str, wavelengths: Iterable[float] | None = None, variable: str | None = None
) -> NDArray[np.float64]:
    """Wavelengths of the bands of a spectral scene, metres; arguments as of `load_scene`.

    Raises:
        DataError: no such scene, or one without bands.
    """
    if is_rendered(source):
        return checked_wavelengths(None)
    refuse_rgbd(source)
    if not Path(source).exists() and not Path(source).suffix:
        raise no_such_scene(source)
    with open_contents(source) as contents:
        views = find_light_field(contents, variable)
        if views is not None:
            raise not_spectral(source)
        given = None if wavelengths is None else np.asarray(list(wavelengths), dtype=np.float64)
        return locate_cube(contents, variable, given).metres


def view_size_of(
    source: str, scale: int | None = None, pattern: str | None = None, lens: tuple[int, int] | None = None
) -> tuple[int, int]:
    """Rows and columns of the views of a light field; arguments as of `load_light_field`.

    Raises:
        DataError: no such light field.
    """
    name = source.partition(":")[0]
    if not Path(source).exists() and name in rendered_names():
        rows, columns = linear_rgb(photograph(name)).shape[:2]
        return int(rows), int(columns)
    with open_light_field(source, pattern, lens) as contents:
        views = find_light_field(contents)
        if views is None:
            raise DataError(source, "a scene without views", "a light field")
        size = dict(zip(views.dims, views.shape, strict=True))
    return size["y"] // (scale or 1), size["x"] // (scale or 1)
