"""Light fields to work with: from files or rendered ones by name, several read together, their true disparity."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from warnings import warn

from tmca.arguments import Int, IntPair, checked
from tmca.data.formats.opening import is_picture
from tmca.data.formats.view_names import has_names
from tmca.data.light_fields import find_disparity, read_disparity, read_light_field
from tmca.data.rendering import rendered_light_field, rendered_names
from tmca.data.rendering.photographs import no_such_scene
from tmca.data.rgbd import holds_rgbd
from tmca.data.scene_names import READING, SceneWarning
from tmca.errors import DataError, SettingError

if TYPE_CHECKING:
    import xarray as xr

RENDERED = (128, 160)
"""Pixels of rendered light fields that networks learn from."""
_WANTED = {
    "scale": "light fields from files",
    "pattern": "a folder of views with such names",
    "lens": "a lenslet picture",
}


class UnevenGrid(SceneWarning):
    """A light field whose grid of views is not square, as when some are missing."""


@checked
def load_light_field(
    source: str | Path,
    *,
    views: Int | None = 5,
    size: IntPair | None = None,
    scale: Int | None = None,
    colour: bool = False,
    pattern: str | None = None,
    lens: IntPair | None = None,
) -> xr.DataArray:
    """A light field from files, or a rendered one.

    Args:
        source: what ``tmca.data.read_light_field`` reads, or the name of a rendered scene, ``coffee`` or with the seed
            of its arrangement ``coffee:3``.
        views: n for the centre n×n views; all if None.
        size: (H, W) centre crop.
        scale: whole number of pixels per axis that are averaged into one.
        colour: red, green and blue instead of their luminance.
        pattern: of the file names of a folder.
        lens: (rows, columns) of the views under a lens of a lenslet picture; 14×14 without.

    Returns:
        (view_v, view_u, y, x), or (colour, view_v, view_u, y, x), with an attribute ``name``, and ``scene_reading``: a
        JSON object with ``source`` and these arguments.

    Raises:
        DataError, SettingError: no such light field, or one that cannot be used so.

    Warns:
        UnevenGrid: the centre of views that stand on no square grid was taken.
    """
    source = str(source)
    reading: dict[str, Any] = {"views": views, "scale": scale, "colour": colour, "pattern": pattern, "lens": lens}
    if Path(source).exists():
        try:
            light_field = read_light_field(source, crop=size, **reading)
        except DataError:
            _refuse_rgbd(source)
            raise
        rows, columns = light_field.attrs["grid"]
        if rows != columns:
            odd = f"{rows}×{columns} views are no square, some may be missing"
            warn(f"{source}: {odd}; taken are {taken_views(light_field)}", UnevenGrid, stacklevel=2)
    elif source.partition(":")[0] in rendered_names():
        _refuse_files(pattern=pattern, lens=lens)
        light_field = _rendered(source, views or 5, size, scale or 1, colour)["light_field"]
        light_field.attrs["source_colours"] = 3
    else:
        _refuse_rgbd(source)
        raise no_such_scene(source)
    noted = {"source": source, "size": size, **reading, "scale": scale or 1}
    return light_field.assign_attrs({READING: json.dumps(noted, default=int)})


def _refuse_rgbd(source: str) -> None:
    if holds_rgbd(source):
        remedy = "take it for spectral-depth: tmca simulate spectral-depth … --from-rgb"
        raise DataError(source, "an RGB picture with depth", "a light field", remedy)


def taken_views(light_field: xr.DataArray) -> str:
    """Which rows and columns of its files' grid a light field is."""
    taken = light_field.sizes["view_v"], light_field.sizes["view_u"]
    first = [(int(n) - k + 1) // 2 for n, k in zip(light_field.attrs["grid"], taken, strict=True)]
    rows, columns = (f"{top} to {top + k - 1}" for top, k in zip(first, taken, strict=True))
    return f"rows {rows} and columns {columns}, counted from 0"


def _refuse_files(**asked: Any) -> None:
    """Refuse what only files have."""
    for name, value in asked.items():
        if value is not None:
            text = "×".join(map(str, value)) if isinstance(value, tuple) else value
            raise SettingError(name, f"{text} of a rendered scene", "a light field from files", "leave it out")


def true_disparity(
    source: str, like: xr.DataArray, scale: int | None = None, pattern: str | None = None
) -> xr.DataArray | None:
    """Disparity (y, x) of the centre view in px per view step, brought to the pixels of ``like``; None without."""
    size = (like.sizes["y"], like.sizes["x"])
    if not Path(source).exists():
        return _rendered(source, 1, size, scale or 1, False)["disparity"]
    if find_disparity(source) is None:
        return None
    return read_disparity(source, crop=size, scale=scale, pattern=pattern)


def _rendered(source: str, views: int, size: tuple[int, int] | None, scale: int, colour: bool) -> xr.Dataset:
    name, _, seed = source.partition(":")
    if seed and not seed.isdigit():
        raise SettingError(source, f"seed {seed!r}", "a whole number, such as coffee:3")
    if scale != 1:
        raise SettingError("scale", f"{scale} of a rendered scene", "1: choose its size instead", "leave it out")
    return rendered_light_field(name, views=views, size=size, seed=int(seed or 0), colour=colour)


@dataclass(frozen=True)
class Reading:
    """What is asked of light fields from files; each takes what applies to it, rendered ones nothing.

    A list may mix them: a folder without any name of the pattern is one whose own naming is recognised, and only
    pictures have lenses.

    Args:
        scale: whole number of pixels per axis that are averaged into one.
        pattern: of the file names of folders; see ``load_light_field``.
        lens: (rows, columns) of the views under a lens of lenslet pictures.
    """

    scale: int | None = None
    pattern: str | None = None
    lens: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        if isinstance(self.lens, list):  # as JSON has it
            object.__setattr__(self, "lens", tuple(self.lens))

    def of(self, source: str) -> dict[str, Any]:
        """Arguments of ``load_light_field`` for one light field, and what makes its pixels beside its files."""
        return {name: value for name, value in vars(self).items() if _applies(name, value, source)}


NOTHING = Reading()
"""Files are read as they are."""


def _applies(name: str, value: Any, source: str) -> bool:
    path = Path(source)
    if value is None or not path.exists():
        return False
    if name == "pattern":
        return path.is_dir() and has_names(path, value)
    return name == "scale" or (path.is_file() and is_picture(path))


def check_asked(sources: Sequence[str], **asked: Any) -> None:
    """Refuse what applies to none of the light fields: a scale without files, a misspelt pattern.

    Args:
        sources: what ``load_light_field`` reads.
        asked: fields of ``Reading``, also as ``test_scale``.

    Raises:
        SettingError: the first such option, or a pattern without row and column.
    """
    for option, value in asked.items():
        name = option.removeprefix("test_")
        if value not in (None, 1) and not any(_applies(name, value, source) for source in sources):
            text = "×".join(map(str, value)) if isinstance(value, tuple) else str(value)
            found = f"{text}, which applies to none of the light fields"
            raise SettingError(option, found, _WANTED[name], "change it or leave it out")


def read_middle(name: str, views: int, reading: Reading, size: Sequence[int] | None = None) -> xr.DataArray:
    """A light field in grey: the middle of one from files, or a rendered one.

    Args:
        name: what ``load_light_field`` reads.
        views: n for the centre n×n views.
        reading: what is asked of files.
        size: (H, W); without it all of a file, and a rendered one as networks learn from.
    """
    frame = (size[0], size[1]) if size else None if Path(name).exists() else RENDERED
    return load_light_field(name, views=views, size=frame, **reading.of(name))
