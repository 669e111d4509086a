"""Optics of the spectral-depth camera: a lens, a phase mask in its aperture, a sensor behind (thesis section 5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from math import isfinite
from typing import Any
from warnings import warn

import torch
from torch import Tensor

from tmca.errors import SettingError
from tmca.optics.depth import DepthPlanes
from tmca.optics.heights import HeightMaps
from tmca.optics.materials import Material
from tmca.optics.phase import circular_aperture, radians_per_metre, spherical_wave
from tmca.optics.point_spread import PointSpread
from tmca.optics.propagation import FocalPlane, Undersampled, check_sampling


@dataclass(frozen=True)
class PhaseMaskBench:
    """Distances, pitches and sizes of the bench, metres and pixels.

    With ``focus``, a lens in the plane of the mask images objects at that distance sharply on the sensor: an objective,
    or a 4f bench with a deformable mirror in its pupil. Without, the mask alone has to focus.

    Args:
        diameter: of the circular aperture, metres.
        distance: s from the mask to the sensor, metres; of a 4f bench, its focal length.
        focus: distance z of sharp objects, metres, may be ``inf``; None without a lens.
        pitch: of the sensor's pixels, metres.
        window: (h, w) of the point spread functions, pixels; odd, so that they have a middle.
        mask_pixels: side of the height maps over the aperture, pixels.
        material: of the mask (``tmca.optics.MATERIALS``), or ``"mirror"``.
        oversampling: samples per side of a pixel, over whose area light is summed.

    Raises:
        SettingError: impossible numbers.
    """

    diameter: float = 2e-3
    distance: float = 25e-3
    focus: float | None = 2 / 3
    pitch: float = 6e-6
    window: tuple[int, int] = (31, 31)
    mask_pixels: int = 64
    material: str = "mirror"
    oversampling: int = 3

    def __post_init__(self) -> None:
        for name in ("diameter", "distance", "pitch"):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0):
                raise SettingError(name, f"{value:g} m", "finite metres above 0")
        if self.focus is not None and not self.focus > 0:
            raise SettingError("focus", f"{self.focus:g} m", "above 0, or None without a lens")
        if len(self.window) != 2 or any(side < 1 or side % 2 == 0 for side in self.window):
            raise SettingError("window", str(self.window), "(h, w), odd")
        if self.mask_pixels < 2 or self.oversampling < 1:
            found = f"{self.mask_pixels} mask pixels, oversampling {self.oversampling}"
            raise SettingError("bench", found, "2 mask pixels or more, oversampling of 1 or more")
        self.phase_material()

    def phase_material(self) -> Material | None:
        """What the mask is made of; None for a mirror."""
        return None if self.material == "mirror" else Material.named(self.material)

    @property
    def mask_size(self) -> tuple[int, int]:
        """(H, W) of the height maps."""
        return (self.mask_pixels, self.mask_pixels)

    @property
    def mask_pitch(self) -> float:
        """Of the height maps, metres."""
        return self.diameter / self.mask_pixels

    def defocus(self, depth: float) -> float:
        """Diameter of the geometric blur of a point behind the flat mask, pixels: ``D s |1/z - 1/z_f| / p``."""
        sharp = -1 / self.distance if self.focus is None else 1 / self.focus
        return self.diameter * self.distance * abs(1 / depth - sharp) / self.pitch

    def waves(self, wavelengths: Sequence[float], planes: DepthPlanes) -> Tensor:
        """(D, L, H, W) fields of points on the axis just before the mask, behind aperture and lens."""
        aperture = circular_aperture(self.mask_size)
        fields = (
            spherical_wave(self.mask_size, self.mask_pitch, wavelengths, float(z), self.focus) for z in planes.metres
        )
        return torch.stack([aperture * field for field in fields])

    def propagator(self, wavelengths: Sequence[float]) -> FocalPlane:
        """Light from the mask to the samples of the sensor."""
        return FocalPlane(
            self.mask_size, self.mask_pitch, wavelengths, self.distance, self.window, self.pitch,
            chirp=self.focus is None, samples=self.oversampling,
        )  # fmt: skip

    def point_spread(
        self, heights: HeightMaps, wavelengths: Sequence[float], planes: DepthPlanes, energy: str = "unit"
    ) -> PointSpread:
        """The point spread functions of height maps on this bench.

        Args:
            heights: K maps of ``mask_size``.
            wavelengths: (L,) metres.
            planes: D depth planes.
            energy: see ``PointSpread``.

        Raises:
            ShapeError: maps of another size.
            SettingError: a wavelength outside the material's data.

        Warns:
            Undersampled: mask or sensor pixels that cannot follow the light.
        """
        turns = radians_per_metre(wavelengths, self.phase_material())
        self.check_sampling(wavelengths, planes)
        waves = self.waves(wavelengths, planes)
        return PointSpread(heights, waves, turns, self.propagator(wavelengths), energy, self.oversampling)

    def check_sampling(self, wavelengths: Sequence[float], planes: DepthPlanes) -> None:
        """Warns ``Undersampled`` where defocus turns the phase too fast for the mask's pixels, or light would fold.

        The Fourier pair of mask and sensor repeats every ``λ s / mask_pitch`` on the sensor: the window has to be
        smaller than that.
        """
        sharp = float("inf") if self.focus is None else self.focus
        for depth in (planes.near, planes.far):
            difference = abs(1 / depth - 1 / sharp)
            if difference > 0:
                where = f"mask, points at {depth:g} m"
                check_sampling(self.mask_pitch, wavelengths, self.diameter / 2, 1 / difference, where)
        if self.focus is None:
            check_sampling(
                self.mask_pitch, wavelengths, self.diameter / 2, self.distance, "mask, focused on the sensor"
            )
        step, finest = self.pitch / self.oversampling, min(wavelengths) * self.distance / (2 * self.diameter)
        if step > finest * (1 + 1e-9):
            warn(
                f"sensor: samples of {step * 1e6:.3g} µm are coarser than {finest * 1e6:.3g} µm, the most that follows "
                f"the light of this aperture at {min(wavelengths) * 1e9:.0f} nm; take more oversampling",
                Undersampled,
                stacklevel=3,
            )
        period, wide = min(wavelengths) * self.distance / self.mask_pitch, max(self.window) * self.pitch
        if wide > period * (1 + 1e-9):
            warn(
                f"window: {max(self.window)} pixels of {self.pitch * 1e6:.3g} µm are wider than the "
                f"{period * 1e6:.4g} µm after which light repeats at {min(wavelengths) * 1e9:.0f} nm; "
                "take more mask pixels or a smaller window",
                Undersampled,
                stacklevel=3,
            )


def changed_bench(bench: PhaseMaskBench, changes: Mapping[str, Any]) -> PhaseMaskBench:
    """A bench with other values of some arguments.

    Raises:
        SettingError: a name that is none of them, or an impossible value.
    """
    known = [field.name for field in fields(bench)]
    for name in changes:
        if name not in known:
            raise SettingError("bench", name, f"some of {', '.join(known)}")
    given = {**changes, **({"window": tuple(changes["window"])} if "window" in changes else {})}
    return replace(bench, **given)
