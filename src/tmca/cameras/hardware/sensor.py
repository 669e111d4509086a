"""A sensor with pixels that are stuck."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from tmca.sensor import Sensor


class DefectiveSensor(Sensor):
    """A sensor some of whose pixels are stuck at full scale or at zero.

    Args:
        hot: share of pixels at full scale.
        dead: share of pixels at zero.
        seed: of their places, which every snapshot has alike.
        settings: of the sensor.
    """

    def __init__(self, hot: float, dead: float, seed: int = 0, **settings: Any) -> None:
        super().__init__(**settings)
        self.hot, self.dead, self.seed = hot, dead, seed

    def forward(
        self,
        irradiance: Tensor,
        full_scale: float,
        generator: torch.Generator | int | None = None,
        exposures: int = 1,
    ) -> Tensor:
        """See ``Sensor``."""
        found = super().forward(irradiance, full_scale, generator, exposures)
        drawn = torch.rand(found.shape[1:], generator=torch.Generator().manual_seed(self.seed)).to(found.device)
        found = torch.where(drawn < self.hot, full_scale * exposures, found)
        return torch.where((drawn >= self.hot) & (drawn < self.hot + self.dead), 0.0, found)
