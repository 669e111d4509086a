"""Aperture and shutter codes of one exposure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from torch import Tensor, nn

from tmca.codes.plane import CodePlane
from tmca.errors import SettingError


class MultiplexedCodes(nn.Module):
    """K aperture patterns T^k and K shutter patterns S^k, shown slot by slot within one exposure (thesis eqs 4, 5).

    Args:
        slots: number of time slots K.
        aperture_size: (H, Wa) of the aperture, pixels.
        shutter_size: (H, W') of the sensor, pixels.
        aperture: ``"random"``, ``"static"``, ``"open"``, ``"one-hot"``, ``"complementary"``, ``"blue-noise"``
            or patterns (K, H, Wa).
        shutter: the same choices, patterns (K, H, W').
        transmittance: share of open aperture pixels in the families that leave it free.
        duty: share of open shutter pixels, likewise.
        period: tile of both planes, pixels; full frame if None.
        seed: same seed, same codes; aperture and shutter draw from different streams.
        learnable: ``True``, ``False``, ``"aperture"`` or ``"shutter"``.
        slope: of the surrogate derivative.
        spread: of the logits' distances from their threshold, see ``CodePlane``.

    Raises:
        SettingError: another ``learnable``, or what ``CodePlane`` refuses.
    """

    if TYPE_CHECKING:

        def __call__(self) -> tuple[Tensor, Tensor]: ...

    def __init__(
        self,
        slots: int,
        aperture_size: tuple[int, int],
        shutter_size: tuple[int, int],
        *,
        aperture: str | Tensor = "random",
        shutter: str | Tensor = "random",
        transmittance: float = 0.5,
        duty: float = 0.5,
        period: int | tuple[int, int] | None = None,
        seed: int = 0,
        learnable: bool | str = False,
        slope: float = 4.0,
        spread: float = 0.0,
    ) -> None:
        super().__init__()
        if learnable not in (True, False, "aperture", "shutter"):
            raise SettingError("learnable", repr(learnable), "True, False, 'aperture' or 'shutter'")
        self.slots = slots
        self.aperture = CodePlane(
            aperture, slots, aperture_size, period=period, density=transmittance, seed=2 * seed,
            learnable=learnable in (True, "aperture"), slope=slope, spread=spread, name="aperture",
        )  # fmt: skip
        self.shutter = CodePlane(
            shutter, slots, shutter_size, period=period, density=duty, seed=2 * seed + 1,
            learnable=learnable in (True, "shutter"), slope=slope, spread=spread, name="shutter",
        )  # fmt: skip

    def forward(self) -> tuple[Tensor, Tensor]:
        """(aperture (K, H, Wa), shutter (K, H, W')), all zeros and ones."""
        return self.aperture(), self.shutter()

    @property
    def learnable(self) -> bool:
        """Whether either plane is learned."""
        return self.aperture.learnable or self.shutter.learnable

    def anneal(self, slope: float) -> None:
        """Set the slope of the surrogate derivative of both planes."""
        self.aperture.slope = self.shutter.slope = float(slope)

    def relax(self, relaxed: bool) -> None:
        """Show the smooth stand-in of both planes, grey between 0 and 1, or their binary patterns again."""
        self.aperture.relaxed = self.shutter.relaxed = relaxed

    def transmittance(self) -> float:
        """Share of open aperture pixels over all slots."""
        return float(self.aperture().mean())

    def duty(self) -> float:
        """Share of the exposure in which a sensor pixel is open, mean over pixels."""
        return float(self.shutter().mean())
