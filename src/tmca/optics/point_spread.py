"""From the mask to the sensor: propagation of light, point spread functions of a phase mask for every slot, depth and
wavelength (thesis eqs 26, 27), and what their simulation cannot follow: light beyond the window, surfaces steeper than
their pixels."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from typing import Any
from warnings import warn

import numpy as np
import torch
from torch import Tensor, nn

from tmca.errors import check_choice, check_range, check_shape
from tmca.optics.heights import HeightMaps, RotationalProfile, ZernikeHeights
from tmca.optics.phase import mask_field, pixel_places
from tmca.optics.zernike import pupil_coordinates

ENERGIES = ("unit", "aperture")
STEEP = 0.01
"""Share of neighbouring mask pixels that may be more than half a wave apart: point spread functions are then off by up
to 0.04 of their light, and by 2 to 4 times the share beyond (against 256 pixels a side, Zernike masks of 50 to 500 nm
on both preset benches)."""
LEAST_KEPT = 16
"""Frequencies along a side that ``AngularSpectrum`` needs: with fewer the light behind a round aperture is off by more
than a twentieth (against ``FocalPlane``, grids of 64 to 128 pixels, padding 2)."""


class Undersampled(UserWarning):
    """A field whose phase turns faster than its pixels can follow."""


class AngularSpectrum(nn.Module):
    """Free space by its transfer function (eq. 26), band-limited, on a padded grid; exact, evanescent waves left out.

    Frequencies that the padded grid would fold back are cut: ``|f| ≤ 1 / (λ √((2 s Δf)² + 1))``. Source: Matsushima and
    Shimobaba, Opt. Express 17, 19662 (2009).

    Args:
        size: (H, W) of the fields, pixels.
        pitch: metres.
        wavelengths: (L,) metres.
        distance: s, metres; negative goes back.
        padding: sides of the padded grid over those of the field, ≥ 1.

    Raises:
        SettingError: impossible numbers.

    Warns:
        Undersampled: fewer than ``LEAST_KEPT`` frequencies along a side are left, or some are cut that would arrive.
    """

    transfer: Tensor

    def __init__(
        self, size: tuple[int, int], pitch: float, wavelengths: Sequence[float], distance: float, padding: float = 2.0
    ) -> None:
        super().__init__()
        check_range("pitch", pitch, above=0, unit="m")
        check_range("distance", distance, unit="m")
        check_range("padding", padding, 1)
        check_range("wavelengths", min(wavelengths), above=0, unit="m")
        self.size = (int(size[0]), int(size[1]))
        self.padded = (round(self.size[0] * padding), round(self.size[1] * padding))
        fy, fx = (torch.fft.fftfreq(n, pitch, dtype=torch.float64) for n in self.padded)
        waves = torch.as_tensor(wavelengths, dtype=torch.float64)[:, None, None]
        sine = waves**2 * (fy[:, None] ** 2 + fx**2)
        cosine = torch.sqrt((1 - sine).clamp(min=0))
        phase = -2 * pi * distance / waves * sine / (1 + cosine)  # without that of the axis
        highest = [1 / (waves * ((2 * distance / (n * pitch)) ** 2 + 1) ** 0.5) for n in self.padded]
        passed = (fy[:, None].abs() <= highest[0]) & (fx.abs() <= highest[1]) & (sine < 1)
        self.register_buffer("transfer", torch.polar(passed.double(), phase).to(torch.complex64), persistent=False)
        self._check_left(highest, pitch, max(wavelengths), distance)

    def _check_left(self, highest: Sequence[Tensor], pitch: float, longest: float, distance: float) -> None:
        """Warns ``Undersampled`` along a side where the highest frequencies that pass leave too few."""
        for padded, side, limit in zip(self.padded, self.size, highest, strict=True):
            left = 2 * float(limit.min()) * padded * pitch
            if left < padded and (left < LEAST_KEPT or padded < 2 * side):
                warn(
                    f"angular spectrum: {left:.0f} of {padded} frequencies follow {longest * 1e9:.0f} nm over "
                    f"{abs(distance):.4g} m, {LEAST_KEPT} and a padding of 2 are needed; take more padding, or "
                    "FocalPlane",
                    Undersampled,
                    stacklevel=3,
                )
                break

    def forward(self, field: Tensor) -> Tensor:
        """Fields (..., L, H, W) at the distance.

        Raises:
            ShapeError: fields of another size or number of wavelengths.
        """
        check_shape("field", field, (..., len(self.transfer), *self.size))
        return self._filtered(field, self.transfer)

    def adjoint(self, field: Tensor) -> Tensor:
        """The adjoint of ``forward``."""
        return self._filtered(field, self.transfer.conj())

    def _filtered(self, field: Tensor, transfer: Tensor) -> Tensor:
        """Rows that are zero are not transformed, rows that are cut are not brought back."""
        (rows, columns), (height, width) = self.padded, self.size
        spectrum = torch.fft.fft(torch.fft.fft(field, columns), rows, dim=-2)
        arrived = torch.fft.ifft(spectrum * transfer.to(spectrum.dtype), dim=-2)[..., :height, :]
        return torch.fft.ifft(arrived)[..., :width]


class FocalPlane(nn.Module):
    """One Fresnel step to any sampling of the sensor, by two matrix products: exact sums, no padding.

    ``U(x) ∝ ∫ U(x') exp(iπ x'²/(λ s)) exp(-2πi x x'/(λ s)) dx'``; without the chirp, the pupil form: a lens of focal
    length s takes it away, as on a 4f bench with a mirror in the pupil. Source: Soummer et al., Opt. Express 15, 15935
    (2007).

    Args:
        size: (H, W) of the fields, pixels.
        pitch: of the mask's pixels, metres.
        wavelengths: (L,) metres.
        distance: s, metres, or the focal length.
        out_size: (h, w) of the sensor, pixels.
        out_pitch: metres.
        chirp: whether light travels freely; False for the pupil form.
        samples: per side of a sensor pixel, at the nodes of Gauss–Legendre quadrature: the sum of their intensities is
            the light on the pixel's area.

    Raises:
        SettingError: impossible numbers.
    """

    rows: Tensor
    columns: Tensor

    def __init__(
        self,
        size: tuple[int, int],
        pitch: float,
        wavelengths: Sequence[float],
        distance: float,
        out_size: tuple[int, int],
        out_pitch: float,
        *,
        chirp: bool = True,
        samples: int = 1,
    ) -> None:
        super().__init__()
        check_range("distance", distance, above=0, unit="m")
        check_range("samples", samples, 1)
        check_range("wavelengths", min(wavelengths), above=0, unit="m")
        self.size, self.out_size = (int(size[0]), int(size[1])), (int(out_size[0]), int(out_size[1]))
        nodes, weights = (torch.from_numpy(part) for part in np.polynomial.legendre.leggauss(samples))
        waves = torch.as_tensor(wavelengths, dtype=torch.float64)[:, None, None]
        places, seen = pixel_places(self.size, pitch), pixel_places(self.out_size, out_pitch)
        for axis, name in enumerate(("rows", "columns")):
            here, there = places[axis].flatten(), (seen[axis].reshape(-1, 1) + out_pitch / 2 * nodes).flatten()
            phase = -2 * pi * there[:, None] * here / (waves * distance)
            if chirp:
                phase = phase + pi * here**2 / (waves * distance)
            share = (weights / 2).repeat(self.out_size[axis])[:, None]
            scale = (pitch * out_pitch * share / (waves * distance)) ** 0.5
            matrix = torch.polar(scale.expand_as(phase).clone(), phase)
            self.register_buffer(name, matrix.to(torch.complex64), persistent=False)

    def forward(self, field: Tensor) -> Tensor:
        """(..., L, h·samples, w·samples) fields on the sensor of fields (..., L, H, W) at the mask.

        Raises:
            ShapeError: fields of another size.
        """
        check_shape("field", field, (..., len(self.rows), *self.size))
        return self.rows.to(field.dtype) @ field @ self.columns.to(field.dtype).mT

    def adjoint(self, field: Tensor) -> Tensor:
        """The adjoint of ``forward``: (..., L, H, W) of (..., L, h, w)."""
        return self.rows.to(field.dtype).mH @ field @ self.columns.to(field.dtype).conj()


Propagator = AngularSpectrum | FocalPlane
"""Light from the mask to the sensor: a linear map of fields (..., L, H, W), with its ``adjoint``."""


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
        flat = torch.nn.functional.avg_pool2d(samples.flatten(0, 1), self.oversampling, divisor_override=1)
        return flat.unflatten(0, samples.shape[:2])

    def _light(self) -> Tensor:
        """(D, L, 1, 1) light behind the aperture."""
        return self.waves.abs().square().sum((-2, -1), keepdim=True)


def point_spread(heights: Tensor, waves: Tensor, per_metre: Tensor, propagator: Propagator) -> Tensor:
    """Intensities (K, D, L, h, w) on the sensor of waves (D, L, H, W) through masks of heights (K, H, W).

    What has to be kept for the gradient are the fields on the sensor; all else is made again depth by depth. Heights in
    metres, ``per_metre`` (L,) of ``radians_per_metre``, the waves just before the mask.
    """
    return _Spread.apply(heights, waves, per_metre, propagator)


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
    """Warn of what ``stray_light`` and ``steep_share`` find.

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

    Of smooth surfaces only: a free-form map is what its pixels are, and what it sends where is exact. Takes K maps
    and the (L,) of ``radians_per_metre``.
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
