"""Which picture of a folder is which view of the grid, told by its name.

Every naming is brought to one orientation: rows of views run as image rows do (the camera moves down), columns as
image columns do (the camera moves right), so that disparity has the sign of the HCI benchmark along both axes.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice, pairwise
from math import isqrt
from pathlib import Path

from tmca.data.formats.images import PICTURES
from tmca.errors import DataError, SettingError

Place = tuple[int, int]

_NUMBER = r"[-+]?\d+\.\d+"
_HCI = re.compile(r"(?P<prefix>input_Cam)(?P<index>\d+)\.png", re.IGNORECASE)
_PLACED = re.compile(rf"(?P<prefix>.*?)(?P<row>\d+)_(?P<column>\d+)_(?P<y>{_NUMBER})_(?P<x>{_NUMBER})(?:_[^_]*)*\.\w+")
_GRID = re.compile(r"(?P<prefix>.*?)(?P<row>\d+)[_x,-](?P<column>\d+)\.\w+")
KNOWN = (
    ("HCI (input_Cam{index}.png)", _HCI),
    ("row, column and camera position ({row}_{column}_{y}_{x})", _PLACED),
    ("row and column ({row}_{column})", _GRID),
)
_FIELDS = re.compile(r"(\{-?(?:row|column|index)\}|\*)")
_FEWEST = 4
"""Fewer pictures with numbers in their names are no light field."""


@dataclass(frozen=True)
class ViewFiles:
    """The views of one folder.

    Attributes:
        naming: how the names were understood.
        grid: the files, ``grid[row][column]``, in the package's orientation.
    """

    naming: str
    grid: tuple[tuple[Path, ...], ...]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the grid."""
        return len(self.grid), len(self.grid[0])

    @property
    def files(self) -> list[Path]:
        """All files, row after row."""
        return [file for row in self.grid for file in row]


def find_views(folder: Path, pattern: str | None = None, side: Place | None = None) -> ViewFiles | None:
    """The views in a folder, or None where no naming is recognised and no pattern was given.

    Args:
        folder: where the pictures lie.
        pattern: file name with ``{row}`` and ``{column}``, or ``{index}`` counted row after row; ``{-row}`` and
            ``{-column}`` for numbers that run the other way; ``*`` for any text. Recognised without it: the HCI
            benchmark's names; names with the camera's position in image axes (x to the right, y down), as
            Stanford's archive has; and names that end in row and column (INRIA's, a plain ``2_3.png``).
        side: rows and columns, where they are known from elsewhere.

    Raises:
        DataError: views are missing, there twice or too many, or none has the pattern's name.
        SettingError: a pattern without row and column.
    """
    names = _pictures(folder)
    if pattern is not None:
        label, matches = pattern, _matches(names, _expression(pattern))
        if not matches:
            raise DataError(folder, "no picture with such a name", pattern, "give the names' pattern= (--pattern)")
    else:
        recognised = ((label, _matches(names, expression)) for label, expression in KNOWN)
        label, matches = next((each for each in recognised if len(each[1]) >= _FEWEST), ("", []))
        if not matches:
            return None
    return ViewFiles(label, _gridded(folder, matches, pattern or "", side))


def has_names(folder: Path, pattern: str) -> bool:
    """Whether some picture in a folder has a name of the pattern.

    Raises:
        SettingError: a pattern without row and column.
    """
    return bool(_matches(_pictures(folder), _expression(pattern)))


def _pictures(folder: Path) -> list[Path]:
    return sorted(file for file in folder.iterdir() if file.suffix.lower() in PICTURES and file.is_file())


def _matches(names: Iterable[Path], expression: re.Pattern[str]) -> list[tuple[Path, re.Match[str]]]:
    """The files of the commonest prefix whose whole name fits."""
    groups: dict[str, list[tuple[Path, re.Match[str]]]] = defaultdict(list)
    for file in names:
        if match := expression.fullmatch(file.name):
            groups[match.groupdict().get("prefix", "")].append((file, match))
    return max(groups.values(), key=len, default=[])


def _expression(pattern: str) -> re.Pattern[str]:
    fields = {field.strip("{-}") for field in _FIELDS.findall(pattern)} - {"*"}
    if fields not in ({"row", "column"}, {"index"}):
        remedy = "such as view_{row}_{column}.png, or {-row} where rows run upwards"
        raise SettingError("pattern", repr(pattern), "{row} and {column}, or {index}", remedy)
    parts = (
        ".*" if part == "*" else rf"(?P<{part.strip('{-}')}>\d+)" if _FIELDS.fullmatch(part) else re.escape(part)
        for part in _FIELDS.split(pattern)
    )
    try:
        return re.compile("".join(parts))
    except re.error as error:
        raise SettingError("pattern", repr(pattern), "{row}, {column} or {index} once each") from error


def _gridded(
    folder: Path, matches: list[tuple[Path, re.Match[str]]], pattern: str, side: Place | None
) -> tuple[tuple[Path, ...], ...]:
    """The files in rows and columns; those that are numbered are so row after row from 0."""
    fields = matches[0][1].groupdict()
    numbered = "index" in fields
    if numbered:
        side = side or _square(len(matches))
        places = [(file, divmod(int(m["index"]), side[1])) for file, m in matches]
    else:
        places = [(file, (int(m["row"]), int(m["column"]))) for file, m in matches]
    grid: dict[Place, Path] = {}
    for file, place in places:
        if place in grid:
            raise DataError(file, f"a second picture of one view beside {grid[place].name}", "one of each", "remove it")
        grid[place] = file
    ranges = [range(n) for n in side] if numbered and side else [_spread({p[axis] for p in grid}) for axis in (0, 1)]
    _require_complete(folder, grid, ranges[0], ranges[1], numbered)
    rows, columns = ([*numbers] for numbers in ranges)
    if "y" in fields:
        positions = {place: (float(m["y"]), float(m["x"])) for (_, m), (_, place) in zip(matches, places, strict=True)}
        rows, columns = (_by_position(positions, axis) for axis in (0, 1))
    rows, columns = rows[:: -1 if "{-row}" in pattern else 1], columns[:: -1 if "{-column}" in pattern else 1]
    return tuple(tuple(grid[row, column] for column in columns) for row in rows)


def _square(count: int) -> Place:
    """Rows and columns of about so many views."""
    rows = isqrt(count)
    rows = rows if rows**2 == count else min(range(1, 100, 2), key=lambda n: abs(n * n - count))
    return rows, rows


def _spread(numbers: set[int]) -> range:
    """From the first number to the last, at their smallest distance."""
    ordered = sorted(numbers)
    return range(ordered[0], ordered[-1] + 1, min((b - a for a, b in pairwise(ordered)), default=1))


def _require_complete(folder: Path, found: dict[Place, Path], rows: range, columns: range, numbered: bool) -> None:
    """Refuse a grid with places without a picture, and pictures without a place."""

    def said(places: Iterable[Place]) -> str:
        few = [f"number {r * len(columns) + c}" if numbered else f"row {r} column {c}" for r, c in islice(places, 4)]
        return ", ".join(few[:3]) + (" and more" if len(few) > 3 else "")

    gone = said((r, c) for r in rows for c in columns if (r, c) not in found)
    extra = said(place for place in found if place[0] not in rows or place[1] not in columns)
    if gone or extra:
        what = f"{len(found)} views, {f'none for {gone}' if gone else f'{extra} too'}"
        remedy = "add what is missing, or take away what does not belong"
        raise DataError(folder, what, f"one for each place of a {len(rows)}×{len(columns)} grid", remedy)


def _by_position(positions: dict[Place, tuple[float, float]], axis: int) -> list[int]:
    """The rows' (or columns') numbers in the order of the camera's mean position along that axis."""
    along: dict[int, list[float]] = defaultdict(list)
    for place, position in positions.items():
        along[place[axis]].append(position[axis])
    numbers = sorted(along)
    ends = [sum(along[number]) / len(along[number]) for number in (numbers[0], numbers[-1])]
    return numbers[::-1] if ends[0] > ends[1] else numbers
