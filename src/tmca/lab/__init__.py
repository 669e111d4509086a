"""What stands on the optical table: devices, captures, calibration, ground truth."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tmca.lab.bench import Bench, export
    from tmca.lab.calibration.apply import calibrated_snapshot
    from tmca.lab.calibration.file import Calibration, load_calibration
    from tmca.lab.display.export import Export

_HOMES = {
    "Bench": "tmca.lab.bench",
    "Calibration": "tmca.lab.calibration.file",
    "Export": "tmca.lab.display.export",
    "calibrated_snapshot": "tmca.lab.calibration.apply",
    "export": "tmca.lab.bench",
    "load_calibration": "tmca.lab.calibration.file",
}

__all__ = ["Bench", "Calibration", "Export", "calibrated_snapshot", "export", "load_calibration"]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'tmca.lab' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
