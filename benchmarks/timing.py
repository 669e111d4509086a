"""How long a task takes."""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable


def milliseconds(task: Callable[[], object], repeats: int) -> float:
    """CPU time of a task, median after three rounds to warm up."""
    for _ in range(3):
        task()
    return statistics.median(once(task) for _ in range(repeats))


def times_as_long(task: Callable[[], object], other: Callable[[], object], repeats: int) -> float:
    """CPU time of a task over that of another, median over pairs one after the other, so that both see one machine."""
    for _ in range(3):
        task(), other()
    return statistics.median(once(task) / once(other) for _ in range(repeats))


def once(task: Callable[[], object]) -> float:
    """CPU time of one run, milliseconds."""
    start = time.process_time_ns()
    task()
    return (time.process_time_ns() - start) / 1e6


def asked(description: str | None, repeats: int) -> argparse.Namespace:
    """``--repeats`` and ``--json`` of a benchmark."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--repeats", type=int, default=repeats)
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()
