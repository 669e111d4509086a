"""Cameras with a coded aperture and a coded shutter: their slots collapse into one code cube."""

from __future__ import annotations

import dataclasses
from abc import abstractmethod
from typing import Any, Self

import torch
from torch import Tensor, nn

from tmca.cameras.camera import Camera
from tmca.codes import Codes, MultiplexedCodes, fitted_codes
from tmca.errors import SettingError
from tmca.operators import LinearOperator, TapOperator, Taps

CODING = tuple(Codes.__dataclass_fields__)
"""Parts of the description of codes, which constructors also take one by one."""


class CodedCamera(Camera):
    """A camera whose light one code per channel of the scene stands for (thesis eqs 12, 20).

    Subclasses hold ``response``, the weight of every channel of the scene, and ``codes``, made by ``_hold_codes``, and
    define ``code_cube``.
    """

    response: Tensor
    codes: MultiplexedCodes
    coding: Codes | None
    """The description that the codes were made from; None where they were given as a module."""

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

    @abstractmethod
    def build_operator(self, depth: Tensor | None = None) -> LinearOperator:
        """The linear part with the present codes."""

    def throughput(self) -> float:
        """Light throughput: share of a white scene's light that is recorded, mean of T̂ under equal exposure."""
        with torch.no_grad():
            return float(self.code_cube().mean()) / self.exposures

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

    def replace(self, **parts: Any) -> Self:
        """See ``Camera``; codes of a named family are drawn anew where their description or their size changes."""
        described = "codes" not in parts and self.coding is not None
        resized = "size" in parts and described and _whole_frame(self.coding)
        if described and (resized or {*CODING, "slots"} & set(parts)):
            parts["codes"] = self.coding
        made = super().replace(**parts)
        made.coding = self.coding if made.codes is self.codes else made.coding
        return made

    def _hold_codes(
        self, codes: Codes | nn.Module | None, aperture: tuple[int, int], shutter: tuple[int, int], /, **coding: Any
    ) -> None:
        held: Any = fitted_codes(codes, self.slots, aperture, shutter, **coding)
        self.codes = held
        self.coding = None if isinstance(codes, nn.Module) else dataclasses.replace(codes or Codes(), **coding)

    def _codes_argument(self) -> Codes | nn.Module:
        return self.coding if self.unbound and self.coding is not None else self.codes

    def _more_arguments(self) -> tuple[str, ...]:
        return CODING


def _whole_frame(coding: Codes | None) -> bool:
    """Whether codes are drawn for the whole frame, so that another size needs others."""
    families = coding is not None and isinstance(coding.aperture, str) and isinstance(coding.shutter, str)
    return families and coding is not None and coding.period is None
