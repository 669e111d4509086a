"""``tmca view``: look at files in a browser."""

from __future__ import annotations

import sys
from pathlib import Path

from tmca.cli.options.numbers import On, Whole
from tmca.cli.options.output import Overwrite


def view(
    *files: str,
    truth: str | None = None,
    variable: str | None = None,
    port: Whole = 0,
    browser: On = True,
    static: Path | None = None,
    overwrite: Overwrite = False,
) -> None:
    """Look at FILES in a browser: cubes, snapshots with their codes, light fields, scenes with depth.

    The page shows bands and colours, spectra at the cursor and of regions, and, where there are several files of one
    kind, all of them side by side with differences and errors. It is served to this machine alone and changes no
    file. Ctrl-C ends it.

    Args:
        files: files or folders that `tmca inspect` knows, or names of rendered scenes.
        truth: the scene that FILES are estimates of: a file or a rendered scene's name.
        variable: which one, where a file holds several.
        port: of the page on this machine; any that is free without.
        browser: open the page in the browser.
        static: write the page to this file (HTML, 10 MB at most) instead; it needs neither Python nor a network.
    """
    names = files if truth is None else (*files, truth)
    if names and static is None:
        print(f"reading {', '.join(names) if len(names) < 4 else f'{len(names)} files'} …", flush=True)
    import tmca

    if static is not None:
        from tmca.data import check_target

        check_target(static, overwrite)
        print(tmca.viewer.write_static(static, *files, truth=truth, variable=variable, overwrite=overwrite))
        return
    with tmca.view(*files, truth=truth, variable=variable, port=port, browser=browser) as viewer:
        print(f"page: {viewer.address}", file=sys.stderr, flush=True)
        viewer.wait()
