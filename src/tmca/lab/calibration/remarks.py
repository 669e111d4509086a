"""What a reader should know of a step that was measured, beside its residuals."""

from __future__ import annotations

from tmca.errors import DataError
from tmca.lab.calibration.calibration_file import Calibration
from tmca.lab.calibration.order import check_order

_WHOLE = 1.1
"""White over saturation, a tenth of which is left for noise and for what saturation was set to."""


def remarks(calibration: Calibration, step: str) -> list[str]:
    """Lines on a step: a white that saturates, views that run backwards, steps before it that it puts out of date."""
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
    try:
        check_order(calibration)
    except DataError as error:
        found.append(str(error))
    return found
