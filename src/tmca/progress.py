"""Progress of long work on standard error or in a notebook, with the time that is left.

Work is given a callable, which takes the share that is done; what a ``progress`` argument asks for becomes one here.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from typing import Any, Protocol

Report = Callable[..., None]
"""Takes the share that is done, 0 to 1 (None: preparations, which tell nothing of the time left), and optionally
what is done next and figures that change all the time."""
Asked = bool | Report | None
"""A ``progress`` argument: a callable, which is called; True: a bar, or lines where nobody watches; False: nothing;
None: a bar in a terminal and in a notebook once the work takes longer than a second."""
_EVERY, _LATER, _REDRAWN = 10.0, 1.0, 0.2
"""Seconds: between two lines where nobody watches, before a bar that nobody asked for, between two pictures of one."""


class _Display(Protocol):
    """Shows progress until it is closed."""

    def __call__(self, share: float | None, step: str | None = None, detail: str = "") -> None: ...

    def close(self) -> None: ...


@contextmanager
def progress_bar(label: str) -> Iterator[Report]:
    """A bar with an ETA; where nobody watches, a line for each step and every ten seconds."""
    shown = (_watched() or _Lines)(label)
    try:
        yield shown
    finally:
        shown.close()


@contextmanager
def reporting(progress: Asked, label: str) -> Iterator[Report | None]:
    """What work is to call, as a ``progress`` argument asks; None where nobody is told."""
    if progress is True:
        with progress_bar(label) as report:
            yield report
        return
    kind = _watched()
    if progress is not None or kind is None:
        yield progress or None
        return
    shown = _Later(kind, label)
    try:
        yield shown
    finally:
        shown.close()


@contextmanager
def counting(progress: Asked, label: str) -> Iterator[Report | None]:
    """The same for work that calls with (done, all, name, …)."""
    with reporting(progress, label) as report:
        if report is None or callable(progress):
            yield report
        else:
            shown = report
            yield lambda done, total, name="", *_: shown(done / total, None, name)


def _watched() -> Callable[[str], _Display] | None:
    """How progress is shown to somebody; None where nobody watches."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if getattr(shell, "kernel", None) is not None:
        return _Notebook
    return _Terminal if sys.stderr.isatty() else None


class _Later:
    """A display that begins once work takes longer than a second."""

    def __init__(self, kind: Callable[[str], _Display], label: str) -> None:
        self.kind, self.label, self.begun = kind, label, time.monotonic()
        self.shown: _Display | None = None

    def __call__(self, share: float | None, step: str | None = None, detail: str = "") -> None:
        if self.shown is None and time.monotonic() - self.begun >= _LATER:
            self.shown = self.kind(self.label)
        if self.shown is not None:
            self.shown(share, step, detail)

    def close(self) -> None:
        if self.shown is not None:
            self.shown.close()


class _Terminal:
    """A bar, which is wiped at the end."""

    def __init__(self, label: str) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

        columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
        self.label, self.bars = label, Progress(*columns, console=Console(stderr=True), transient=True)
        self.task = self.bars.add_task(label, total=1.0)
        self.bars.start()

    def __call__(self, share: float | None, step: str | None = None, detail: str = "") -> None:
        self.bars.update(self.task, completed=share, description=f"{step or self.label} {detail}".strip())

    def close(self) -> None:
        self.bars.stop()


class _Remaining:
    """The time that is left, from the shares that were done so far."""

    def __init__(self) -> None:
        self.first: tuple[float, float] | None = None

    def __call__(self, share: float | None, now: float) -> str:
        if share is not None:
            self.first = self.first or (now, share)
        begun, before = self.first or (now, 0.0)  # a run that goes on did not do the first part now
        if share is None or share <= before:
            return ""
        left = (now - begun) * (1 - share) / (share - before)
        return "" if left < 1 else f", {left:.0f} s left" if left < 90 else f", {left / 60:.1f} min left"


class _Notebook:
    """A bar below the cell, which is replaced by the time that all took; it needs no widgets."""

    def __init__(self, label: str) -> None:
        from IPython.display import HTML, display

        self.label, self.begun, self.last, self.page = label, time.monotonic(), 0.0, HTML
        self.left, self.step = _Remaining(), ""
        self.handle: Any = display(HTML(escape(label)), display_id=True)

    def __call__(self, share: float | None, step: str | None = None, detail: str = "") -> None:
        now = time.monotonic()
        left = self.left(share, now)
        self.step = step or self.step
        if now - self.last < _REDRAWN:
            return
        self.last = now
        value = "" if share is None else f' value="{share:.3f}"'
        done = "" if share is None else f"{share:.0%}"
        text = escape(" ".join(f"{self.label}: {done} {self.step} {detail}".split()) + left)
        self.handle.update(self.page(f'<progress max="1"{value} style="width:16em"></progress> {text}'))

    def close(self) -> None:
        self.handle.update(self.page(escape(f"{self.label}: {time.monotonic() - self.begun:.1f} s")))


class _Lines:
    """Progress as lines."""

    def __init__(self, label: str) -> None:
        self.label, self.last, self.step, self.left = label, time.monotonic(), "", _Remaining()

    def __call__(self, share: float | None, step: str | None = None, detail: str = "") -> None:
        now = time.monotonic()
        left = self.left(share, now)
        fresh = step is not None and step != self.step
        if not fresh and now - self.last < _EVERY:
            return
        self.last, self.step = now, step or self.step
        done = "" if share is None else f"{share:4.0%}"
        print(" ".join(f"{self.label}: {done} {self.step} {detail}".split()) + left, file=sys.stderr)

    def close(self) -> None:
        """Nothing is left to do."""
