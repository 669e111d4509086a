"""``tmca demo``: the whole chain on rendered scenes, nothing downloaded."""

from __future__ import annotations

import sys
from pathlib import Path

from tmca.cli.options.numbers import size as parsed_size
from tmca.cli.options.output import Json, Markdown, Overwrite, say
from tmca.errors import OutputError
from tmca.progress import progress_bar


def demo(
    *,
    out: Path = Path("tmca-demo"),
    size: str = "192x256",
    jobs: int = 2,
    overwrite: Overwrite = False,
    json: Json = False,
    markdown: Markdown = False,
) -> None:
    """Rendered scenes → snapshots with a static and a time-multiplexed code → reconstructions, table, HTML report.

    Args:
        out: folder for snapshots, reconstructions, pictures and report.html.
        size: HEIGHTxWIDTH of the scenes.
        jobs: scenes that are computed side by side.
    """
    if out.exists() and not out.is_dir():
        raise OutputError(out, "a file", "a folder or a new name", "choose another --out")
    wanted = parsed_size(size)
    assert wanted is not None
    print("tmca demo: loading", file=sys.stderr)
    from tmca.applications import APPLICATIONS
    from tmca.applications.demo import demo_columns, run_demo
    from tmca.evaluation.tables import markdown_table

    with progress_bar("demo") as progress:
        results = run_demo(out, size=wanted, overwrite=overwrite, progress=progress, jobs=jobs)
    tables = (
        f"A {kind} camera:\n\n" + markdown_table(results[application.demo.key], demo_columns(kind))
        for kind, application in APPLICATIONS.items() if application.demo is not None
    )  # fmt: skip
    say(results, json, *tables, f"{results['seconds']:.0f} s; open {results['report']}", markdown=markdown)
