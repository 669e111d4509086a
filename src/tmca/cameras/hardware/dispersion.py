"""A prism that disperses otherwise than sensor and shutter were laid out for."""

from __future__ import annotations

from torch import Tensor

from tmca.cameras.spectral import SpectralCamera
from tmca.operators import LinearOperator, TapOperator
from tmca.optics import Dispersion


def beyond(dispersion: Dispersion, known: Dispersion) -> tuple[int, int]:
    """Columns that a dispersion needs to the left and to the right of a sensor that was laid out for another one."""
    left = max(0, known.origin - dispersion.origin)
    right = max(0, dispersion.origin + dispersion.spread - known.origin - known.spread)
    return left, right


def over(dispersion: Dispersion, known: Dispersion) -> Dispersion:
    """The same dispersion on a sensor that begins and ends where both do, as ``beyond`` widens it.

    What the known one has beside it is filled by bands of no light (see ``DisplacedCamera``).
    """
    return WideDispersion(dispersion.displacement, *_ends(dispersion, known))


def _ends(one: Dispersion, other: Dispersion) -> tuple[int, int]:
    first = min(one.origin, other.origin)
    return first, max(one.origin + one.spread, other.origin + other.spread) - first


class WideDispersion(Dispersion):
    """A dispersion on a sensor that is wider than it needs.

    Args:
        displacement: one value per band, pixels.
        first: scene column on which snapshot column 0 lies.
        wider: columns that the snapshot is wider than the scene.
    """

    def __init__(self, displacement: tuple[float, ...], first: int, wider: int) -> None:
        super().__init__(displacement)
        object.__setattr__(self, "first", first)
        object.__setattr__(self, "wider", wider)

    @property
    def origin(self) -> int:
        """Scene column on which snapshot column 0 lies, pixels."""
        return int(self.first)  # type: ignore[attr-defined]

    @property
    def spread(self) -> int:
        """Columns that the snapshot is wider than the scene."""
        return int(self.wider)  # type: ignore[attr-defined]


class OnSensor(LinearOperator):
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
        from torch.nn.functional import pad

        return self.wide.A_adjoint(pad(snapshot, self.beside))


class DisplacedCamera(SpectralCamera):
    """A spectral camera whose light falls on, and beside, a sensor that was laid out for another dispersion."""

    beside: tuple[int, int]

    @property
    def snapshot_shape(self) -> tuple[int, int, int]:
        """(1, H, W')."""
        channels, rows, columns = super().snapshot_shape
        return (channels, rows, columns - sum(self.beside))

    def operator(self) -> LinearOperator:
        """See ``SpectralCamera``."""
        wide = super().operator()
        return wide if isinstance(wide, OnSensor) else OnSensor(wide, self.beside)

    def window(self, top: int, left: int, height: int, width: int) -> LinearOperator:
        """See ``CodedCamera``."""
        part = (top, left, height, width)
        if self.blurred:
            return self._slotwise(part, moving=False)
        return OnSensor(TapOperator(self._collapsed().taps.window(*part)), self.beside)

    def _slotwise(self, part: tuple[int, int, int, int] | None = None, *, moving: bool) -> LinearOperator:
        return OnSensor(super()._slotwise(part, moving=moving), self.beside)
