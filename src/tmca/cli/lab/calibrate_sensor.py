"""``tmca calibrate dark|flat|linearity``: the sensor."""

from __future__ import annotations

from pathlib import Path

from tmca.cli.lab.calibrate_words import CalibrationOptions, finished, started

_USUAL = CalibrationOptions()


def dark(captures: Path, /, *, how: CalibrationOptions = _USUAL) -> None:
    """Offset, read noise and hot pixels, from CAPTURES without light.

    Args:
        captures: folder of frames (PNG, TIFF, NPY) or a stack; two or more, exposed like the others.
    """
    from tmca.lab.calibration.steps.sensor import dark_step

    finished(dark_step(started(how), captures, saturation=how.saturation), "dark", how)


def flat(
    captures: Path, /, *, white: Path | None = None, reflectance: float = 1.0, how: CalibrationOptions = _USUAL
) -> None:
    """Response of every pixel, from CAPTURES of even light; the level of white.

    Args:
        captures: folder or stack of frames of even light, two or more.
        white: frames of a white scene, mask and shutter held open for a snapshot's exposure.
        reflectance: of that scene: 0.5 of a grey reference, which does not saturate.
    """
    from tmca.lab.calibration.steps.sensor import flat_step

    finished(
        flat_step(started(how), captures, white=white, reflectance=reflectance, saturation=how.saturation), "flat", how
    )


def linearity(captures: Path, /, *, how: CalibrationOptions = _USUAL) -> None:
    """Linearity, saturation and electrons per digital number, from CAPTURES of even light.

    Args:
        captures: folder of frames named by their exposure, such as even_5ms_0; two or more at each.
    """
    from tmca.lab.calibration.steps.sensor import linearity_step

    finished(linearity_step(started(how), captures, saturation=how.saturation), "linearity", how)
