"""All steps of a calibration, from a folder with the frames of each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tmca.data import nm_to_metres
from tmca.errors import DataError
from tmca.lab.calibration.calibration_file import Calibration
from tmca.lab.calibration.measurements.dispersion import Curve
from tmca.lab.calibration.steps.optics import dispersion_step, registration_step, shear_step, timing_step
from tmca.lab.calibration.steps.psf import phase_mask_camera, psf_step
from tmca.lab.calibration.steps.sensor import dark_step, flat_step, linearity_step
from tmca.lab.codes_date import CAPTURES
from tmca.lab.devices.captures import read_captures

STEPS = ("dark", "flat", "linearity", "registration", "timing", "dispersion", "shear")


@dataclass(frozen=True)
class Known:
    """What frames do not say themselves; what `tmca calibrate capture` took says it.

    Args:
        wavelength: of the registration, metres.
        reflectance: of the white reference.
        power: text file of the source's power, or None: that of FOLDER/source.csv where it is there.
        curve: of the dispersion.
        scale: sensor pixels per mask pixel.
        saturation: of all frames.
        camera: a snapshot file of the camera, whose masks and bench ``psf`` frames are of.
    """

    wavelength: float | None = None
    reflectance: float | None = None
    power: str | Path | None = None
    curve: Curve = "cauchy"
    scale: float = 1.0
    saturation: float | None = None
    camera: str | Path | None = None


def measured_steps(folder: str | Path, start: Calibration, known: Known) -> Iterator[tuple[str, Calibration]]:
    """Every step whose frames are in a folder of its name, in the order in which they build on each other.

    Args:
        folder: with ``dark``, ``flat``, ``white``, ``linearity``, ``registration``, ``timing``, ``dispersion`` or
            ``shear``, ``psf0`` …, and ``patterns``: what `tmca calibrate capture` or `tmca calibrate render` wrote.
        start: what is built on.
        known: what frames do not say.

    Yields:
        Name of the step, and the calibration after it.

    Raises:
        DataError: a folder without any of them, or see each step.
    """
    place = Path(folder)
    there = [name for name in STEPS if (place / name).is_dir()]
    slots = [k for k in range(len(list(place.glob("psf*")))) if (place / f"psf{k}").is_dir()]
    if not place.is_dir():
        raise DataError(folder, "no such folder", "one with the frames of steps", "check the path")
    if not there and not slots:
        remedy = "take them with tmca calibrate capture, or name one step's folder: tmca calibrate dark FOLDER"
        raise DataError(folder, "no frames of any step", f"folders {', '.join(STEPS)}", remedy)
    found = start
    for name in there:
        found = _MEASURED[name](found, place, known)
        yield name, found
    for slot in slots:
        found = _psf(found, place, slot, known)
        yield f"wavefront{slot}", found


def _told(place: Path, step: str) -> dict[str, Any]:
    """What was kept with the frames of a step, where a bench took them."""
    folder = place / step
    return dict(read_captures(folder)["taken_with"]) if (folder / CAPTURES).is_file() else {}


def _dark(found: Calibration, place: Path, known: Known) -> Calibration:
    return dark_step(found, place / "dark", saturation=known.saturation)


def _flat(found: Calibration, place: Path, known: Known) -> Calibration:
    white = place / "white" if (place / "white").is_dir() else None
    if white is None and _told(place, "flat"):
        remedy = "take them: tmca calibrate capture white"
        raise DataError(place / "white", "no frames", "those of white: even light of a bench is not as bright", remedy)
    told = known.reflectance or _told(place, "white").get("reflectance", 1.0)
    return flat_step(found, place / "flat", white=white, reflectance=float(told), saturation=known.saturation)


def _linearity(found: Calibration, place: Path, known: Known) -> Calibration:
    return linearity_step(found, place / "linearity", saturation=known.saturation)


def _registration(found: Calibration, place: Path, known: Known) -> Calibration:
    told = _told(place, "registration").get("wavelength_nm")
    wave = known.wavelength if known.wavelength or told is None else float(nm_to_metres(told))
    return registration_step(
        found, place / "registration", place / "patterns", wavelength=wave, scale=known.scale,
        saturation=known.saturation,
    )  # fmt: skip


def _timing(found: Calibration, place: Path, known: Known) -> Calibration:
    return timing_step(found, place / "timing", saturation=known.saturation)


def _dispersion(found: Calibration, place: Path, known: Known) -> Calibration:
    stated = place / "source.csv"
    power = known.power or (stated if stated.is_file() else None)
    return dispersion_step(
        found, place / "dispersion", place / "patterns", power=power, curve=known.curve,
        pattern=int(_told(place, "dispersion").get("pattern", 3)),
        saturation=known.saturation,
    )  # fmt: skip


def _shear(found: Calibration, place: Path, known: Known) -> Calibration:
    pattern = int(_told(place, "shear").get("pattern", 3))
    return shear_step(found, place / "shear", place / "patterns", pattern=pattern, saturation=known.saturation)


def _psf(found: Calibration, place: Path, slot: int, known: Known) -> Calibration:
    folder = place / f"psf{slot}"
    if known.camera is None:
        raise DataError(folder, "points, and no camera", "a snapshot file that says its masks", "name it: --snapshot")
    camera = phase_mask_camera(known.camera, slot)
    nominal = camera.codes()[0][slot].detach().double().numpy()
    return psf_step(
        found, folder, camera.bench, slot=slot, nominal=nominal, saturation=known.saturation,
        source=known.camera,
    )  # fmt: skip


_MEASURED: dict[str, Callable[[Calibration, Path, Known], Calibration]] = {
    "dark": _dark, "flat": _flat, "linearity": _linearity, "registration": _registration, "timing": _timing,
    "dispersion": _dispersion, "shear": _shear,
}  # fmt: skip
