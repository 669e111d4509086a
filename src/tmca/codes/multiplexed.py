"""Aperture and shutter codes of one exposure, and what describes them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from inspect import signature
from typing import TYPE_CHECKING, Any

from torch import Tensor, nn

from tmca.arguments import Count, Float, Seed, Share, checked
from tmca.arguments import Size as Sides
from tmca.codes.arrays import Array
from tmca.codes.buckets import check_patterns, plane_patterns
from tmca.codes.plane import CodePlane, tile_of
from tmca.errors import SettingError, ShapeError

Size = tuple[int, int]


@checked
@dataclass(frozen=True)
class Codes:
    """What a camera with an aperture and a shutter shows, before its size is known.

    Args:
        aperture: family of the aperture codes (``tmca.codes.FAMILIES``) or patterns (K, H, Wa).
        shutter: family of the shutter codes or patterns (K, H, W'), with two buckets those of the first; or patterns
            (R, K, H, W') of all buckets, or ``"burst"``: R frames one after the other, all pixels alike.
        transmittance: share of open aperture pixels of a named family.
        duty: share of open shutter pixels of a named family.
        period: tile of both planes, pixels; full frame if None.
        seed: same seed, same codes; aperture and shutter draw from different streams.
        learnable: ``True``, ``False``, ``"aperture"`` or ``"shutter"``; patterns of all buckets are never learned.
        jitter: of the logits' distances from their threshold, see ``CodePlane``.

    Raises:
        SettingError: a value of another type, or outside its range.
    """

    aperture: str | Array = "random"
    shutter: str | Array = "random"
    transmittance: Share = 0.5
    duty: Share = 0.5
    period: Count | Sides | None = None
    seed: Seed = 0
    learnable: bool | str = False
    jitter: Float = 0.0

    def planes(self, slots: int, aperture: Size, shutter: Size, buckets: int = 1) -> MultiplexedCodes:
        """The codes of K slots on an aperture (H, Wa) and a sensor (H, W') of pixels with R buckets.

        Raises:
            SettingError, ShapeError: another ``learnable``, or what ``CodePlane`` refuses.
        """
        if self.learnable not in (True, False, "aperture", "shutter"):
            raise SettingError("learnable", repr(self.learnable), "True, False, 'aperture' or 'shutter'")
        how: dict[str, Any] = {"period": self.period, "jitter": self.jitter}
        collected, count = plane_patterns(self.shutter, slots, buckets, tile_of(self.period) or shutter)
        planes = (
            CodePlane(
                self.aperture, slots, aperture, density=self.transmittance, seed=2 * self.seed,
                learnable=self.learnable in (True, "aperture"), name="aperture", **how,
            ),
            CodePlane(
                collected, count, shutter, density=self.duty, seed=2 * self.seed + 1,
                learnable=self.learnable in (True, "shutter") and count == slots, name="shutter", **how,
            ),
        )  # fmt: skip
        return MultiplexedCodes(*planes)


class MultiplexedCodes(nn.Module):
    """K aperture patterns T^k and K shutter patterns S^k, shown slot by slot within one exposure (thesis eqs 4, 5).

    Args:
        aperture: (K, H, Wa).
        shutter: (K, H, W'), or (R·K, H, W') of R buckets after each other.
    """

    if TYPE_CHECKING:

        def __call__(self) -> tuple[Tensor, Tensor]: ...

    def __init__(self, aperture: CodePlane, shutter: CodePlane) -> None:
        super().__init__()
        self.aperture, self.shutter = aperture, shutter

    @property
    def slots(self) -> int:
        """K."""
        return self.aperture.slots

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


def fitted_codes(
    codes: Codes | nn.Module | None, slots: int, aperture: Size, shutter: Size, buckets: int = 1, /, **changes: Any
) -> nn.Module:
    """The codes of a camera: a module as it is, where it fits, or what a description says.

    Args:
        codes: a module that gives (aperture, shutter), a description, or None for the default one.
        slots: K.
        aperture, shutter: (H, W) of the planes.
        buckets: R of a pixel.
        changes: parts of the description that are replaced.

    Raises:
        SettingError: changes of codes that are there already, an unknown part, or a module that shows nothing.
        ShapeError: tiled codes of another number of slots; codes that do not repeat, of another size.
    """
    if not isinstance(codes, nn.Module):
        return replace(codes or Codes(), **changes).planes(slots, aperture, shutter, buckets)
    if changes:
        name, value = next(iter(changes.items()))
        raise SettingError(name, repr(value), "none beside codes", "leave it out, or leave codes out")
    if not isinstance(codes, MultiplexedCodes):
        _check_shows(codes)
        return codes
    if codes.slots != slots:
        raise ShapeError("codes", f"{codes.slots} slots", f"{slots}", "give slots too, or other codes")
    check_patterns(codes.shutter.slots, buckets, slots)
    sizes = (codes.aperture, aperture), (codes.shutter, shutter)
    if all(plane.size == size for plane, size in sizes):
        return codes
    return MultiplexedCodes(*(plane.resized(size) for plane, size in sizes))


def _check_shows(codes: nn.Module) -> None:
    """Raises SettingError for a module that shows nothing without an input."""
    try:
        signature(codes.forward).bind()
    except TypeError:
        found = f"a {type(codes).__name__}, which needs an input"
        raise SettingError("codes", found, "a module that gives (aperture, shutter)") from None
