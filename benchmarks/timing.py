"""How long a task takes, how much memory its process holds at most, and both beside their bounds."""

from __future__ import annotations

import argparse
import json
import resource
import statistics
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

_LEAST, _PASSES = 0.5, 20
"""Seconds, and most passes, of a median."""
_STATUS, _FORGET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


class Clock:
    """Seconds and peak memory on a device: CPU time of a processor unless wall time is asked for."""

    def __init__(self, device: str = "cpu", *, wall: bool = False) -> None:
        self.cuda = device.startswith("cuda")
        self.now = time.perf_counter if wall or self.cuda else time.process_time
        self.name = "CPU time" if self.now is time.process_time else "wall time"

    def seconds(self, task: Callable[[], object]) -> float:
        """Of a task, with all that it asked the device for."""
        self._wait()
        began = self.now()
        task()
        self._wait()
        return self.now() - began

    def median(self, task: Callable[[], object], repeats: int = 0, warm: int = 1) -> float:
        """Of so many runs of a task, or of as many as half a second takes, after some to warm up."""
        for _ in range(warm):
            task()
        times: list[float] = []
        while len(times) < (repeats or 3) or (not repeats and sum(times) < _LEAST and len(times) < _PASSES):
            times.append(self.seconds(task))
        return statistics.median(times)

    def forget_peak(self) -> None:
        """Let the peak begin anew at what is held now; only Linux can on a processor."""
        if self.cuda:
            import torch

            torch.cuda.reset_peak_memory_stats()
        else:
            with suppress(OSError):
                _FORGET.write_text("5")

    def peak(self) -> float:
        """GB since then."""
        if self.cuda:
            import torch

            return torch.cuda.max_memory_allocated() / 1e9
        return peak_memory()

    def _wait(self) -> None:
        if self.cuda:
            import torch

            torch.cuda.synchronize()


def milliseconds(task: Callable[[], object], repeats: int) -> float:
    """CPU time of a task, median after three rounds to warm up."""
    return 1e3 * Clock().median(task, repeats, warm=3)


def times_as_long(task: Callable[[], object], other: Callable[[], object], repeats: int) -> float:
    """CPU time of a task over that of another, median over pairs one after the other, so that both see one machine."""
    clock = Clock()
    for _ in range(3):
        task(), other()
    return statistics.median(clock.seconds(task) / clock.seconds(other) for _ in range(repeats))


def peak_memory() -> float:
    """GB that this process held at most; what `getrusage` tells of a child includes its parent's."""
    if _STATUS.exists():
        (line,) = (line for line in _STATUS.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) / 1e6
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def asked(description: str | None, repeats: int) -> argparse.Namespace:
    """``--repeats`` and ``--json`` of a benchmark."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--repeats", type=int, default=repeats)
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


Table = Mapping[str, Mapping[str, float]]
"""Title → name → number."""


def show(found: Table, bounds: Table, as_json: bool) -> None:
    """Print numbers under their titles, beside the bounds that some of them have."""
    if as_json:
        print(json.dumps({"found": found, "bounds": bounds}, indent=1))
        return
    for title, numbers in found.items():
        print(title)
        own = bounds.get(title, {})
        for name, value in numbers.items():
            print(f"  {name:36s} {value:10.3g}" + (f"  (bound {own[name]:g})" if name in own else ""))
