"""Progress of long work on standard error, with the time that is left."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_EVERY = 10.0
"""Seconds between two lines where nobody watches."""

Report = Callable[..., None]
"""Takes the share that is done, 0 to 1 (None: preparations, which tell nothing of the time left), and optionally
what is done next and figures that change all the time."""


@contextmanager
def progress_bar(label: str) -> Iterator[Report]:
    """A bar with an ETA; where nobody watches, a line for each step and every ten seconds."""
    if not sys.stderr.isatty():
        yield _Lines(label)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(label, total=1.0)
        yield lambda share, step=None, detail="": bars.update(
            task, completed=share, description=f"{step or label} {detail}".strip()
        )


class _Lines:
    """Progress as lines."""

    def __init__(self, label: str) -> None:
        self.label, self.last, self.step = label, time.monotonic(), ""
        self.first: tuple[float, float] | None = None

    def __call__(self, share: float | None, step: str | None = None, detail: str = "") -> None:
        now = time.monotonic()
        if share is not None:
            self.first = self.first or (now, share)
        fresh = step is not None and step != self.step
        if not fresh and now - self.last < _EVERY:
            return
        self.last, self.step = now, step or self.step
        done = "" if share is None else f"{share:4.0%}"
        print(" ".join(f"{self.label}: {done} {self.step} {detail}".split()) + self._left(share, now), file=sys.stderr)

    def _left(self, share: float | None, now: float) -> str:
        begun, before = self.first or (now, 0.0)  # a run that goes on did not do the first part now
        if share is None or share <= before:
            return ""
        left = (now - begun) * (1 - share) / (share - before)
        return "" if left < 1 else f", {left:.0f} s left" if left < 90 else f", {left / 60:.1f} min left"


def cell_done(done: int, total: int, name: str, left: float) -> None:
    """A line for a finished cell of a table; ``left`` is in seconds."""
    time_left = f" · {left / 60:.1f} min left" if done < total else ""
    print(f"[{done}/{total}] {name}{time_left}", file=sys.stderr)
