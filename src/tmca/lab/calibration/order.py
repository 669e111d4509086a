"""Whether steps that build on another one were measured against the one that is there now."""

from __future__ import annotations

from tmca.data import metres_to_nm
from tmca.errors import DataError
from tmca.lab.calibration.calibration_file import Calibration
from tmca.lab.calibration.stated import REGISTERED_AT

_SAME_LEAKAGE = 2e-3
_SAME_WAVELENGTH = 1e-10
"""Metres: below the steps in which the light of a registration is told."""


def check_order(calibration: Calibration) -> None:
    """Refuse steps that a registration which was measured since has put out of date.

    Displacements hold for a mask that lies elsewhere now, for they are those of the prism, but not against another
    wavelength. Shear does not depend on the registration: it is a difference between views.

    Raises:
        DataError: a timing that took what the mask leaks for the shutter's, for no registration had told of it; a
            dispersion against another wavelength than that of the registration, or in which that wavelength is
            displaced.
    """
    _check_leakage(calibration)
    _check_wavelength(calibration)


def _check_leakage(calibration: Calibration) -> None:
    registration, timing = calibration.part("registration"), calibration.about["steps"].get("timing", {})
    told = timing.get("settings", {}).get("aperture_leakage")
    if told is None or registration is None or registration.leakage is None:
        return
    if abs(registration.closed_light - told) <= _SAME_LEAKAGE:
        return
    found = f"a timing for a mask that leaks {told:.2%}"
    expected = f"one for {registration.closed_light:.2%}, as the registration found since"
    raise _again(calibration, "timing", found, expected)


def _check_wavelength(calibration: Calibration) -> None:
    registration, dispersion = calibration.part("registration"), calibration.part("dispersion")
    if registration is None or registration.wavelength is None or dispersion is None:
        return
    now = f"{metres_to_nm(registration.wavelength):.6g} nm"
    # files of before do not say against what they were measured, nor does a registration of unknown light
    told = calibration.about["steps"].get("dispersion", {}).get("settings", {}).get(REGISTERED_AT)
    if told is not None and abs(told - registration.wavelength) > _SAME_WAVELENGTH:
        found = f"a dispersion measured against a registration at {metres_to_nm(told):.6g} nm"
        raise _again(calibration, "dispersion", found, f"one against the registration at {now}")
    off = dispersion.off_reference(registration.wavelength)
    if off is not None:
        found = f"a dispersion that displaces light of {now} by {off:.2f} pixels"
        raise _again(calibration, "dispersion", found, "none at the wavelength of the registration")


def _again(calibration: Calibration, step: str, found: str, expected: str) -> DataError:
    remedy = f"measure the {step} again: tmca calibrate {step} … --onto it"
    return DataError(calibration.where, found, expected, remedy)
