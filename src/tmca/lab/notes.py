"""Notes of snapshots that a bench captured, and dates: a calibration must not be older than the codes."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

from tmca.attributes import Attributes, read_json
from tmca.errors import DataError

GAIN = "gain_per_digital_number"
"""Snapshot units of a digital number above the dark."""
WHITE = "white_of_a_frame"
"""Snapshot units of a white scene in one of the frames that were joined."""
AVERAGED = "frames_averaged"
"""Frames whose mean a pixel is that is always open, their repeats counted."""
DRIVER = "driver"
"""Which driver took it."""
SATURATED = "saturated_share"
"""Share of the pixels that saturate in any frame."""


CODES_DATE = "codes_date"
"""Attribute of files of codes, snapshots and exports: date of the codes, ISO 8601."""
CAPTURES = "captures.json"
"""List of the frames of a capture, with the date of each, beside them."""
_LABELLED = (".nc", ".h5", ".zarr")


def now() -> str:
    """The date of codes that are made now, to the second, UTC."""
    return datetime.now(UTC).replace(microsecond=0).isoformat()


def parsed_date(stated: object, where: str | Path = CODES_DATE) -> datetime:
    """A stated date; UTC where it names no zone.

    Raises:
        DataError: it is none.
    """
    try:
        date = datetime.fromisoformat(str(stated))
    except ValueError:
        raise DataError(where, repr(stated), "a date such as 2026-03-31T12:00:00+00:00") from None
    return date if date.tzinfo else date.replace(tzinfo=UTC)


def date_of_codes(files: Iterable[str | Path]) -> str | None:
    """The date of the codes in some files, the latest of them; None without files.

    It is what a labelled file says of its codes, and else the time at which the file was last changed. Of the folder of
    a run it is that of the weights in it.

    Raises:
        DataError: a file that is missing, or says something that is no date.
    """
    dates = [_date_of(Path(file)) for file in files]
    return max(dates).isoformat() if dates else None


def _date_of(path: Path) -> datetime:
    from tmca.data import read_attributes

    if path.suffix.lower() in _LABELLED and CODES_DATE in (attributes := read_attributes(path)):
        return parsed_date(attributes[CODES_DATE], f"{path}: {CODES_DATE}")
    file = path / "weights.safetensors" if (path / "weights.safetensors").is_file() else path
    if not file.exists():
        raise DataError(path, "no such file", "codes", "check the path")
    return datetime.fromtimestamp(file.stat().st_mtime, UTC).replace(microsecond=0)


class _Date(Attributes):
    taken: str | None = None


class _Dates(Attributes):
    """Of the frames in a list of captures."""

    frames: dict[str, _Date]


def date_of_frames(sources: Iterable[str | Path]) -> datetime | None:
    """When the oldest frame of some captures was taken, UTC; None where no list of captures says.

    Args:
        sources: folders, all frames of whose list count, for copies may have other names; or files of frames.

    Raises:
        DataError: a list of captures that is none, or a date that is none.
    """
    dates = []
    for source in map(Path, sources):
        file = (source if source.is_dir() else source.parent) / CAPTURES
        frames = read_json(file, _Dates).frames if file.is_file() else {}
        chosen = [about for name, about in frames.items() if source.is_dir() or name == source.stem]
        dates += [parsed_date(about.taken, file).astimezone(UTC) for about in chosen if about.taken is not None]
    return min(dates, default=None)
