"""``tmca calibrate registration|dispersion|shear|timing|psf``: light between mask and sensor."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tmca.cli.lab.calibrate_words import CalibrationOptions, finished, started
from tmca.cli.options.numbers import Whole
from tmca.errors import SettingError

_USUAL = CalibrationOptions()


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
        wavelength: of the light, nm; needed before a disperser.
        scale: sensor pixels per mask pixel, to 6 %.
        device: HEIGHTxWIDTH of the mask, refused if the patterns differ.
    """
    from tmca.cli.options.numbers import size
    from tmca.cli.options.output import warned
    from tmca.data import nm_to_metres
    from tmca.lab.calibration.steps.optics import registration_step

    if wavelength is not None and not 100 <= wavelength <= 20000:
        raise SettingError("--wavelength", f"{wavelength:g}", "nanometres of light, 100 to 20000")
    metres = None if wavelength is None else float(nm_to_metres(wavelength))
    found = registration_step(
        started(how), captures, patterns, wavelength=metres, scale=scale, device=size(device, "--device"),
        saturation=how.saturation,
    )  # fmt: skip
    finished(found, "registration", how)
    if wavelength is None:
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
    from tmca.lab.calibration.steps.optics import dispersion_step

    found = dispersion_step(
        started(how), captures, patterns, pattern=pattern, power=power, curve=curve, order=order,
        saturation=how.saturation,
    )  # fmt: skip
    finished(found, "dispersion", how)


def shear(captures: Path, /, *, patterns: Path, pattern: Whole = 3, how: CalibrationOptions = _USUAL) -> None:
    """Pixels per view, and the light of views, from CAPTURES of one pattern with one view open each.

    Args:
        captures: folder of frames named by their view, such as view_-1_2 (row, column from the middle).
        patterns: that were shown.
        pattern: which of them was shown, counted from 0.
    """
    from tmca.lab.calibration.steps.optics import shear_step

    found = shear_step(started(how), captures, patterns, pattern=pattern, saturation=how.saturation)
    finished(found, "shear", how)


def timing(captures: Path, /, *, how: CalibrationOptions = _USUAL) -> None:
    """Delay, duration and leakage of the shutter's slots, from CAPTURES with one slot of both devices open each.

    Args:
        captures: folder of frames named by their slots, such as aperture_0_shutter_1.
    """
    from tmca.lab.calibration.steps.optics import timing_step

    finished(timing_step(started(how), captures, saturation=how.saturation), "timing", how)


def psf(captures: Path, /, *, snapshot: Path, slot: Whole = 0, how: CalibrationOptions = _USUAL) -> None:
    """Point spread functions and the wavefront of the mask of one slot, from CAPTURES of a point source.

    Args:
        captures: folder of frames named by depth and wavelength, such as point_0.6m_550nm.
        snapshot: a snapshot file of the camera: its bench, and the heights that were asked for.
        slot: whose mask was shown, counted from 0.
    """
    from tmca.lab.calibration.steps.psf import phase_mask_camera, psf_step

    camera = phase_mask_camera(snapshot, slot)
    nominal = camera.codes()[0][slot].detach().double().numpy()
    found = psf_step(
        started(how), captures, camera.bench, slot=slot, nominal=nominal, saturation=how.saturation, source=snapshot
    )
    finished(found, f"wavefront{slot}", how)
