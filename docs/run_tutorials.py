"""Runs the tutorials as a notebook does. `python docs/run_tutorials.py [NAME…]` keeps what their pages show of it."""

from __future__ import annotations

import ast
import hashlib
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import chdir, redirect_stdout
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any, NamedTuple

import jupytext

FOLDER = Path(__file__).parent / "tutorials"
OUTPUTS = FOLDER / "outputs.json"
"""Of every tutorial a digest of its code, and what its cells printed, by their number."""
SCRIPTS = sorted(FOLDER.glob("*.py"))
SHOWN = "picture"
"""Tag of the cells whose picture is on the page."""


class Output(NamedTuple):
    """Of a cell: its number, what it printed or showed as text, and its picture as PNG."""

    number: int
    text: str
    picture: bytes | None


def cells(script: Path) -> list[Any]:
    """Cells of a notebook, as jupytext reads them."""
    return list(jupytext.read(script, fmt="py:percent").cells)


def digest(script: Path) -> str:
    """Of a tutorial's code: its texts may change without running it again."""
    code = "\n\n".join(cell.source for cell in cells(script) if cell.cell_type == "code")
    return hashlib.sha256(code.encode()).hexdigest()


def picture_of(script: Path, number: int) -> Path:
    """File of a cell's picture."""
    return script.with_name(f"{script.stem}-{number}.webp")


def run(script: Path) -> Iterator[Output]:
    """Runs cell after cell in the current folder, in one namespace, without a screen.

    Raises:
        RuntimeError: a cell failed; the message says which.
    """
    os.environ["MPLBACKEND"] = "agg"
    names: dict[str, Any] = {"__name__": "__main__"}
    for number, cell in enumerate(cells(script)):
        if cell.cell_type != "code":
            continue
        printed = StringIO()
        try:
            with redirect_stdout(printed):
                value = _value(cell.source, f"{script.name}, cell {number}", names)
        except BaseException as error:
            first = cell.source.partition("\n")[0]
            raise RuntimeError(f"{script.name}, cell {number} ({first} …): {error!r}") from error
        yield Output(number, *_shown(printed.getvalue(), value))


def _value(source: str, where: str, names: dict[str, Any]) -> Any:
    """Runs a cell; what its last line is, if that is an expression."""
    tree = ast.parse(source)
    last = tree.body[-1] if tree.body else None
    before = tree.body[:-1] if isinstance(last, ast.Expr) else tree.body
    exec(compile(ast.Module(before, []), where, "exec"), names)  # noqa: S102 - these are our own scripts
    if not isinstance(last, ast.Expr):
        return None
    return eval(compile(ast.Expression(last.value), where, "eval"), names)  # noqa: S307


def _shown(printed: str, value: Any) -> tuple[str, bytes | None]:
    """Text and picture of a cell: those of its value, and figures that pyplot holds."""
    from matplotlib import pyplot

    picture = None
    if hasattr(value, "savefig"):
        picture = _png(value)
    elif pyplot.get_fignums():
        picture = _png(pyplot.gcf())
    elif value is not None:
        printed += value.to_string() if hasattr(value, "to_string") else repr(value)
    pyplot.close("all")
    return printed.rstrip(), picture


def _png(figure: Any) -> bytes:
    drawn = BytesIO()
    figure.savefig(drawn, format="png", facecolor="white", bbox_inches="tight", pad_inches=0.1)
    return drawn.getvalue()


def main(beginnings: list[str]) -> None:
    """Runs those whose names begin so, or all; writes `OUTPUTS`, and pictures of the tagged cells."""
    from PIL import Image

    kept = json.loads(OUTPUTS.read_text()) if OUTPUTS.exists() else {}
    for script in (one for one in SCRIPTS if not beginnings or one.name.startswith(tuple(beginnings))):
        with tempfile.TemporaryDirectory() as folder, chdir(folder):
            outputs = list(run(script))
        shown = [n for n, cell in enumerate(cells(script)) if SHOWN in cell.metadata.get("tags", ())]
        for old in FOLDER.glob(f"{script.stem}-*.webp"):
            old.unlink()
        for output in outputs:
            if output.number in shown and output.picture is not None:
                with Image.open(BytesIO(output.picture)) as picture:
                    picture.convert("RGB").save(picture_of(script, output.number), quality=82, method=6)
        texts = {str(output.number): output.text for output in outputs if output.text}
        kept[script.stem] = {"code": digest(script), "texts": texts}
        print(script.name)
    OUTPUTS.write_text(json.dumps(kept, indent=1, ensure_ascii=False, sort_keys=True) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
