"""What every camera with a time-multiplexed coded aperture has: codes, one operator for all slots, light, a sensor."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from tmca.cameras.camera import Camera
from tmca.codes import MultiplexedCodes
from tmca.errors import SettingError
from tmca.operators import LinearOperator, TapOperator, Taps
from tmca.sensor import Sensor


class CodedCamera(Camera):
    """Scene → optics of slot k → shutter of slot k → mean over slots → sensor (thesis eqs 4, 5).

    Subclasses hold ``response``, the weight of every channel of the scene, and ``codes`` (aperture, shutter), and
    define ``code_cube``, ``scene_shape``, ``snapshot_shape`` and ``_collapsed``.

    Args:
        size: (H, W) of the scene, pixels.
        slots: number of time slots K.
        exposure: ``"equal"`` or ``"per-slot"``.
        sensor: ideal if None.
    """

    response: Tensor
    codes: MultiplexedCodes

    def __init__(self, size: tuple[int, int], slots: int, exposure: str, sensor: Sensor | None) -> None:
        super().__init__(size, slots, exposure, sensor)
        self._fixed: tuple[tuple[object, ...], TapOperator] | None = None

    @property
    def scene_shape(self) -> tuple[int, ...]:
        """Of a scene, without the batch."""
        raise TypeError(f"{type(self).__name__} defines no scene_shape")

    @property
    def channels(self) -> int:
        """Number of bands or views of the scene."""
        return len(self.response)

    @property
    def channel_names(self) -> list[str]:
        """What each channel is, in a few words."""
        raise TypeError(f"{type(self).__name__} defines no channel_names")

    def code_cube(self) -> Tensor:
        """The time-multiplexed code T̂ of every channel."""
        raise TypeError(f"{type(self).__name__} defines no code_cube")

    def throughput(self) -> float:
        """Light throughput: share of a white scene's light that is recorded, mean of T̂ under equal exposure."""
        with torch.no_grad():
            share = self.code_cube().mean()
        return float(share) / (self.slots if self.exposure == "per-slot" else 1)

    @property
    def white(self) -> float:
        """The summed response."""
        return float(self.response.detach().sum())

    def operator(self) -> LinearOperator:
        """The linear part with the present codes, on scenes (B, channels, H, W)."""
        if self.codes.learnable or self.response.requires_grad:
            return self._collapsed()
        versions = (self.exposure, *self._geometry(), *((t.data_ptr(), t._version) for t in self._tensors()))
        if self._fixed is None or self._fixed[0] != versions:
            self._fixed = (versions, self._collapsed())
        return self._fixed[1]

    def taps(self) -> Taps:
        """The collapsed code with the response folded in.

        Raises:
            SettingError: optics that keep the slots apart.
        """
        operator = self.operator()
        if not isinstance(operator, TapOperator):
            raise SettingError("relay blur", "some", "none where one code stands for all slots")
        return operator.taps

    def window(self, top: int, left: int, height: int, width: int) -> LinearOperator:
        """The operator of scenes (B, channels, height, width), dark around, behind a part of the codes."""
        return TapOperator(self.taps().window(top, left, height, width))

    def moving_window(self, top: int, left: int, height: int, width: int) -> LinearOperator:
        """The operator of scenes (B, K, channels, height, width) that move, behind a part of the codes.

        Raises:
            SettingError: a camera that images moving scenes as a whole only.
        """
        raise SettingError("motion", "some", f"none behind a part of a {self.kind} camera")

    def _geometry(self) -> tuple[object, ...]:
        """What else the operator depends on."""
        return ()

    def _tensors(self) -> list[Tensor]:
        own = (*self.buffers(recurse=False), *self.parameters(recurse=False))
        return [*self.codes.state_dict(keep_vars=True).values(), *own]

    def _collapsed(self) -> TapOperator:
        raise TypeError(f"{type(self).__name__} defines no _collapsed")

    def _apply(self, fn: Any, recurse: bool = True) -> CodedCamera:
        self._fixed = None
        return super()._apply(fn, recurse)
