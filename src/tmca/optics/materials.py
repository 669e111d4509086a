"""Refractive indices of the materials that phase masks are made of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tmca.errors import DataError, SettingError

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
            raise SettingError(self.name, f"{outside[0] * 1e9:.4g} nm", limits, remedy)
        return FORMULAS[self.formula](values * 1e6, np.asarray(self.coefficients))

    @classmethod
    def named(cls, name: str) -> Material:
        """One of ``MATERIALS``, or that of a file of refractiveindex.info's database (``.yml``).

        Raises:
            SettingError: an unknown name.
            DataError: a file that cannot be read.
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
        import yaml

        try:
            described = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
            data = described["DATA"][0]
            kind = str(data["type"])
        except FileNotFoundError:
            raise DataError(path, "no such file", "a .yml file of refractiveindex.info") from None
        except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, IndexError, TypeError) as error:
            raise DataError(path, f"no material ({error!r})", "a .yml file of refractiveindex.info") from None
        return cls(Path(path).stem, *_described(path, kind, data), source=str(path))


def _described(path: str | Path, kind: str, data: Any) -> tuple[str, tuple[float, ...], tuple[float, float]]:
    """Formula, coefficients and limits of an entry of a file."""
    try:
        if kind.startswith("tabulated n"):
            rows = [line.split() for line in str(data["data"]).splitlines() if line.strip()]
            pairs = sorted((float(row[0]), float(row[1])) for row in rows)
            flat = tuple(value for pair in pairs for value in pair)
            return "tabulated", flat, (pairs[0][0] * 1e-6, pairs[-1][0] * 1e-6)
        if kind in FORMULAS:
            low, high = (float(value) * 1e-6 for value in str(data["wavelength_range"]).split())
            return kind, tuple(float(value) for value in str(data["coefficients"]).split()), (low, high)
    except (KeyError, ValueError, IndexError) as error:
        raise DataError(path, f"{kind} that cannot be read ({error!r})", "coefficients and wavelength_range") from None
    raise DataError(path, kind, f"one of {', '.join(FORMULAS)}")


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
