"""Faults of the bench that a run draws anew in every step, and that its decoder does not know."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from tmca.cameras import LIMITS, PAIRS, PARTS, Camera, Hardware, SomeCamera, defective, imperfect
from tmca.errors import SettingError
from tmca.sensor import Sensor

Ranges = Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class DrawnFaults:
    """Faults within ranges; none without.

    Args:
        ranges: least and largest value of every fault, drawn evenly; of a contrast ratio its inverse is.

    Raises:
        SettingError: an unknown fault, or an impossible value.
    """

    ranges: Ranges = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, (low, high) in self.ranges.items():
            if low > high:
                raise SettingError(f"faults.{name}", f"{low:g} to {high:g}", "the least value first")
        for end in (0, 1):  # together: shares of pixels may not exceed 1
            Hardware.of({name: both[end] for name, both in self.ranges.items()})

    def check(self, camera: Camera, untrained: Sequence[str] = ()) -> None:
        """Raises SettingError for faults that this camera, or a training of it, cannot have."""
        refused = (*PARTS[camera.kind], *untrained)
        for name in self.ranges:
            if name in refused:
                possible = ", ".join(other for other in LIMITS if other not in refused)
                raise SettingError(f"faults.{name}", "some", f"none in a {camera.kind} run, which has {possible}")
            imperfect(camera, Hardware.of({name: max(self.ranges[name], key=abs)}))

    def bench(self, camera: SomeCamera, sensor: Sensor, seed: tuple[int, ...]) -> tuple[SomeCamera, Sensor]:
        """Camera and sensor with the faults of a step; themselves without any."""
        if not self.ranges:
            return camera, sensor
        rng = np.random.default_rng(seed)
        hardware, drawn = self.drawn(rng), int(rng.integers(2**31))
        return imperfect(camera, hardware, drawn), defective(sensor, hardware, drawn, camera.buckets)

    def drawn(self, rng: np.random.Generator) -> Hardware:
        """One bench."""
        return Hardware.of({name: _drawn(name, *self.ranges[name], rng) for name in sorted(self.ranges)})


def _drawn(name: str, low: float, high: float, rng: np.random.Generator) -> float | list[float]:
    if name == "contrast_ratio":
        return float(1 / rng.uniform(1 / high, 1 / low))
    values = [float(rng.uniform(low, high)) for _ in range(2 if name in PAIRS else 1)]
    return values if name in PAIRS else values[0]
