"""Lines for the cells of a table, as they are done."""

from __future__ import annotations

import sys


def cell_done(done: int, total: int, name: str, left: float) -> None:
    """A line for a finished cell of a table; ``left`` is in seconds."""
    time_left = f" · {left / 60:.1f} min left" if done < total else ""
    print(f"[{done}/{total}] {name}{time_left}", file=sys.stderr)
