"""Point spread functions of a phase mask for every slot, depth and wavelength (thesis eq. 27)."""

from __future__ import annotations

from typing import Any, Protocol

import torch
from torch import Tensor, nn

from tmca.errors import SettingError, ShapeError
from tmca.optics.heights import HeightMaps
from tmca.optics.phase import mask_field

ENERGIES = ("unit", "aperture")


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
        if waves.ndim != 4 or tuple(waves.shape[2:]) != heights.size or waves.shape[1] != len(per_metre):
            wanted = f"(D, {len(per_metre)}, {heights.size[0]}, {heights.size[1]})"
            raise ShapeError("waves", str(tuple(waves.shape)), wanted)
        if energy not in ENERGIES:
            raise SettingError("energy", repr(energy), f"one of {', '.join(ENERGIES)}")
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
        found = self._pixels()
        if self.energy == "unit":
            return found / found.sum((-2, -1), keepdim=True).clamp_min(torch.finfo(found.dtype).tiny)
        return found / self._light()

    def arrived(self) -> Tensor:
        """(K, D, L) share of the light behind the aperture that arrives in the window."""
        return (self._pixels() / self._light()).sum((-2, -1))

    def _pixels(self) -> Tensor:
        """(K, D, L, h, w) light of every pixel."""
        found = point_spread(self.heights(), self.waves, self.per_metre, self.propagator)
        if self.oversampling == 1:
            return found
        flat = torch.nn.functional.avg_pool2d(found.flatten(0, 1), self.oversampling, divisor_override=1)
        return flat.unflatten(0, found.shape[:2])

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
    found: Tensor = _Spread.apply(heights, waves, per_metre, propagator)
    return found


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
        found = torch.zeros_like(heights)
        for slot, height in enumerate(heights):
            mask = mask_field(height, per_metre).to(waves.dtype)
            turned = torch.zeros(len(per_metre), *height.shape, dtype=heights.dtype, device=heights.device)
            for depth, wave in enumerate(waves):
                back = ctx.propagator.adjoint(2 * gradient[slot, depth] * seen[slot, depth])
                field = wave * mask
                turned += (field.real * back.imag - field.imag * back.real).to(heights.dtype)
            found[slot] = torch.tensordot(per_metre.to(heights.dtype), turned, 1)
        return found, None, None, None
