"""How several light fields are read together: what is asked of files, and what of it applies to each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.data.formats.opening import is_picture
from tmca.data.formats.view_names import has_names
from tmca.errors import SettingError
from tmca.experiments.light_field.imaging import load_light_field
from tmca.experiments.light_field.rows import RENDERED

if TYPE_CHECKING:
    import xarray as xr

    from tmca.training.light_field import LightFieldTrainSettings

_WANTED = {
    "scale": "light fields from files",
    "pattern": "a folder of views with such names",
    "lens": "a lenslet picture",
}


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


def read(name: str, views: int, reading: Reading, size: Sequence[int] | None = None) -> xr.DataArray:
    """A light field in grey: the middle of one from files, or a rendered one; the last few are kept.

    Args:
        name: what ``load_light_field`` reads.
        views: n for the centre n×n views.
        reading: what is asked of files.
        size: (H, W); without it all of a file, and a rendered one as networks learn from.
    """
    frame = (size[0], size[1]) if size else None
    return _read(name, views, frame if Path(name).exists() or frame else RENDERED, **reading.of(name))


@lru_cache(maxsize=3)
def _read(name: str, views: int, size: tuple[int, int] | None, **own: Any) -> xr.DataArray:
    return load_light_field(name, views=views, size=size, **own)


def check_readable(
    learned: Sequence[str],
    measured: Sequence[str],
    views: int,
    reading: Reading,
    measured_as: Reading,
    size: Sequence[int] | None = None,
) -> None:
    """Read every light field as later work will, so that one that cannot be used is named before anything is made.

    Args:
        learned: light fields to learn from, read as ``reading`` says.
        measured: others, read as ``measured_as`` says.
        views: n for the centre n×n views.
        size: (H, W), the middle of those that are measured.

    Raises:
        DataError, SettingError: as ``load_light_field``.
    """
    for name in dict.fromkeys(learned):
        read(name, views, reading)
    for name in dict.fromkeys(measured):
        read(name, views, measured_as, size)


def training_reading(settings: LightFieldTrainSettings) -> Reading:
    """What the settings of a run ask of its files."""
    return Reading(settings.data.scale, settings.data.pattern, settings.data.lens)


def training_loader(settings: LightFieldTrainSettings) -> Callable[[str], xr.DataArray]:
    """Reads the light fields of a run.

    Raises:
        SettingError: a setting that applies to none of them.
        DataError: a split that cannot be read.
    """
    from tmca.training.scenes import named_scenes

    data, reading = settings.data, training_reading(settings)
    names = named_scenes([*data.train, *data.validation, *data.prior])
    if names:
        check_asked(names, **vars(reading))

    def load(name: str) -> xr.DataArray:
        try:
            return load_light_field(name, views=settings.camera.views, colour=data.colour, **reading.of(name))
        except SettingError as error:
            if error.where != "views":
                raise
            remedy = error.remedy and f"{error.remedy.replace('views=', 'camera.views=')} (--set)"
            raise SettingError("camera.views", error.found, error.expected, remedy) from error

    return load
