"""Sizes of the network of any camera, and of what it learns from in a piece of training, by machine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

RANK = 16
"""Dimensions of the subspace, those of the prior."""
BLOCK = (12, 122)
"""Rows and columns of the prior: enough for 54 columns of dispersion."""


@dataclass(frozen=True)
class Preset:
    """How much is learned, and from how much.

    Args:
        network: settings of `SubspaceNetwork`, but for its rank.
        size: side of the scenes, pixels.
        cameras: most that a piece draws.
        scenes: that each of them sees.
        drawing: seconds after which no more cameras are drawn.
        batch: scenes of a step.
    """

    network: dict[str, Any]
    size: int
    cameras: int
    scenes: int
    drawing: float
    batch: int


PRESETS = {
    "large": Preset({"stages": 3, "widths": (80, 112, 144), "blocks": 2, "gather": 2}, 256, 64, 16, 70.0, 6),
    "small": Preset({"stages": 2, "widths": (32, 48, 64), "blocks": 1, "gather": 2}, 128, 96, 6, 300.0, 2),
}
"""``large`` for graphics processors: 2.6 million parameters; ``small`` for one or two processor cores: 0.3 million, and
half of the time for first estimates: one costs as much as ten steps of a scene, and with fewer, used more often, the
network learns these by heart."""
