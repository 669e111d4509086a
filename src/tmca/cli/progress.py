"""Progress of commands on standard error: bars, and lines for the cells of a table."""

from __future__ import annotations

import sys

from tmca.progress import Report, progress_bar

__all__ = ["Report", "cell_done", "progress_bar"]


def cell_done(done: int, total: int, name: str, left: float) -> None:
    """A line for a finished cell of a table; ``left`` is in seconds."""
    time_left = f" · {left / 60:.1f} min left" if done < total else ""
    print(f"[{done}/{total}] {name}{time_left}", file=sys.stderr)
