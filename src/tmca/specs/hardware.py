"""Faults of a bench: how devices, optics and sensor differ from the camera that the decoder knows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from math import inf, isfinite
from typing import Any

from tmca.errors import SettingError
from tmca.yaml_files import read_yaml

Pair = tuple[float, float]
_TWO = "pixels, one number or (rows, columns), within ±1000"


def _fault(default: float, low: float, high: float, unit: str) -> Any:
    """A field with its range, and its unit in words."""
    return field(default=default, metadata={"low": low, "high": high, "unit": unit})


PAIRS = ("misregistration", "motion")
"""Faults along rows and columns."""
PARTS = {
    "spectral": ("height_error", "wavefront_error", "shear_error"),
    "light-field": ("height_error", "wavefront_error", "dispersion_error"),
    "spectral-depth": ("contrast_ratio", "misregistration", "magnification", "rotation", "dispersion_error",
                       "shear_error", "blur", "motion"),
}  # fmt: skip
"""Faults that a camera cannot have."""
BUCKETS = ("bucket_gain", "bucket_offset", "transfer")
"""Faults of a sensor with several buckets alone."""
MOST_SORTED_WRONG = 0.5
"""Leakage between buckets above which most of a bucket's light is in others: exchanged ones, as calibration says."""


@dataclass(frozen=True)
class Hardware:
    """Faults of a bench; none by default.

    Args:
        contrast_ratio: light that an open aperture pixel passes over that of a closed one; infinite for a perfect one.
        leakage: share of the light that a closed shutter pixel records; with several buckets, that each of them loses
            to the others, half of it at most.
        bucket_gain: share by which the second and later buckets are read brighter than the first.
        bucket_offset: what the second and later buckets read more than the first without light, share of full scale.
        transfer: time after a pixel has changed its bucket in which its light reaches none, share of a slot: taps of a
            pixel sort charge anew at every update of its code (Sarhangnejad et al., ISSCC 2019, 5.8).
        switching: time that the aperture needs from one pattern to the next, share of a slot; it changes linearly.
        dead_time: time at the beginning of every slot in which no shutter is open, share of a slot.
        delay: of the shutter after the aperture, slots.
        jitter: standard deviation of the shutter's steps around their times, slots.
        rolling: delay of the sensor's last row after its first, slots.
        misregistration: displacement of the aperture's image on the sensor, pixels: both axes, or (rows, columns).
        magnification: of the aperture's image, about its middle.
        rotation: of the aperture's image about its middle, degrees.
        dispersion_error: share by which every displacement differs, about the middle of all.
        shear_error: share by which the views' shear differs.
        blur: standard deviation of the point spread of the relay between aperture and sensor, pixels.
        height_error: share by which all heights of a phase mask differ.
        wavefront_error: root mean square of a drawn aberration (Zernike modes up to the fourth order), metres of path.
        hot_pixels: share of the sensor's pixels that are stuck at full scale.
        dead_pixels: share of the sensor's pixels that are stuck at zero.
        motion: by which the scene moves from the beginning to the end of the exposure, pixels: both axes, or (rows,
            columns).

    Raises:
        SettingError: a value that is not finite or outside its range.
    """

    contrast_ratio: float = _fault(inf, 1, inf, "open light over closed light, above 1")
    leakage: float = _fault(0.0, 0, 1, "share of the light, 0 to 1")
    bucket_gain: float = _fault(0.0, -0.5, 1, "share of the gain, -0.5 to 1")
    bucket_offset: float = _fault(0.0, -1, 1, "share of full scale, within ±1")
    transfer: float = _fault(0.0, 0, 1, "share of a slot, 0 to 1")
    switching: float = _fault(0.0, 0, 1, "share of a slot, 0 to 1")
    dead_time: float = _fault(0.0, 0, 1, "share of a slot, 0 to 1")
    delay: float = _fault(0.0, -64, 64, "slots, within ±64")
    jitter: float = _fault(0.0, 0, 1, "slots, 0 to 1")
    rolling: float = _fault(0.0, -64, 64, "slots, within ±64")
    misregistration: float | Pair = _fault(0.0, -1000, 1000, _TWO)  # noqa: RUF009
    magnification: float = _fault(1.0, 0.5, 2, "0.5 to 2")
    rotation: float = _fault(0.0, -180, 180, "degrees, within ±180")
    dispersion_error: float = _fault(0.0, -1, 1, "share of the displacement, within ±1")
    shear_error: float = _fault(0.0, -1, 1, "share of the shear, within ±1")
    blur: float = _fault(0.0, 0, 20, "pixels, 0 to 20")
    height_error: float = _fault(0.0, -1, 1, "share of the heights, within ±1")
    wavefront_error: float = _fault(0.0, 0, 1e-5, "metres, 0 to 1e-5")
    hot_pixels: float = _fault(0.0, 0, 1, "share of the pixels, 0 to 1")
    dead_pixels: float = _fault(0.0, 0, 1, "share of the pixels, 0 to 1")
    motion: float | Pair = _fault(0.0, -1000, 1000, _TWO)  # noqa: RUF009

    def __post_init__(self) -> None:
        for name, limit in LIMITS.items():
            values = _numbers(name, getattr(self, name))
            if not all(
                limit["low"] <= v <= limit["high"] and (isfinite(v) or name == "contrast_ratio") for v in values
            ):
                raise SettingError(name, str(getattr(self, name)), limit["unit"])
        if self.contrast_ratio == 1:
            raise SettingError("contrast_ratio", "1", "above 1: open and closed pixels would be the same")
        if self.hot_pixels + self.dead_pixels > 1:
            raise SettingError("hot_pixels, dead_pixels", f"{self.hot_pixels + self.dead_pixels:g}", "1 together")

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Hardware:
        """Faults by their names; values are numbers, or texts of them, ROWS:COLUMNS where there are two.

        Raises:
            SettingError: an unknown name, or an impossible value.
        """
        for name in values:
            if name not in LIMITS:
                raise SettingError("hardware", repr(name), f"one of {', '.join(LIMITS)}")
        numbers = {name: _numbers(name, value) for name, value in values.items()}
        return cls(**{name: each if len(each) == 2 else each[0] for name, each in numbers.items()})  # type: ignore[arg-type]

    @classmethod
    def read(cls, text: str | None) -> Hardware:
        """Faults of a text ``NAME=VALUE,…``, or of a YAML file of them; none without.

        Raises:
            SettingError, DataError: unknown or impossible ones, a text of another form, a file that cannot be read.
        """
        if text is None:
            return cls()
        if "=" in text:
            return cls.of(_named(text))
        values = read_yaml(text, "NAME=VALUE,…, or a YAML file of lines NAME: VALUE (docs/hardware.md)")
        try:
            return cls.of(values)
        except SettingError as error:
            raise SettingError(f"{text}, {error.where}", error.found[:80], error.expected, error.remedy) from None

    @property
    def shift(self) -> Pair:
        """Rows and columns of the misregistration, pixels."""
        return _pair(self.misregistration)

    @property
    def movement(self) -> Pair:
        """Rows and columns of the scene's motion, pixels."""
        return _pair(self.motion)

    def faults(self) -> dict[str, Any]:
        """Those that there are."""
        perfect = {one.name: one.default for one in fields(self)}
        return {name: value for name, value in asdict(self).items() if value != perfect[name]}

    def described(self) -> str:
        """Those that there are, in words."""
        words = {n: " ".join(f"{v:g}" for v in _numbers(n, value)) for n, value in self.faults().items()}
        return ", ".join(f"{name} = {value}" for name, value in words.items())

    def check(self, application: str, buckets: int = 1) -> None:
        """Raises SettingError for a fault that a camera, or a sensor with so many buckets a pixel, cannot have."""
        if buckets > 1 and self.leakage > MOST_SORTED_WRONG:
            expected = (
                f"at most {MOST_SORTED_WRONG} with {buckets} buckets: most of a bucket's light would be in others"
            )
            raise SettingError("leakage", f"{self.leakage:g}", expected, "exchange the buckets if that is meant")
        for name in self.faults():
            if buckets == 1 and name in BUCKETS:
                expected = "none of a sensor with one bucket"
                raise SettingError(name, str(getattr(self, name)), expected, "take a camera with buckets=2")
            if name in PARTS[application]:
                possible = ", ".join(other for other in LIMITS if other not in PARTS[application])
                expected = f"none in a {application} camera, which has {possible}"
                raise SettingError(name, str(getattr(self, name)), expected)


LIMITS = {one.name: dict(one.metadata) for one in fields(Hardware)}
"""Least and largest value of every fault, and its unit in words."""


def _pair(both: float | Pair) -> Pair:
    return (float(both[0]), float(both[1])) if isinstance(both, tuple) else (float(both), float(both))


def _numbers(name: str, value: Any) -> tuple[float, ...]:
    numbers = value.split(":") if isinstance(value, str) else value
    parts = numbers if isinstance(numbers, tuple | list) else (numbers,)
    if len(parts) not in ((1, 2) if name in PAIRS else (1,)):
        raise SettingError(name, str(value), LIMITS[name]["unit"])
    try:
        return tuple(float(part) for part in parts)
    except (TypeError, ValueError):
        raise SettingError(name, repr(value), LIMITS[name]["unit"]) from None


def _named(text: str) -> dict[str, Any]:
    faults: dict[str, Any] = {}
    for part in text.split(","):
        name, sign, value = (word.strip() for word in part.partition("="))
        if not (sign and name and value) or name in faults:
            expected = "NAME=VALUE,NAME=VALUE, such as contrast_ratio=50,delay=0.1"
            raise SettingError("hardware", repr(text), expected)
        faults[name] = value
    return faults
