"""Point spread functions of a phase mask for every slot, depth and wavelength (thesis eq. 27), and what their
simulation cannot follow: light beyond the window, surfaces steeper than their pixels."""

from __future__ import annotations

from math import pi
from typing import Any, Protocol
from warnings import warn

import torch
from torch import Tensor, nn

from tmca.errors import check_choice, check_shape
from tmca.optics.heights import HeightMaps, RotationalProfile, ZernikeHeights
from tmca.optics.phase import mask_field
from tmca.optics.propagation import Undersampled
from tmca.optics.zernike import pupil_coordinates

ENERGIES = ("unit", "aperture")
STEEP = 0.01
"""Share of neighbouring mask pixels that may be more than half a wave apart: point spread functions are then off by up
to 0.04 of their light, and by 2 to 4 times the share beyond (against 256 pixels a side, Zernike masks of 50 to 500 nm
on both preset benches)."""


class Propagator(Protocol):
    """Light from the mask to the sensor: a linear map of fields (..., L, H, W)."""

    def __call__(self, field: Tensor) -> Tensor:
        """Fields on the sensor."""

    def adjoint(self, field: Tensor) -> Tensor:
        """The adjoint map."""


class PointSpread(nn.Module):
    """The PSF cube (K, D, L, h, w) of height maps, differentiable in the heights.

    Args:
        heights: K maps.
        waves: (D, L, H, W) complex, field of a point source at every depth just before the mask, times the aperture.
        per_metre: (L,) of ``radians_per_metre``.
        propagator: to the sensor.
        energy: ``"unit"``: every PSF sums to one; ``"aperture"``: to the share of the light that arrives in the window,
            of what passes the aperture.
        oversampling: samples of the propagator per side of a pixel; the light of a pixel is their sum.

    Raises:
        ShapeError: waves that do not fit the heights or the wavelengths.
        SettingError: unknown energy.
    """

    waves: Tensor
    per_metre: Tensor

    def __init__(
        self,
        heights: HeightMaps,
        waves: Tensor,
        per_metre: Tensor,
        propagator: Propagator,
        energy: str = "unit",
        oversampling: int = 1,
    ) -> None:
        super().__init__()
        check_shape("waves", waves, ("D", len(per_metre), *heights.size))
        check_choice("energy", energy, ENERGIES)
        self.heights, self.propagator, self.energy = heights, propagator, energy
        self.oversampling = oversampling
        self.register_buffer("waves", waves.to(torch.complex64), persistent=False)
        self.register_buffer("per_metre", per_metre, persistent=False)

    def behind(self, heights: nn.Module, waves: Tensor | None = None) -> PointSpread:
        """The same optics with other heights, of the same size, and, if given, other waves before them."""
        return PointSpread(
            heights, self.waves if waves is None else waves, self.per_metre, self.propagator, self.energy,  # type: ignore[arg-type]
            self.oversampling,
        )  # fmt: skip

    def forward(self) -> Tensor:
        """(K, D, L, h, w)."""
        light = self._pixels()
        if self.energy == "unit":
            return light / light.sum((-2, -1), keepdim=True).clamp_min(torch.finfo(light.dtype).tiny)
        return light / self._light()

    def arrived(self) -> Tensor:
        """(K, D, L) share of the light behind the aperture that arrives in the window."""
        return (self._pixels() / self._light()).sum((-2, -1))

    def _pixels(self) -> Tensor:
        """(K, D, L, h, w) light of every pixel."""
        samples = point_spread(self.heights(), self.waves, self.per_metre, self.propagator)
        if self.oversampling == 1:
            return samples
        flat = torch.nn.functional.avg_pool2d(samples.flatten(0, 1), self.oversampling, divisor_override=1)
        return flat.unflatten(0, samples.shape[:2])

    def _light(self) -> Tensor:
        """(D, L, 1, 1) light behind the aperture."""
        return self.waves.abs().square().sum((-2, -1), keepdim=True)


def point_spread(heights: Tensor, waves: Tensor, per_metre: Tensor, propagator: Propagator) -> Tensor:
    """Intensities (K, D, L, h, w) on the sensor of waves (D, L, H, W) through masks of heights (K, H, W).

    What has to be kept for the gradient are the fields on the sensor; all else is made again depth by depth.

    Args:
        heights: metres.
        waves: fields just before the mask.
        per_metre: (L,) radians per metre of height.
        propagator: to the sensor.
    """
    intensities: Tensor = _Spread.apply(heights, waves, per_metre, propagator)
    return intensities


class _Spread(torch.autograd.Function):
    """Fields forward, and their adjoint backward: two propagations a depth in all."""

    @staticmethod
    def forward(ctx: Any, heights: Tensor, waves: Tensor, per_metre: Tensor, propagator: Propagator) -> Tensor:
        fields = [
            torch.stack([propagator(wave * mask) for wave in waves])
            for mask in (mask_field(height, per_metre).to(waves.dtype) for height in heights)
        ]
        seen = torch.stack(fields)
        ctx.save_for_backward(heights, waves, per_metre, seen)
        ctx.propagator = propagator
        return seen.real.square() + seen.imag.square()

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None, None]:
        (gradient,) = gradients
        heights, waves, per_metre, seen = ctx.saved_tensors
        slopes = torch.zeros_like(heights)
        for slot, height in enumerate(heights):
            mask = mask_field(height, per_metre).to(waves.dtype)
            turned = torch.zeros(len(per_metre), *height.shape, dtype=heights.dtype, device=heights.device)
            for depth, wave in enumerate(waves):
                back = ctx.propagator.adjoint(2 * gradient[slot, depth] * seen[slot, depth])
                field = wave * mask
                turned += (field.real * back.imag - field.imag * back.real).to(heights.dtype)
            slopes[slot] = torch.tensordot(per_metre.to(heights.dtype), turned, 1)
        return slopes, None, None, None


class StrayLight(UserWarning):
    """A window that holds too little of a point's light."""


def check_mask(spread: PointSpread) -> None:
    """Warns of what ``stray_light`` and ``steep_share`` find.

    Warns:
        StrayLight: light beyond the window.
        Undersampled: a surface steeper than its pixels.
    """
    stray_light(spread, stacklevel=3)
    share = steep_share(spread.heights, spread.per_metre)
    if share > STEEP:
        pixels = max(spread.heights.size)
        warn(
            f"mask: {share:.1%} of {pixels}×{pixels} pixels are more than half a wave from the next one, {STEEP:.0%} "
            "is allowed: their light folds back into the window; take more mask pixels, or a smoother mask",
            Undersampled,
            stacklevel=2,
        )


@torch.no_grad()
def steep_share(heights: HeightMaps, per_metre: Tensor) -> float:
    """Share of neighbouring pixels in the aperture that differ by more than half a wave of the shortest wavelength.

    Of smooth surfaces only: a free-form map is what its pixels are, and what it sends where is exact.

    Args:
        heights: K maps.
        per_metre: (L,) of ``radians_per_metre``.
    """
    if not isinstance(heights, ZernikeHeights | RotationalProfile):
        return 0.0
    phase = heights() * per_metre.abs().max()
    inside = pupil_coordinates(heights.size)[0].to(phase.device) <= 1
    rows = phase.diff(dim=1)[:, inside[1:] & inside[:-1]]
    columns = phase.diff(dim=2)[:, inside[:, 1:] & inside[:, :-1]]
    return float((torch.cat((rows, columns), 1).abs() > pi).double().mean())


def stray_light(spread: PointSpread, stacklevel: int = 2) -> Tensor:
    """(K, D, L) share of the light behind the aperture that misses the window; it is lost with ``energy="aperture"``.

    Warns:
        StrayLight: more than a tenth, of any slot, depth and wavelength.
    """
    with torch.no_grad():
        missed = 1 - spread.arrived()
    if float(missed.max()) > 0.1:
        lost = f"the window misses up to {float(missed.max()):.0%} of a point's light"
        warn(f"{lost}; take a larger one, or a mask of coarser structures", StrayLight, stacklevel=stacklevel + 1)
    return missed
