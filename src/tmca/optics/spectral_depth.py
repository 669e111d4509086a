"""Optics of the spectral-depth camera: depth planes (thesis eq. 29, errata), a lens, a phase mask in its aperture, a
sensor behind (section 5)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from math import inf
from typing import Annotated, Any
from warnings import warn

import torch
from pydantic import AllowInfNan, Json, with_config
from torch import Tensor

from tmca.attributes import STRICT, Attributes
from tmca.errors import DataError, SettingError, check_choice, check_range, check_shape
from tmca.optics.heights import HeightMaps, Stroke
from tmca.optics.phase import Material, circular_aperture, radians_per_metre, spherical_wave
from tmca.optics.point_spread import FocalPlane, PointSpread, Undersampled

MOST_SAMPLES = 2**28
"""Samples of point spread functions, which no array of a file is as large as."""
_MOST_PLANES = 10_000
_ROUNDING = 1e-6
"""By how much of itself a depth may be beyond the range: what single precision makes of its ends."""
_ABOVE = 1 + 1e-9
"""Factor above a bound from which something counts as beyond it."""


@with_config(STRICT)
@dataclass(frozen=True)
class DepthPlanes:
    """D planes from far to near, evenly spaced in inverse depth.

    Args:
        near, far: nearest and farthest plane, metres; ``far`` may be ``inf``.
        count: D ≥ 1; one plane is the one in the middle.

    Raises:
        SettingError: planes that are not in front of the camera, or none.
    """

    near: float
    far: Annotated[float, AllowInfNan()]
    count: int

    def __post_init__(self) -> None:
        if not 0 < self.near < self.far:
            raise SettingError("depth", f"{self.near:g} to {self.far:g} m", "0 < near < far")
        check_range("planes", self.count, 1, _MOST_PLANES, whole=True)

    @property
    def step(self) -> float:
        """Distance of planes in inverse metres: a depth bin."""
        return (1 / self.near - 1 / self.far) / max(1, self.count - 1)

    @property
    def inverse(self) -> Tensor:
        """(D,) inverse metres, from far to near, float64."""
        low, high = 1 / self.far, 1 / self.near
        if self.count == 1:
            return torch.tensor([(low + high) / 2], dtype=torch.float64)
        return torch.linspace(low, high, self.count, dtype=torch.float64)

    @property
    def metres(self) -> Tensor:
        """(D,) from far to near, float64; the first may be infinite."""
        return 1 / self.inverse

    def share_of(self, depth: Tensor) -> Tensor:
        """Inverse depth as a share of the range: 0 at the farthest plane, 1 at the nearest, not clamped."""
        return (1 / depth - 1 / self.far) / (1 / self.near - 1 / self.far)

    def depth_of(self, share: Tensor) -> Tensor:
        """Metres of a share of the range."""
        return 1 / (1 / self.far + share * (1 / self.near - 1 / self.far))

    def within(self, depth: Tensor) -> Tensor:
        """Where depth is a number in the design range, rounding apart; boolean, shape of ``depth``."""
        inside = (depth >= self.near * (1 - _ROUNDING)) & (depth <= self.far * (1 + _ROUNDING))
        return torch.isfinite(depth) & inside

    def nearest(self, depth: Tensor) -> Tensor:
        """Index of the plane nearest in inverse depth, int64, beyond the range that of its end; of what is no depth
        (not finite, zero, negative) 0."""
        place = (1 / depth.double() - 1 / self.far) / self.step
        place = torch.where(torch.isfinite(depth) & (depth > 0), place, torch.zeros_like(place))
        return place.clamp(0, self.count - 1).round().long()

    def weights(self, depth: Tensor) -> Tensor:
        """ω (B, D, H, W) of depth (B, 1, H, W) in metres: one in the plane of every pixel, zero in the others.

        Raises:
            ShapeError: another shape.
        """
        check_shape("depth", depth, ("B", 1, "H", "W"))
        planes = torch.arange(self.count, device=depth.device)[None, :, None, None]
        return (self.nearest(depth) == planes).to(torch.float32)


@with_config(STRICT)
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
    focus: Annotated[float, AllowInfNan()] | None = 2 / 3
    pitch: float = 6e-6
    window: tuple[int, int] = (31, 31)
    mask_pixels: int = 64
    material: str = "mirror"
    oversampling: int = 3

    def __post_init__(self) -> None:
        for name in ("diameter", "distance", "pitch"):
            check_range(name, getattr(self, name), above=0, unit="m")
        if self.focus is not None:
            check_range("focus", self.focus, above=0, high=inf, unit="m")
        object.__setattr__(self, "window", tuple(self.window))
        if len(self.window) != 2 or any(side < 1 or side % 2 == 0 for side in self.window):
            raise SettingError("window", str(self.window), "(h, w), odd")
        check_range("mask_pixels", self.mask_pixels, 2)
        check_range("oversampling", self.oversampling, 1)
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

    def waves(self, wavelengths: Sequence[float], planes: DepthPlanes) -> Tensor:
        """(D, L, H, W) fields of points on the axis just before the mask, behind aperture and lens."""
        optics = self.mask_size, self.mask_pitch, wavelengths
        waves = [spherical_wave(*optics, float(z), self.focus) for z in planes.metres]
        return circular_aperture(self.mask_size) * torch.stack(waves)

    def propagator(self, wavelengths: Sequence[float]) -> FocalPlane:
        """Light from the mask to the samples of the sensor."""
        return FocalPlane(
            self.mask_size, self.mask_pitch, wavelengths, self.distance, self.window, self.pitch,
            chirp=self.focus is None, samples=self.oversampling,
        )  # fmt: skip

    def point_spread(
        self, heights: HeightMaps, wavelengths: Sequence[float], planes: DepthPlanes, energy: str = "unit"
    ) -> PointSpread:
        """The point spread functions of K height maps of ``mask_size`` at D depths and (L,) wavelengths in metres.

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
        shortest = min(wavelengths)
        for text in (*self._steep(shortest, planes), *self._folded(shortest)):
            warn(text, Undersampled, stacklevel=3)

    def _steep(self, shortest: float, planes: DepthPlanes) -> Iterator[str]:
        """What is said of the cones whose phase the mask's pixels do not follow."""
        radius, cones = self.diameter / 2, {} if self.focus is not None else {"focused on the sensor": self.distance}
        for depth in (planes.near, planes.far):
            difference = abs(1 / depth - 1 / (inf if self.focus is None else self.focus))
            if difference > 0:
                cones[f"points at {depth:g} m"] = 1 / difference
        for cone, length in cones.items():
            bound = shortest * (radius**2 + length**2) ** 0.5 / (2 * radius)  # half a wave at the rim
            if self.mask_pitch > bound * _ABOVE:
                yield (
                    f"mask, {cone}: a pitch of {self.mask_pitch * 1e6:.3g} µm is larger than {bound * 1e6:.3g} µm, the "
                    f"most that a cone of radius {radius * 1e3:.3g} mm over {length * 1e3:.3g} mm allows at "
                    f"{shortest * 1e9:.0f} nm; take a finer pitch, a smaller aperture or a longer distance"
                )

    def _folded(self, shortest: float) -> Iterator[str]:
        """What is said of samples and a window on the sensor into which light folds."""
        step, finest = self.pitch / self.oversampling, shortest * self.distance / (2 * self.diameter)
        if step > finest * _ABOVE:
            yield (
                f"sensor: samples of {step * 1e6:.3g} µm are coarser than {finest * 1e6:.3g} µm, the most that follows "
                f"the light of this aperture at {shortest * 1e9:.0f} nm; take more oversampling"
            )
        period, wide = shortest * self.distance / self.mask_pitch, max(self.window) * self.pitch
        if wide > period * _ABOVE:
            yield (
                f"window: {max(self.window)} pixels of {self.pitch * 1e6:.3g} µm are wider than the "
                f"{period * 1e6:.4g} µm after which light repeats at {shortest * 1e9:.0f} nm; "
                "take more mask pixels or a smaller window"
            )


def changed_bench(bench: PhaseMaskBench, changes: Mapping[str, Any]) -> PhaseMaskBench:
    """A bench with other values of some arguments.

    Raises:
        SettingError: a name that is none of them, or an impossible value.
    """
    for name in changes:
        check_choice("bench", name, (field.name for field in fields(bench)))
    return replace(bench, **changes)


class PhaseAttributes(Attributes):
    """What a file says of masks and shutter, which any bands may have."""

    bench: Json[PhaseMaskBench]
    depth: Json[DepthPlanes]
    energy: str
    exposure: str
    stroke: Json[Stroke | None] = None


def check_stated(stated: PhaseAttributes, mask: tuple[int, ...], bands: int, where: str) -> None:
    """Whether the bench that a file states is that of masks (K, H, W), and no larger than can be computed.

    Raises:
        DataError: another side of the masks, or more samples than ``MOST_SAMPLES``.
    """
    bench, remedy = stated.bench, "correct the attribute bench or depth"
    if mask[1:] != bench.mask_size:
        found = f"masks of {'×'.join(map(str, mask[1:]))} pixels"
        raise DataError(where, found, f"{bench.mask_pixels}×{bench.mask_pixels}, as its bench says", remedy)
    height, width = bench.window
    fine = max(height, width) * bench.oversampling * max(height, width, bench.mask_pixels) * bench.oversampling
    samples = max(fine, stated.depth.count * bands * max(mask[0] * height * width, bench.mask_pixels**2))
    if samples > MOST_SAMPLES:
        found = f"point spread functions of {float(samples):.3g} samples"
        raise DataError(where, found, f"at most {MOST_SAMPLES}", remedy)
