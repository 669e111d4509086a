"""``tmca demo``: the whole chain on rendered scenes, nothing downloaded."""

from __future__ import annotations

import json as json_module
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from tmca.errors import OutputError


def demo(
    *,
    out: Path = Path("tmca-demo"),
    size: str = "192x256",
    overwrite: Annotated[bool, Parameter(negative="")] = False,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Rendered scenes → snapshots with a static and a time-multiplexed code → reconstructions, table, HTML report.

    Args:
        out: folder for snapshots, reconstructions, pictures and report.html.
        size: HEIGHTxWIDTH of the scenes.
        overwrite: replace the results of an earlier demo.
        json: print the table as JSON.
    """
    from tmca.cli.options.numbers import size as parsed_size
    from tmca.cli.progress import progress_bar

    if out.exists() and not out.is_dir():
        raise OutputError(out, "a file", "a folder or a new name", "choose another --out")
    wanted = parsed_size(size)
    assert wanted is not None
    print("tmca demo: loading", file=sys.stderr)
    from tmca.experiments.demo import COLUMNS, run_demo
    from tmca.experiments.light_field.demo import COLUMNS as LIGHT_FIELD_COLUMNS
    from tmca.experiments.results import markdown_table
    from tmca.experiments.spectral_depth.demo import COLUMNS as SPECTRAL_DEPTH_COLUMNS

    with progress_bar("demo") as progress:
        found = run_demo(out, size=wanted, overwrite=overwrite, progress=progress)
    if json:
        print(json_module.dumps(found, indent=1))
        return
    print("A spectral camera:\n\n" + markdown_table(found["rows"], COLUMNS))
    print("A light-field camera:\n\n" + markdown_table(found["light_field"], LIGHT_FIELD_COLUMNS))
    print("A spectral-depth camera:\n\n" + markdown_table(found["spectral_depth"], SPECTRAL_DEPTH_COLUMNS))
    print(f"{found['seconds']:.0f} s; open {found['report']}")
