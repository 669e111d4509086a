"""Pages of the documentation site that are made: the project's own texts, the commands, the Python names."""

from __future__ import annotations

import json
import re
import sys
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import Any

import griffe
import jupytext
from cyclopts.help import PlainFormatter
from file_formats import files_page
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
sys.path.append(str(Path(__file__).parent))  # the hook is loaded by its file
import run_tutorials as tutorials  # noqa: E402

TEXTS = {
    "index.md": "README.md",
    "contributing.md": "CONTRIBUTING.md",
    "security.md": "SECURITY.md",
    "changelog.md": "CHANGELOG.md",
    "weights.md": "src/tmca/weights/README.md",
}
"""Pages, and the files of the project that they show."""
SOURCES = TEXTS | {f"tutorials/{script.stem}.md": f"docs/tutorials/{script.name}" for script in tutorials.SCRIPTS}
"""The same with the pages that are made of tutorials."""
ROOMS = (
    *("cameras", "sensor", "codes", "optics", "operators", "decoders", "priors", "design"),
    *("applications", "training", "evaluation", "lab", "data", "metrics", "plots", "dbd", "adapters", "testing"),
    "errors",
)
_LINK = re.compile(r"(?<!!)\[([^\]]*)\]\((?![a-z]+:|#)([^)\s]+)\)")
_IMAGE = re.compile(r"(!\[[^\]]*\]\()docs/")
_EXAMPLE = re.compile(r"(?m)^>>>(?:.*\n?)(?:.+\n?)*")
"""Of a docstring: from its first prompt to the next empty line."""
_SHOWN_MATH = re.compile(r"\$\$(.+?)\$\$", re.S)


class Examples(griffe.Extension):
    """Runnable examples of docstrings are shown as code."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        if obj.docstring:
            obj.docstring.value = _EXAMPLE.sub(lambda code: f"```pycon\n{code[0].rstrip()}\n```\n", obj.docstring.value)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages that are made."""
    made = {page: (ROOT / file).read_text() for page, file in TEXTS.items()}
    made |= {"reference/commands.md": commands(), "reference/python.md": overview(), "reference/files.md": files_page()}
    made |= {f"reference/{room}.md": python(room) for room in ROOMS}
    for script in tutorials.SCRIPTS:
        made |= {f"tutorials/{script.stem}.md": tutorial(script), f"tutorials/{script.stem}.ipynb": notebook(script)}
    for page, text in made.items():
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, config: MkDocsConfig, files: Files) -> str:
    """Links lead to pages of the site, formulas become MathML, which needs no script."""
    here = page.file.src_uri
    source = Path(SOURCES.get(here, f"docs/{here}")).parent
    text = _LINK.sub(lambda link: _linked(link, here, source), _IMAGE.sub(r"\1", markdown))
    return _SHOWN_MATH.sub(lambda formula: convert(formula[1].strip(), display="block"), text)


def _linked(link: re.Match[str], here: str, source: Path) -> str:
    """A link as the site has it; to files that are no pages: its words alone."""
    target, _, anchor = link[2].partition("#")
    file = (ROOT / source / target).resolve()
    if not file.is_relative_to(ROOT):
        return link[0]
    page = {str(ROOT / text): name for name, text in SOURCES.items()}.get(str(file))
    if page is None and file.is_relative_to(ROOT / "docs"):
        page = file.relative_to(ROOT / "docs").as_posix()
    if page is None:
        return link[1]
    up, words = "../" * here.count("/"), link[1].removeprefix("docs/").removesuffix(".md")
    return f"[{words}]({up}{page}{'#' + anchor if anchor else ''})"


def commands() -> str:
    """Every command with all its options, as ``--help-all`` shows them."""
    from rich.console import Console

    from tmca.cli.app import COMMANDS, app

    app.help_formatter, app.help_epilogue = PlainFormatter(), None
    parts = [
        "# Command line",
        "Every command and option. `tmca COMMAND --help` shows the most used of them on a screen.",
    ]
    for name in COMMANDS:
        parts.append(f"## tmca {name}")
        for words in _subcommands(app, [name]):
            out = StringIO()
            app.help_print(words, console=Console(file=out, width=92, color_system=None))
            title = f"### {' '.join(words)}\n\n" if len(words) > 1 else ""
            parts.append(f"{title}```text\n{out.getvalue().strip()}\n```")
    return "\n\n".join(parts) + "\n"


def _subcommands(app: Any, words: list[str]) -> list[list[str]]:
    own = app[words[0]]
    for word in words[1:]:
        own = own[word]
    names = [name for name in own if not name.startswith("-")]
    return [words, *(deeper for name in names for deeper in _subcommands(app, [*words, name]))]


def overview() -> str:
    """The rooms of the package, with what they hold."""
    rows = [
        f"| [`tmca.{room}`]({room}.md) | {(import_module(f'tmca.{room}').__doc__ or '').strip()} |" for room in ROOMS
    ]
    faces = "`read`, `simulate`, `reconstruct`, `evaluate`, `design_codes`, `train`"
    text = f"The functions {faces} of `tmca` are the short way for every camera. The rooms below hold what they use."
    return "\n".join(["# Python", "", text, "", "| | |", "|---|---|", *rows, ""])


def tutorial(script: Path) -> str:
    """A tutorial with what its cells print and draw."""
    kept = json.loads(tutorials.OUTPUTS.read_text())[script.stem]["texts"]
    parts = []
    for number, cell in enumerate(tutorials.cells(script)):
        parts.append(cell.source if cell.cell_type == "markdown" else f"```python\n{cell.source}\n```")
        if text := kept.get(str(number)):
            parts.append(f'```{{.text .output title="prints"}}\n{text}\n```')
        picture = tutorials.picture_of(script, number)
        if picture.exists():
            parts.append(f"![What this cell draws]({picture.name})")
    parts.insert(1, f"[Download this page as a notebook]({script.stem}.ipynb){{ download='' }}.")
    return "\n\n".join(parts) + "\n"


def notebook(script: Path) -> str:
    """A tutorial for Jupyter; its links lead to notebooks and pages of the site beside it."""
    book = jupytext.read(script, fmt="py:percent")
    for cell in book.cells:
        if cell.cell_type == "markdown":
            cell.source = re.sub(r"\.md\)", ".html)", re.sub(r"\.py\)", ".ipynb)", cell.source))
    return jupytext.writes(book, fmt="ipynb")


def python(room: str) -> str:
    """Every public name of a room."""
    module = import_module(f"tmca.{room}")
    parts = [f"# tmca.{room}", (module.__doc__ or "").strip()]
    for name in getattr(module, "__all__", []):
        value = getattr(module, name)
        if str(getattr(value, "__module__", "")).startswith("tmca.") and hasattr(value, "__qualname__"):
            parts.append(f"::: {value.__module__}.{value.__qualname__}")
    return "\n\n".join(parts) + "\n"
