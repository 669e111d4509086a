"""View shear: how a mask in front of the sensor meets the rays of every view (thesis eqs 6, 7 with the errata)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import ceil, inf

from tmca.errors import SettingError, check_range

Grid = tuple[int, int]
_MOST_VIEWS, _DECIMALS = 9, 9


def view_grid(views: int | tuple[int, int]) -> Grid:
    """(V, U) of a number of views per axis, or of (V, U).

    Raises:
        SettingError: an even number, which has no centre view, or more than 9.
    """
    try:
        rows, columns = (views, views) if isinstance(views, int) else (int(n) for n in views)
    except (TypeError, ValueError):
        raise SettingError("views", repr(views), "a number, or (rows, columns)") from None
    if not all(1 <= n <= _MOST_VIEWS and n % 2 for n in (rows, columns)):
        raise SettingError("views", f"{rows}×{columns}", f"odd numbers up to {_MOST_VIEWS}", "take the centre views")
    return rows, columns


def view_coordinates(count: int) -> tuple[int, ...]:
    """-(n-1)/2 … (n-1)/2: places of the views along one axis, in view steps."""
    return tuple(range(-(count // 2), count // 2 + 1))


@dataclass(frozen=True)
class ViewShear:
    """Where the ray from sensor pixel m to view ℓ crosses the mask: at mask pixel ``c' + scale · (m - c) + step · ℓ``,
    c and c' the middles of sensor and mask, along each axis.

    Args:
        views: (V, U), odd.
        step: mask pixels per view along y and x: real numbers, or one for both; the thesis has 1.
        scale: mask pixels per sensor pixel as the sensor sees them; 1 for a mask of pitch (1-s)·p, 1-s for one of the
            sensor's own pitch.

    Raises:
        SettingError: views that are even or too many, values that are not finite, a scale that is not positive.
    """

    views: Grid
    step: tuple[float, float] = (1.0, 1.0)
    scale: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "views", view_grid(self.views))
        try:
            step = self.step if isinstance(self.step, Iterable) else (self.step, self.step)
            y, x = (round(float(s), _DECIMALS) for s in step)
        except (TypeError, ValueError):
            y = x = inf
        if not (abs(y) <= 1000 and abs(x) <= 1000):
            wanted = "mask pixels per view within ±1000: one number, or (along y, along x)"
            raise SettingError("shear", repr(self.step), wanted)
        check_range("mask_scale", self.scale, 0.1, 10, unit="mask pixels per sensor pixel")
        object.__setattr__(self, "step", (y, x))
        object.__setattr__(self, "scale", float(self.scale))

    @property
    def whole(self) -> bool:
        """Whether every ray meets the middle of a mask pixel, so that shears are plain shifts."""
        return self.scale == 1 and all(s == int(s) for s in self.step)

    def border(self, size: tuple[int, int]) -> tuple[int, int]:
        """Rows and columns of mask beyond the sensor on each side: ``⌈|step| (U-1)/2⌉``, and what the scale adds."""
        grow = [max(0.0, (self.scale - 1) * (n - 1) / 2) for n in size]
        reach = [abs(s) * (v // 2) + g for s, v, g in zip(self.step, self.views, grow, strict=True)]
        return (ceil(reach[0] - 1e-9), ceil(reach[1] - 1e-9))

    def mask_size(self, size: tuple[int, int]) -> tuple[int, int]:
        """(H, W) of the mask in front of a sensor of ``size``."""
        border = self.border(size)
        return (size[0] + 2 * border[0], size[1] + 2 * border[1])

    def drift(self, size: tuple[int, int]) -> tuple[float, float]:
        """Mask pixels by which the code at the edge of a sensor of ``size`` is off if the scale is taken for 1."""
        return ((self.scale - 1) * (size[0] - 1) / 2, (self.scale - 1) * (size[1] - 1) / 2)


def _check_bench(views: object, **lengths: float) -> None:
    """Raises SettingError unless the views are an odd number per axis, and the lengths are above 0 m."""
    if not isinstance(views, int):
        raise SettingError("views", repr(views), "an odd number per axis")
    view_grid(views)
    for name, metres in lengths.items():
        check_range(name, metres, above=0, unit="m")


@dataclass(frozen=True)
class MaskGeometry:
    """A mask between lens and sensor, in metres.

    A sensor pixel sees view ℓ, the part of the aperture around ``u = ℓ · view_spacing``, through the mask at
    ``(1-s) x + s u`` with ``s = d_l/d_a`` (eq. 6).

    Args:
        mask_distance: d_l from the sensor to the mask.
        aperture_distance: d_a from the sensor to the aperture.
        pixel_pitch: p of the sensor.
        aperture_width: width of the aperture, shared out evenly among the views.
        views: per axis, odd.

    Raises:
        SettingError: a length that is not positive, a mask that is not between sensor and aperture, even views.
    """

    mask_distance: float
    aperture_distance: float
    pixel_pitch: float
    aperture_width: float
    views: int = 5

    def __post_init__(self) -> None:
        _check_bench(**vars(self))
        if self.mask_distance >= self.aperture_distance:
            wanted = f"less than the aperture's {self.aperture_distance:g} m"
            raise SettingError("mask_distance", f"{self.mask_distance:g} m", wanted)

    @classmethod
    def for_shear(
        cls, step: float, aperture_distance: float, pixel_pitch: float, aperture_width: float, views: int = 5
    ) -> MaskGeometry:
        """The mask at the distance that shears by ``step`` mask pixels per view; ``step=1`` resolves just these views.

        From ``step = d_l Δu / ((d_a - d_l) p)``: ``d_l = d_a · step · p / (Δu + step · p)``. The angular resolution of
        a mask at d_l is then that of Marwah 2013: neighbouring views are one mask pixel apart.
        """
        check_range("step", step, above=0, unit="mask pixels per view")
        _check_bench(views, aperture_distance=aperture_distance, pixel_pitch=pixel_pitch, aperture_width=aperture_width)
        moved = step * pixel_pitch
        distance = aperture_distance * moved / (aperture_width / views + moved)
        return cls(distance, aperture_distance, pixel_pitch, aperture_width, views)

    @classmethod
    def for_pitch(
        cls, mask_pitch: float, aperture_distance: float, pixel_pitch: float, aperture_width: float, views: int = 5
    ) -> MaskGeometry:
        """The mask of pitch q whose pixels fall on sensor pixels: at the distance ``d_l = d_a (1 - q/p)``."""
        _check_bench(views, mask_pitch=mask_pitch, pixel_pitch=pixel_pitch, aperture_distance=aperture_distance)
        if mask_pitch >= pixel_pitch:
            remedy = "a mask before the sensor needs smaller pixels than it; for others give the distance"
            raise SettingError("mask_pitch", f"{mask_pitch:g} m", f"less than the sensor's {pixel_pitch:g} m", remedy)
        distance = aperture_distance * (1 - mask_pitch / pixel_pitch)
        return cls(distance, aperture_distance, pixel_pitch, aperture_width, views)

    @property
    def s(self) -> float:
        """d_l / d_a, the shear of the mask against the light field."""
        return self.mask_distance / self.aperture_distance

    @property
    def view_spacing(self) -> float:
        """Δu on the aperture, metres."""
        return self.aperture_width / self.views

    @property
    def mask_pitch(self) -> float:
        """(1-s)·p, metres: mask pixels that fall on sensor pixels, seen from the aperture's middle."""
        return (1 - self.s) * self.pixel_pitch

    @property
    def step(self) -> float:
        """Mask pixels of ``mask_pitch`` per view, ``d_l Δu / ((d_a - d_l) p)``."""
        before = self.aperture_distance - self.mask_distance
        return self.mask_distance * self.view_spacing / (before * self.pixel_pitch)

    def shear(self, mask_pitch: float | None = None) -> ViewShear:
        """The shear of a mask of this pitch, metres; of ``(1-s) · p`` if None."""
        if mask_pitch is not None:
            check_range("mask_pitch", mask_pitch, above=0, unit="m")
        scale = 1.0 if mask_pitch is None else self.mask_pitch / mask_pitch
        return ViewShear((self.views, self.views), (self.step * scale,) * 2, scale)
