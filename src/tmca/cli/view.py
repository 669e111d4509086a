"""``tmca view``: look at files in a browser."""

from __future__ import annotations

import sys

from tmca.cli.options.numbers import On, Whole


def view(
    *files: str,
    truth: str | None = None,
    variable: str | None = None,
    port: Whole = 0,
    browser: On = True,
) -> None:
    """Look at FILES in a browser: cubes, snapshots with their codes, light fields, scenes with depth, radar results.

    The page shows bands and colours, spectra at the cursor and of regions, and, where there are several files of one
    kind, all of them side by side with differences and errors. It is served to this machine alone and changes no
    file. Ctrl-C ends it.

    Args:
        files: files or folders that `tmca inspect` knows, or names of rendered scenes.
        truth: the scene that FILES are estimates of: a file or a rendered scene's name.
        variable: which one, where a file holds several.
        port: of the page on this machine; any that is free without.
        browser: open the page in the browser.
    """
    import tmca

    with tmca.view(*files, truth=truth, variable=variable, port=port, browser=browser) as viewer:
        print(f"page: {viewer.address}", file=sys.stderr, flush=True)
        viewer.wait()
