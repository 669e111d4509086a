"""``tmca calibrate dark|flat|…|psf``: a step, from its captures to a new dated file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from tmca.cli.lab.calibrate_words import CalibrationOptions, finished, started
from tmca.cli.options.numbers import Whole
from tmca.errors import SettingError

_USUAL = CalibrationOptions()


def _measured(step: str, captures: Path, how: CalibrationOptions, part: str = "", **given: Any) -> None:
    from tmca.lab.calibration.fits import StepSettings
    from tmca.lab.calibration.steps import measure

    asked = StepSettings(saturation=how.saturation, **given)
    finished(measure(step, started(how), captures, asked), part or step, how)


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
    from tmca.cli.options.numbers import size
    from tmca.cli.options.output import warned
    from tmca.data import nm_to_metres
    from tmca.lab.calibration.captures import taken_with

    if wavelength is not None and not 100 <= wavelength <= 20000:
        raise SettingError("--wavelength", f"{wavelength:g}", "nanometres of light, 100 to 20000")
    metres = None if wavelength is None else float(nm_to_metres(wavelength))
    codes = size(device, "--device")
    _measured("registration", captures, how, patterns=patterns, wavelength=metres, scale=scale, device=codes)
    if wavelength is None and "wavelength_nm" not in taken_with(captures):
        warned(
            "behind a disperser a registration needs --wavelength: `tmca reconstruct --calibration` refuses this one"
        )


def dispersion(
    captures: Path,
    /,
    *,
    patterns: Path,
    pattern: Whole = 3,
    power: Path | None = None,
    curve: Literal["cauchy", "polynomial", "measured"] = "cauchy",
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
