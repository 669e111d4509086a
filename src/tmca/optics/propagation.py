"""Propagation of light from the mask to the sensor (thesis eqs 26, 27)."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from warnings import warn

import numpy as np
import torch
from torch import Tensor, nn

from tmca.errors import check_range, check_shape
from tmca.optics.phase import pixel_places

LEAST_KEPT = 16
"""Frequencies along a side that ``AngularSpectrum`` needs: with fewer the light behind a round aperture is off by more
than a twentieth (against ``FocalPlane``, grids of 64 to 128 pixels, padding 2)."""


class Undersampled(UserWarning):
    """A field whose phase turns faster than its pixels can follow."""


def check_sampling(pitch: float, wavelengths: Sequence[float], radius: float, distance: float, where: str) -> None:
    """Warns ``Undersampled`` where light of a cone is sampled less than twice per wave at its rim.

    The largest pitch is ``λ √(r² + s²) / 2r`` at the shortest wavelength.

    Args:
        pitch: metres.
        wavelengths: metres.
        radius: of the aperture, metres.
        distance: from the aperture to the tip of the cone, metres.
        where: what the warning is about.
    """
    shortest = min(wavelengths)
    bound = shortest * (radius**2 + distance**2) ** 0.5 / (2 * radius)
    if pitch > bound * (1 + 1e-9):
        warn(
            f"{where}: a pitch of {pitch * 1e6:.3g} µm is larger than {bound * 1e6:.3g} µm, the most that a cone of "
            f"radius {radius * 1e3:.3g} mm over {distance * 1e3:.3g} mm allows at {shortest * 1e9:.0f} nm; "
            "take a finer pitch, a smaller aperture or a longer distance",
            Undersampled,
            stacklevel=3,
        )


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
        self.pitch, self.wavelengths, self.distance = float(pitch), tuple(map(float, wavelengths)), float(distance)
        self.register_buffer("transfer", self._transfer().to(torch.complex64), persistent=False)
        self._check_band()

    def _check_band(self) -> None:
        """Light that turns more than the padded grid can follow is cut: most of it beyond a distance."""
        wave = max(self.wavelengths)
        for padded, side in zip(self.padded, self.size, strict=True):
            passed = 2 * self._limit(torch.tensor(wave), padded).item() * padded * self.pitch
            if passed < padded and (passed < LEAST_KEPT or padded < 2 * side):
                warn(
                    f"angular spectrum: {passed:.0f} of {padded} frequencies follow {wave * 1e9:.0f} nm over "
                    f"{abs(self.distance):.4g} m, {LEAST_KEPT} and a padding of 2 are needed; take more padding, or "
                    "FocalPlane",
                    Undersampled,
                    stacklevel=3,
                )
                return

    def _limit(self, waves: Tensor, padded: int) -> Tensor:
        """Highest frequency that a padded side follows, 1/m."""
        return 1 / (waves * ((2 * self.distance / (padded * self.pitch)) ** 2 + 1) ** 0.5)

    def _transfer(self) -> Tensor:
        """(L, H', W'), without the phase of the axis."""
        fy, fx = (torch.fft.fftfreq(n, self.pitch, dtype=torch.float64) for n in self.padded)
        waves = torch.tensor(self.wavelengths, dtype=torch.float64)[:, None, None]
        sine = waves**2 * (fy[:, None] ** 2 + fx**2)
        cosine = torch.sqrt((1 - sine).clamp(min=0))
        phase = -2 * pi * self.distance / waves * sine / (1 + cosine)
        limits = [self._limit(waves, n) for n in self.padded]
        passed = (fy[:, None].abs() <= limits[0]) & (fx.abs() <= limits[1]) & (sine < 1)
        return torch.polar(passed.double(), phase)

    def forward(self, field: Tensor) -> Tensor:
        """Fields (..., L, H, W) at the distance.

        Raises:
            ShapeError: fields of another size or number of wavelengths.
        """
        check_shape("field", field, (..., len(self.wavelengths), *self.size))
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
        waves = torch.tensor(list(map(float, wavelengths)), dtype=torch.float64)[:, None, None]
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
