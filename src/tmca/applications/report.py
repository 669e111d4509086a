"""HTML reports: one file with its pictures inside, so that it can be mailed and opened anywhere."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca import __version__
from tmca.data import write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_QUALITY = 85


@dataclass
class Section:
    """A heading with text, a table and pictures.

    Args:
        title: heading.
        text: paragraphs.
        points: of a list above them.
        table: rows of a table, dictionaries.
        columns: (key, heading, format) of the table's columns.
        figures: caption → figure, or the file of one (PNG, GIF).
    """

    title: str
    text: Sequence[str] = ()
    table: Sequence[dict[str, Any]] = ()
    columns: Sequence[tuple[str, str, str]] = ()
    figures: dict[str, Figure | Path] = field(default_factory=dict)
    points: Sequence[str] = ()


def write_report(path: str | Path, title: str, sections: Sequence[Section], *, overwrite: bool = False) -> Path:
    """Write an HTML page.

    Raises:
        OutputError: the file exists, or cannot be written.
    """
    import jinja2

    source = files("tmca.applications").joinpath("report.html.j2").read_text(encoding="utf-8")
    template = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined).from_string(source)
    page = template.render(title=title, version=__version__, sections=[_rendered(section) for section in sections])
    return write_text(page, path, overwrite=overwrite)


def _rendered(section: Section) -> dict[str, Any]:
    rows = [
        [format(row[key], spec) if row.get(key) is not None else "" for key, _, spec in section.columns]
        for row in section.table
    ]
    return {
        "title": section.title,
        "text": section.text,
        "points": section.points,
        "headings": [heading for _, heading, _ in section.columns],
        "rows": rows,
        "figures": [(caption, *_embedded(figure)) for caption, figure in section.figures.items()],
    }


def _embedded(figure: Figure | Path) -> tuple[str, str]:
    """Media type and content of a picture: as it is or as WebP, whichever is smaller."""
    content = figure.read_bytes() if isinstance(figure, Path) else _png(figure)
    kind = "gif" if isinstance(figure, Path) and figure.suffix == ".gif" else "png"
    kind, smaller = min((kind, content), ("webp", _webp(content)), key=lambda one: len(one[1]))
    return f"image/{kind}", base64.b64encode(smaller).decode()


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=max(figure.dpi, 110), format="png", facecolor="white")
    return buffer.getvalue()


def _webp(picture: bytes) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    Image.open(io.BytesIO(picture)).save(buffer, "WEBP", quality=_QUALITY, save_all=True)
    return buffer.getvalue()
