"""``tmca calibrate dark|flat|…|psf|all``: from the captures of steps to new dated files."""

from __future__ import annotations

import json as json_module
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter

from tmca.cli.options.numbers import On, Whole, size

if TYPE_CHECKING:
    from tmca.lab.calibration.file import Calibration

_OUTPUT = Group("Calibration", sort_key=3)
Curve = Literal["cauchy", "polynomial", "measured"]


@Parameter(name="*", group=_OUTPUT)
@dataclass(frozen=True)
class CalibrationOptions:
    """What a step builds on, and where it writes."""

    onto: Path | None = None
    "Calibration to build on: a file, or its name without the date for the newest."
    out: Path | None = None
    "Name of the new files, to which the date is added; that of --onto without it."
    camera: str | None = None
    "Name of the camera, kept in the file; that of --onto, or of --out, without it."
    saturation: float | None = None
    "Value from which on a pixel is saturated; an integer type's maximum without it."
    figures: On = True
    "Write a picture beside the file."
    json: Annotated[bool, Parameter(negative="")] = False
    "Print JSON instead of text."

    @property
    def prefix(self) -> Path:
        """What the new files are called before their date."""
        return self.out or self.onto or Path("calibration")

    def started(self) -> Calibration:
        """The calibration that a step builds on.

        Raises:
            DataError: that is none, or of a camera of another name.
        """
        from tmca.data import check_target
        from tmca.errors import DataError
        from tmca.lab.calibration.file import Calibration, load_calibration

        check_target(self.prefix.with_name(f"{self.prefix.name}_date.nc"), overwrite=True)
        if self.onto is None:
            return Calibration.empty(self.camera or self.prefix.name)
        calibration = load_calibration(self.onto)
        name = calibration.about["camera"]["name"]
        if self.camera is not None and self.camera != name:
            remedy = "build on a calibration of this camera, or start a new one without --onto"
            raise DataError(calibration.where, f"a calibration of camera {name}", f"one of {self.camera}", remedy)
        return calibration

    def finished(self, calibration: Calibration, part: str) -> None:
        """Save, draw and say what a step measured."""
        from tmca.data import plain
        from tmca.lab.calibration.steps import part_figure
        from tmca.plots.style import save_figure

        saved = calibration.save(self.prefix)
        if self.figures and saved.path is not None:
            save_figure(part_figure(saved, part, saved.path.stem), saved.path.with_suffix(".png"))
        residuals = saved.about["steps"][part]["residuals"]
        if self.json:
            print(json_module.dumps({"calibration": str(saved.path), "step": part, **plain(residuals)}, indent=1))
            return
        print(f"{saved.path}: {part}")
        say_residuals(residuals)


_USUAL = CalibrationOptions()


def say_residuals(residuals: Mapping[str, Any]) -> None:
    """A line for each."""
    for name, value in residuals.items():
        shown = "not known" if value is None or value != value else f"{value:.5g}"
        print(f"  {name.replace('_', ' '):<32} {shown}")


def _metres(wavelength: float | None) -> float | None:
    """Of a wavelength in nm."""
    from tmca.data import nm_to_metres
    from tmca.errors import check_range

    if wavelength is None:
        return None
    check_range("--wavelength", wavelength, 100, 20000, unit="nm")
    return float(nm_to_metres(wavelength))


def _measured(step: str, captures: Path, how: CalibrationOptions, part: str = "", **given: Any) -> None:
    from tmca.lab.calibration.fits import StepSettings
    from tmca.lab.calibration.steps import measure

    asked = StepSettings(saturation=how.saturation, **given)
    how.finished(measure(step, how.started(), captures, asked), part or step)


def measured_all(
    folder: Path,
    /,
    *,
    wavelength: float | None = None,
    reflectance: float | None = None,
    power: Path | None = None,
    curve: Curve = "cauchy",
    scale: float = 1.0,
    snapshot: Path | None = None,
    how: CalibrationOptions = _USUAL,
) -> None:
    """Measure every step whose frames are in FOLDER, in their order: what capture and render write.

    Args:
        folder: with folders dark, flat, white, linearity, registration, buckets, timing, dispersion,
            shear, psf0 …, patterns.
        wavelength: of the registration, nm; what capture took says it.
        reflectance: of the white reference; what capture took says it, else 1.
        power: text file of the source: wavelength in nm, power; FOLDER/source.csv where it is there.
        curve: of the dispersion: powers of 1/λ² (cauchy) or of λ (polynomial), or none (measured).
        scale: sensor pixels per mask pixel, to 6 %.
        snapshot: a snapshot file of the camera, for points before a spectral-depth camera (psf0, …).
    """
    from tmca.lab.calibration.fits import StepSettings
    from tmca.lab.calibration.steps import measure_all

    given = StepSettings(
        reflectance=reflectance, wavelength=_metres(wavelength), scale=scale, power=power, curve=curve,
        camera=snapshot, saturation=how.saturation,
    )  # fmt: skip
    for step, calibration in measure_all(folder, how.started(), given):
        how.finished(calibration, step)


def dark(captures: Path, /, *, how: CalibrationOptions = _USUAL) -> None:
    """Offset, read noise and hot pixels, from CAPTURES without light.

    Args:
        captures: folder of frames (PNG, TIFF, NPY) or a stack; two or more, exposed like the others.
    """
    _measured("dark", captures, how)


def flat(
    captures: Path, /, *, white: Path | None = None, reflectance: float = 1.0, how: CalibrationOptions = _USUAL
) -> None:
    """Response of every pixel, from CAPTURES of even light; the level of white.

    Args:
        captures: folder or stack of frames of even light, two or more.
        white: frames of a white scene, mask and shutter held open for a snapshot's exposure.
        reflectance: of that scene: 0.5 of a grey reference, which does not saturate.
    """
    _measured("flat", captures, how, white=white, reflectance=reflectance)


def linearity(captures: Path, /, *, how: CalibrationOptions = _USUAL) -> None:
    """Linearity, saturation and electrons per digital number, from CAPTURES of even light.

    Args:
        captures: folder of frames named by their exposure, such as even_5ms_0; two or more at each.
    """
    _measured("linearity", captures, how)


def registration(
    captures: Path,
    /,
    *,
    patterns: Path,
    wavelength: float | None = None,
    scale: float = 1.0,
    device: str | None = None,
    how: CalibrationOptions = _USUAL,
) -> None:
    """Where mask pixels fall on the sensor, and what closed ones pass, from CAPTURES of patterns.

    Args:
        captures: folder or stack, in the order of the patterns.
        patterns: that were shown, an open and a dark one among them.
        wavelength: of the light, nm; needed before a disperser; what capture took says it.
        scale: sensor pixels per mask pixel, to 6 %.
        device: HEIGHTxWIDTH of the mask, refused if the patterns differ.
    """
    codes = size(device, "--device")
    _measured(
        "registration", captures, how, patterns=patterns, wavelength=_metres(wavelength), scale=scale, device=codes
    )


def dispersion(
    captures: Path,
    /,
    *,
    patterns: Path,
    pattern: Whole = 3,
    power: Path | None = None,
    curve: Curve = "cauchy",
    order: Whole = 3,
    how: CalibrationOptions = _USUAL,
) -> None:
    """Displacement and response of every wavelength, from monochromatic CAPTURES of one pattern.

    Args:
        captures: folder of frames named by their wavelength, such as band_450nm, exposed alike.
        patterns: that were shown.
        pattern: which of them was shown, counted from 0.
        power: text file of the source: wavelength in nm, power.
        curve: powers of 1/λ² (cauchy) or of λ (polynomial), or none (measured): straight lines between wavelengths.
        order: highest power.
    """
    _measured("dispersion", captures, how, patterns=patterns, pattern=pattern, power=power, curve=curve, order=order)


def shear(captures: Path, /, *, patterns: Path, pattern: Whole = 3, how: CalibrationOptions = _USUAL) -> None:
    """Pixels per view, and the light of views, from CAPTURES of one pattern with one view open each.

    Args:
        captures: folder of frames named by their view, such as view_-1_2 (row, column from the middle).
        patterns: that were shown.
        pattern: which of them was shown, counted from 0.
    """
    _measured("shear", captures, how, patterns=patterns, pattern=pattern)


def buckets(captures: Path, /, *, how: CalibrationOptions = _USUAL) -> None:
    """Leakage between the buckets of a pixel, and the time of a change, from CAPTURES of even light.

    Args:
        captures: folder of frames with a page for each bucket: bucket_0_0 (all slots in the first), …, in_turn_4_0 (one
            of four slots in each after the other).
    """
    _measured("buckets", captures, how)


def timing(captures: Path, /, *, how: CalibrationOptions = _USUAL) -> None:
    """Delay, duration and leakage of the shutter's slots, from CAPTURES with one slot of both devices open each.

    Args:
        captures: folder of frames named by their slots, such as aperture_0_shutter_1.
    """
    _measured("timing", captures, how)


def psf(captures: Path, /, *, snapshot: Path, slot: Whole = 0, how: CalibrationOptions = _USUAL) -> None:
    """Point spread functions and the wavefront of the mask of one slot, from CAPTURES of a point source.

    Args:
        captures: folder of frames named by depth and wavelength, such as point_0.6m_550nm.
        snapshot: a snapshot file of the camera: its bench, and the heights that were asked for.
        slot: whose mask was shown, counted from 0.
    """
    _measured("psf", captures, how, f"wavefront{slot}", camera=snapshot, slot=slot)
