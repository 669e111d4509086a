"""What a reader should know of a step that was measured, beside its residuals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tmca.errors import DataError
from tmca.lab.calibration.calibration_file import Calibration
from tmca.lab.calibration.captures import RED_WIDER
from tmca.lab.calibration.order import check_order

_WHOLE = 1.1
"""White over saturation, a tenth of which is left for noise and for what saturation was set to."""


def remarks(calibration: Calibration, step: str) -> list[str]:
    """Lines on a step: a white that saturates, views that run backwards, red light that is spread wider than blue,
    steps before it that it puts out of date."""
    found, about = [], calibration.about["steps"][step]
    white = about["residuals"].get("white_level_of_saturation")
    if white is not None and white > _WHOLE:
        found.append(
            f"white is {white:.3g} times saturation: no capture of a white scene is whole; is --reflectance "
            f"{about['settings']['reflectance']:g} that of the reference?"
        )
    if backwards := [axis for axis in "yx" if about["residuals"].get(f"{axis}_pixels_per_view", 0.0) < 0]:
        found.append(
            f"the mask's shadow moves with the views along {' and '.join(backwards)}, as for a --shear below 0: are "
            "the views named from the other side?"
        )
    if step == "dispersion":
        found += _on_dispersion(calibration, about["settings"])
    try:
        check_order(calibration)
    except DataError as error:
        found.append(str(error))
    return found


def _on_dispersion(calibration: Calibration, settings: Mapping[str, Any]) -> list[str]:
    """A line where red light is spread wider than blue, without a curve that says so or a camera drawn so."""
    part = calibration.part("dispersion")
    wider = part.red_and_blue()
    if wider is None or part.curve != "measured" or settings.get(RED_WIDER):
        return []
    red, blue = wider
    return [
        f"red light is displaced by {red:.2f} pixels where blue is by {blue:.2f}, over as many nanometres, "
        "as by neither glass nor gratings: are the wavelengths of the captures right?"
    ]
