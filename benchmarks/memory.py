"""How much memory a process has held at most."""

from __future__ import annotations

import resource
from pathlib import Path

_STATUS, _FORGET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def peak_memory() -> float:
    """GB that this process held at most; what `getrusage` tells of a child includes its parent's."""
    if _STATUS.exists():
        (line,) = (line for line in _STATUS.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) / 1e6
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def forget_peak() -> bool:
    """Let the peak begin anew at what the process holds now; False where the system cannot (it is Linux that can)."""
    try:
        _FORGET.write_text("5")
    except OSError:
        return False
    return True
