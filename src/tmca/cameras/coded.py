"""What cameras with an aperture and a shutter have in common: one code per channel of the scene."""

from __future__ import annotations

import dataclasses
import json
from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import torch
from torch import Tensor, nn

from tmca.cameras.camera import Camera
from tmca.codes import Codes, MultiplexedCodes, fitted_codes
from tmca.codes.files import TILE, Axes, code_variables, json_attribute, tensors
from tmca.errors import SettingError
from tmca.operators import LinearOperator, TapOperator, Taps
from tmca.sensor import channel_weights

if TYPE_CHECKING:
    import xarray as xr

CODING = tuple(Codes.__dataclass_fields__)
"""Parts of the description of codes, which constructors also take one by one."""


class CodedCamera(Camera):
    """A camera whose light one code per channel of the scene stands for (thesis eqs 12, 20); it holds ``response``, the
    weight of every channel of the scene, and ``codes``."""

    response: Tensor
    codes: MultiplexedCodes
    drawn: ClassVar = {"transmittance": ("aperture",), "duty": ("shutter",), "seed": ("aperture", "shutter")}

    def _hold_codes(
        self, codes: Codes | nn.Module | None, aperture: tuple[int, int], shutter: tuple[int, int], /, **coding: Any
    ) -> None:
        self.codes = fitted_codes(codes, self.slots, aperture, shutter, **coding)  # type: ignore[assignment]
        described = codes if isinstance(codes, nn.Module) else dataclasses.replace(codes or Codes(), **coding)
        self._given = {n: part for n, part in self._given.items() if n not in CODING} | {"codes": described}

    @classmethod
    def _arguments(cls) -> tuple[str, ...]:
        return *(name for name in super()._arguments() if name != "coding"), *CODING

    def _described(self, parts: Mapping[str, Any]) -> dict[str, Any]:
        coding = parts.get("codes", self._given["codes"])
        planes = vars(coding) if isinstance(coding, Codes) else {"aperture": coding, "shutter": coding}
        return {**planes, **super()._described(parts)}

    def _shared(self, parts: set[str]) -> dict[str, Any]:
        """Codes of a named family are drawn anew where their description or their size changes."""
        coding = self._given["codes"]
        if not isinstance(coding, nn.Module):
            families = isinstance(coding.aperture, str) and isinstance(coding.shutter, str)
            whole_frame = families and coding.period is None
            if self.unbound or parts & {*CODING, "slots", *(("size",) if whole_frame else ())}:
                return super()._shared(parts)
        return {**super()._shared(parts), "codes": self.codes}

    def _hold_response(self, values: Any, where: str, shape: tuple[int, ...]) -> None:
        values = channel_weights(where, values, shape)
        if isinstance(values, nn.Parameter) and values.ndim == 1:
            self.response = values
        else:
            self.register_buffer("response", values.flatten())

    @property
    def channels(self) -> int:
        """Number of bands or views of the scene."""
        return len(self.response)

    @property
    def white(self) -> float:
        """The summed response."""
        return float(self.response.detach().sum())

    @abstractmethod
    def code_cube(self) -> Tensor:
        """The time-multiplexed code T̂ of every channel."""

    def throughput(self) -> float:
        """Mean of T̂ under equal exposure."""
        with torch.no_grad():
            return float(self.code_cube().mean()) / self.exposures

    def _check_no_depth(self, depth: Tensor | None) -> None:
        if depth is not None:
            raise SettingError("depth", "a depth map", f"none for a {self.kind} camera")

    def taps(self) -> Taps:
        """The collapsed code with the response folded in; SettingError for optics that keep the slots apart."""
        operator = self.operator()
        if not isinstance(operator, TapOperator):
            raise SettingError("relay_blur", "some", "none where one code stands for all slots")
        return operator.taps

    def window(self, top: int, left: int, height: int, width: int) -> LinearOperator:
        """The operator of scenes (B, channels, height, width), dark around, behind a part of the codes."""
        return TapOperator(self.taps().window(top, left, height, width))

    def moving_window(self, top: int, left: int, height: int, width: int) -> LinearOperator:
        """The operator of scenes (B, K, channels, height, width) that move, where the camera has it for a part."""
        raise SettingError("motion", "some", f"none behind a part of a {self.kind} camera")

    def _planes(self, tiled: bool, aperture: Axes, shutter: Axes) -> tuple[dict[str, Any], dict[str, Any]]:
        """Variables of both planes on these axes, and the attribute of their period."""
        planes, period = self.codes(), getattr(getattr(self.codes, "aperture", None), "period", None)
        if tiled and period is not None:
            planes, aperture, shutter = (self.codes.aperture.tile(), self.codes.shutter.tile()), TILE, TILE
        return code_variables(planes, aperture, shutter), {"period": json.dumps(period)}

    @classmethod
    def _settings(cls, dataset: xr.Dataset, where: str) -> dict[str, Any]:
        planes, period = tensors(dataset, "aperture", "shutter"), json_attribute(dataset.attrs, "period", None, where)
        return {**planes, "slots": len(planes["aperture"]), "period": None if period is None else tuple(period)}
