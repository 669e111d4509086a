"""Notes of snapshots that a bench captured, and dates: a calibration must not be older than the codes."""

from __future__ import annotations

import json
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

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
    from tmca.data import read_dataset

    if path.suffix.lower() in _LABELLED and CODES_DATE in (attributes := read_dataset(path).attrs):
        return parsed_date(attributes[CODES_DATE], f"{path}: {CODES_DATE}")
    file = path / "weights.safetensors" if (path / "weights.safetensors").is_file() else path
    if not file.exists():
        raise DataError(path, "no such file", "codes", "check the path")
    return datetime.fromtimestamp(file.stat().st_mtime, UTC).replace(microsecond=0)


def date_of_frames(sources: Iterable[str | Path]) -> datetime | None:
    """When the oldest frame of some captures was taken, UTC; None where no list of captures says.

    Args:
        sources: folders, all frames of whose list count, for copies may have other names; or files of frames.

    Raises:
        DataError: a list of captures that is none, or a date that is none.
    """
    return min((date for source in sources for date in _taken(Path(source))), default=None)


def _taken(source: Path) -> list[datetime]:
    folder = source if source.is_dir() else source.parent
    file = folder / CAPTURES
    if not file.is_file():
        return []
    try:
        frames = json.loads(file.read_text(encoding="utf-8"))["frames"]
        dates = {name: about["taken"] for name, about in frames.items() if "taken" in about}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        remedy = "take an unchanged copy, or take it out of the folder"
        raise DataError(file, "no list of captures", "what `tmca capture` wrote", remedy) from None
    return [
        parsed_date(date, file).astimezone(UTC)
        for name, date in dates.items()
        if folder == source or name == source.stem
    ]
