"""A sensor that is narrower than the light that falls on it."""

from __future__ import annotations

from torch import Tensor
from torch.nn.functional import pad

from tmca.operators.linear import LinearOperator


class SensorColumns(LinearOperator):
    """An operator whose snapshots are wider than the sensor, which is in their middle.

    Args:
        wide: the operator.
        beside: columns to the left and the right of the sensor.
    """

    def __init__(self, wide: LinearOperator, beside: tuple[int, int]) -> None:
        super().__init__()
        self.wide, self.beside, self.scene_shape = wide, beside, wide.scene_shape
        *front, columns = wide.snapshot_shape
        self.snapshot_shape = (*front, columns - sum(beside))

    def A(self, scene: Tensor) -> Tensor:
        """Scene → snapshot."""
        left, columns = self.beside[0], self.snapshot_shape[-1]
        return self.wide.A(scene)[..., left : left + columns]

    def A_adjoint(self, snapshot: Tensor) -> Tensor:
        """Snapshot → scene, the transpose of ``A``."""
        return self.wide.A_adjoint(pad(snapshot, self.beside))
