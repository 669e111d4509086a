"""Frames of a step of a calibration, what is said of them, and what they measured."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tmca.errors import SettingError
from tmca.lab.calibration.captures import averaged, read_patterns, taken_with
from tmca.lab.calibration.displacement import Curve
from tmca.lab.calibration.file import Calibration
from tmca.lab.frames import Array, Frames, named


@dataclass(frozen=True)
class StepSettings:
    """What frames do not say themselves; where None, what the bench noted with them, or the default.

    Args:
        patterns: folder of those that were shown.
        pattern: which of them dispersion and shear show, from 0; 3.
        white: frames of a white scene, mask and shutter held open for the exposure of a snapshot; without them the
            level of the flat stands for white.
        reflectance: of that scene, as a share: a grey reference does not saturate; 1.
        wavelength: of the registration, metres; needed before a disperser.
        scale: sensor pixels per mask pixel, to 6 %.
        device: (rows, columns) of the mask, to be checked.
        power: text file of the source's power: nm, power.
        curve, order: of the dispersion, see `tmca.lab.calibration.displacement.measure_dispersion`.
        snapshot: a file of the camera, whose masks and bench ``psf`` frames are of.
        slot: whose mask they show.
        saturation: of all frames.
    """

    patterns: str | Path | None = None
    pattern: int | None = None
    white: str | Path | None = None
    reflectance: float | None = None
    wavelength: float | None = None
    scale: float = 1.0
    device: tuple[int, int] | None = None
    power: str | Path | None = None
    curve: Curve = "cauchy"
    order: int = 3
    snapshot: str | Path | None = None
    slot: int = 0
    saturation: float | None = None


@dataclass(frozen=True)
class Captured:
    """Frames of a step, and what it builds on."""

    frames: Frames
    path: Path
    calibration: Calibration
    given: StepSettings

    @property
    def buckets(self) -> int:
        """R of a pixel."""
        return self.frames.values.shape[1] if self.frames.values.ndim == 4 else 1

    def by_name(self, pattern: re.Pattern[str], example: str) -> tuple[Array, list[tuple[float, ...]]]:
        """Light of the frames, those of one name averaged, and the numbers in their names, ascending."""
        values, keys = averaged(self.frames.values, named(self.frames, pattern, example))
        return self.calibration.light(values), keys

    def pattern(self) -> tuple[int, Array]:
        """Number and (h, w) of the pattern that was shown, of the size that was registered."""
        shown = read_patterns(self.given.patterns or "", self.calibration.part("registration").codes)
        index = taken_with(self.path).get("pattern", 3) if self.given.pattern is None else self.given.pattern
        if not 0 <= index < len(shown):
            raise SettingError("pattern", str(index), f"0 to {len(shown) - 1}")
        if (share := shown[index].mean()) in (0.0, 1.0):
            raise SettingError("pattern", f"{index}, which is all {'open' if share else 'dark'}", "a coded one")
        return index, shown[index]


@dataclass(frozen=True)
class Fitted:
    """What a step measured.

    Args:
        part: see `tmca.lab.calibration.file.KINDS`.
        residuals: what it says of its own errors.
        settings: of the fit.
        sources: beside the frames; None are left out.
        codes: (rows, columns) of the mask.
    """

    part: Any
    residuals: Mapping[str, float]
    settings: Mapping[str, Any] = field(default_factory=dict)
    sources: Iterable[str | Path | None] = ()
    codes: tuple[int, int] | None = None
