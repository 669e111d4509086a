"""What ``tmca inspect`` says about a light field."""

from __future__ import annotations

from typing import Any

from tmca.data.datasets import SUFFIXES as LABELLED
from tmca.data.disparity import find_disparity, read_disparity
from tmca.data.formats.stored import Contents, Stored
from tmca.data.light_fields import VIEW_DIMS, has_colour, load_views
from tmca.data.shifts import shift_facts
from tmca.errors import DataError


def describe_light_field(contents: Contents, stored: Stored, pattern: str | None = None) -> dict[str, Any]:
    """Kind and facts of a light field: views, size, colour, naming, shifts between views, true disparity.

    The shifts are those of `tmca.data.view_shifts` where the grid is 3×3 or more. ``pattern`` is the one that the views
    were opened with.
    """
    size = dict(zip(stored.dims, stored.shape, strict=True))
    rows, columns, height, width = (size[dim] for dim in VIEW_DIMS)
    facts: dict[str, Any] = {
        "views": [rows, columns],
        "size": [height, width],
        "colour": has_colour(stored),
        "pattern": contents.attrs.get("pattern") or stored.attrs.get("pattern") or contents.format,
        "shifts": None,
        "disparity": _disparity(contents, pattern),
    }
    if min(rows, columns) >= 3:
        facts["shifts"] = shift_facts(load_views(contents, stored, views=3)) or None
    about = {"kind": "light field", "variable": stored.name, "dims": stored.dims, "light_field": facts}
    notes = [facts["shifts"].pop("note", None)] if facts["shifts"] else []
    if rows != columns or rows % 2 == 0:
        notes.append(f"{rows}×{columns} views: read the centre n×n, n odd, with views= (--views)")
    if any(notes):
        about["note"] = "; ".join(note for note in notes if note)
    return {**about, "wavelengths": None}


def _disparity(contents: Contents, pattern: str | None) -> dict[str, Any] | None:
    """Range and file of the true disparity, None without."""
    source = find_disparity(contents.path)
    if contents.path.suffix.lower() in LABELLED and "disparity" in contents.arrays:
        source = contents.path
    if source is None:
        return None
    try:
        values = read_disparity(contents.path, pattern=pattern)
    except DataError as error:
        return {"source": source.name, "min": None, "max": None, "note": str(error)}
    return {"source": source.name, "min": float(values.min()), "max": float(values.max())}
