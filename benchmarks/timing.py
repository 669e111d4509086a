"""How long a task takes."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable


def milliseconds(task: Callable[[], object], repeats: int) -> float:
    """CPU time of a task, median after three rounds to warm up."""
    for _ in range(3):
        task()
    times = []
    for _ in range(repeats):
        start = time.process_time_ns()
        task()
        times.append((time.process_time_ns() - start) / 1e6)
    return statistics.median(times)
