"""Phase masks: refractive indices of their materials, and what a height does to light (thesis eqs 22 to 25)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, pi
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.errors import DataError, SettingError, check_range
from tmca.yaml_files import read_yaml

Values = NDArray[np.float64]


def _rational(micrometres: Values, c: Values, power: int) -> Values:
    """n² - 1 = c₀ + Σ B λ² / (λ² - C^power)."""
    square = micrometres[:, None] ** 2
    return np.sqrt(1 + c[0] + (c[1::2] * square / (square - c[2::2] ** power)).sum(1))


def _powers(micrometres: Values, c: Values) -> Values:
    """c₀ + Σ B λ^C."""
    return c[0] + (c[1::2] * micrometres[:, None] ** c[2::2]).sum(1)


FORMULAS: dict[str, Callable[[Values, Values], Values]] = {
    "formula 1": lambda waves, c: _rational(waves, c, 2),  # Sellmeier's
    "formula 2": lambda waves, c: _rational(waves, c, 1),
    "formula 3": lambda waves, c: np.sqrt(_powers(waves, c)),
    "formula 5": _powers,  # Cauchy's
    "tabulated": lambda waves, c: np.interp(waves, c[0::2], c[1::2]),
}
"""Names of refractiveindex.info's database, whose files ``Material.read`` takes; wavelengths in micrometres."""


@dataclass(frozen=True)
class Material:
    """A transparent material in air.

    Args:
        name: what errors say.
        formula: name in ``FORMULAS``.
        coefficients: of the formula.
        limits: shortest and longest wavelength of the data, metres.
        source: where the data are from.
    """

    name: str
    formula: str
    coefficients: tuple[float, ...]
    limits: tuple[float, float]
    source: str = ""

    def index(self, wavelengths: Sequence[float]) -> Values:
        """Refractive index n at wavelengths (L,) in metres.

        Raises:
            SettingError: a wavelength outside the material's data.
        """
        values = np.atleast_1d(np.asarray(wavelengths, dtype=np.float64))
        low, high = self.limits
        outside = values[~((values >= low * (1 - 1e-9)) & (values <= high * (1 + 1e-9)))]
        if outside.size:
            limits = f"{low * 1e9:.4g} to {high * 1e9:.4g} nm, its data"
            remedy = "choose other bands or another material"
            raise SettingError("material", f"{self.name} at {outside[0] * 1e9:.4g} nm", limits, remedy)
        with np.errstate(all="ignore"):
            index = FORMULAS[self.formula](values * 1e6, np.asarray(self.coefficients))
        if not ((index > 0) & (index < 100)).all():
            found = f"{self.name} with a refractive index of {index.max():.3g}"
            raise SettingError("material", found, "a positive number below 100", "correct its coefficients")
        return index

    @classmethod
    def named(cls, name: str) -> Material:
        """One of ``MATERIALS``, or that of a file (``.yml``), see ``read``.

        Raises:
            SettingError: an unknown name.
        """
        if Path(name).suffix in (".yml", ".yaml"):
            return cls.read(name)
        if name not in MATERIALS:
            raise SettingError("material", repr(name), f"one of {', '.join(MATERIALS)}, or a .yml file")
        return MATERIALS[name]

    @classmethod
    def read(cls, path: str | Path) -> Material:
        """A material from a file of refractiveindex.info's database.

        Raises:
            DataError: no such file, or none of the known formulas in it.
        """
        described = read_yaml(path, "a .yml file of refractiveindex.info")
        try:
            formula, coefficients, limits = _described(described["DATA"][0])
            if not (0 < limits[0] < limits[1] < inf and len(coefficients) % 2 == (formula != "tabulated")):
                raise ValueError(f"limits {limits} and {len(coefficients)} coefficients")
            if not np.isfinite(coefficients).all():
                raise ValueError("coefficients that are not finite")
            return cls(Path(path).name, formula, coefficients, limits, source=str(path))
        except (KeyError, IndexError, TypeError, ValueError) as error:
            wanted = f"a .yml file of refractiveindex.info, of {', '.join(FORMULAS)}"
            raise DataError(path, f"no material ({error!r:.200})", wanted) from None


def _described(data: Mapping[str, Any]) -> tuple[str, tuple[float, ...], tuple[float, float]]:
    """Formula, coefficients and limits of an entry of a file."""
    kind = str(data["type"])
    if kind.startswith("tabulated n"):
        rows = [line.split() for line in str(data["data"]).splitlines() if line.strip()]
        pairs = sorted((float(row[0]), float(row[1])) for row in rows)
        flat = tuple(value for pair in pairs for value in pair)
        return "tabulated", flat, (pairs[0][0] * 1e-6, pairs[-1][0] * 1e-6)
    if kind not in FORMULAS:
        raise ValueError(kind)
    low, high = (float(value) * 1e-6 for value in str(data["wavelength_range"]).split())
    coefficients = tuple(float(value) for value in str(data["coefficients"]).split())
    return kind, coefficients, (low, high)


MATERIALS: dict[str, Material] = {
    material.name: material
    for material in (
        Material(
            "fused-silica", "formula 1", (0, 0.6961663, 0.0684043, 0.4079426, 0.1162414, 0.8974794, 9.896161),
            (0.21e-6, 6.7e-6), "Malitson, J. Opt. Soc. Am. 55, 1205 (1965)",
        ),
        Material(
            "N-BK7", "formula 2",
            (0, 1.03961212, 0.00600069867, 0.231792344, 0.0200179144, 1.01046945, 103.560653),
            (0.3e-6, 2.5e-6), "SCHOTT data sheet",
        ),
        Material(
            "N-SF11", "formula 2",
            (0, 1.73759695, 0.013188707, 0.313747346, 0.0623068142, 1.89878101, 155.23629),
            (0.37e-6, 2.5e-6), "SCHOTT data sheet",
        ),
        Material(
            "PMMA", "formula 3",
            (2.1778, 6.1209e-3, 2, -1.5004e-3, 4, 2.3678e-2, -2, -4.2137e-3, -4, 7.3417e-4, -6, -4.5042e-5, -8),
            (0.42e-6, 1.62e-6), "Beadie et al., Appl. Opt. 54, F139 (2015)",
        ),
        Material(
            "NOA61", "formula 5", (1.5375, 0.00829045, -2, -0.000211046, -4),
            (0.45e-6, 1.55e-6), "Norland Optical Adhesive 61 data sheet",
        ),
        Material(
            "SU-8", "formula 5", (1.566, 0.00796, -2, 0.00014, -4), (0.32e-6, 0.8e-6),
            "MicroChem SU-8 2000 data sheet, uncured",
        ),
    )
}  # fmt: skip
"""By name."""


def radians_per_metre(wavelengths: Sequence[float], material: Material | None) -> Tensor:
    """(L,) phase of a metre of height, float64: ``2π Δn/λ`` through a material in air (eq. 24), ``2π 2/λ`` on a mirror.

    Args:
        wavelengths: metres.
        material: None for a mirror in reflection.

    Raises:
        SettingError: a wavelength that is not positive, or outside the material's data.
    """
    values = torch.as_tensor(wavelengths, dtype=torch.float64)
    check_range("wavelengths", float(values.min()), above=0, unit="m")
    path = torch.full_like(values, 2.0) if material is None else torch.from_numpy(material.index(wavelengths)) - 1
    return 2 * pi * path / values


def mask_field(heights: Tensor, per_metre: Tensor) -> Tensor:
    """``b = exp(iφ)`` of heights (..., H, W) in metres at every wavelength (..., L, H, W), complex (eq. 23).

    ``per_metre`` (L,) is that of ``radians_per_metre``.
    """
    phase = heights[..., None, :, :] * per_metre.to(heights)[:, None, None]
    return torch.polar(torch.ones_like(phase), phase)


def pixel_places(size: tuple[int, int], pitch: float) -> tuple[Tensor, Tensor]:
    """(y (H, 1), x (1, W)) of pixels around the middle, metres, float64."""
    check_range("pitch", pitch, above=0, unit="m")
    y, x = (pitch * (torch.arange(n, dtype=torch.float64) - (n - 1) / 2) for n in size)
    return y[:, None], x[None]


def circular_aperture(size: tuple[int, int]) -> Tensor:
    """(H, W) share of every pixel inside the circle in the map, float64; the rim is smooth over about a pixel."""
    return (min(size) / 2 - torch.hypot(*pixel_places(size, 1.0)) + 0.5).clamp(0, 1)


def spherical_wave(
    size: tuple[int, int], pitch: float, wavelengths: Sequence[float], distance: float, focus: float | None = None
) -> Tensor:
    """Field of a point source on the axis (L, H, W), complex128 (eq. 22), without the phase of its middle.

    Args:
        size: (H, W) pixels.
        pitch: of the pixels, metres.
        wavelengths: (L,) metres.
        distance: z of the source before the mask, metres; ``inf`` for a plane wave.
        focus: distance z that a lens in the mask's plane brings to a focus: its phase is taken away; none if None.

    Raises:
        SettingError: distances that are not positive.
    """
    y, x = pixel_places(size, pitch)
    path = _sag(y**2 + x**2, "distance", distance)
    if focus is not None:
        path = path - _sag(y**2 + x**2, "focus", focus)
    phase = (2 * pi / torch.as_tensor(wavelengths, dtype=torch.float64))[:, None, None] * path
    return torch.polar(torch.ones_like(phase), phase)


def _sag(square: Tensor, where: str, distance: float) -> Tensor:
    """``√(r² + z²) - z`` without cancellation."""
    check_range(where, distance, above=0, high=inf, unit="m")
    if distance == inf:
        return torch.zeros_like(square)
    return square / (torch.sqrt(square + distance**2) + distance)
