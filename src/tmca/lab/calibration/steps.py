"""The steps of a calibration: one table of what each needs, captures and fits, and the way they are measured."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tmca.cameras import Camera
from tmca.errors import DataError
from tmca.lab.calibration import fits, shots
from tmca.lab.calibration.captured import Captured, Fitted, StepSettings
from tmca.lab.calibration.captures import read_captures, taken_with
from tmca.lab.calibration.file import Calibration
from tmca.lab.calibration.parts import kind_of
from tmca.lab.cameras import LAB_CAMERAS, lab_camera
from tmca.lab.display.manifest import exposed_whole
from tmca.lab.quality import quality_of

Acquire = Callable[[Any, dict[str, Any], shots.Asked, int], Iterable[shots.Shot]]


@dataclass(frozen=True)
class Step:
    """One step.

    Args:
        name: of its folder; of ``psf`` there is one per slot, with its number at the end.
        acquire: frames for it: camera, manifest of the export, what is asked, slot → shots.
        fit: what the frames say, by the name of the part; None where the frames are another step's.
        needs: steps that it builds on.
        residual: that says how good it is.
        usual: the largest of it that good captures leave.
        hint: what to look for where it is larger.
    """

    name: str
    acquire: Acquire
    fit: Callable[[Captured], dict[str, Fitted]] | None = None
    needs: tuple[str, ...] = ()
    residual: str = ""
    usual: float = 1.0
    hint: str = ""


STEPS: dict[str, Step] = {step.name: step for step in (
    Step("dark", shots.dark, fits.dark, (), "noise_of_saturation", 0.05),
    Step("flat", shots.flat, fits.flat, ("dark",), "noise_of_light", 0.2),
    Step("white", shots.white),
    Step("linearity", shots.linearity, fits.linearity, ("dark",), "largest_deviation", 0.02),
    Step("registration", shots.registration, fits.registration, (), "residual_of_contrast", 0.2),
    Step("buckets", shots.buckets, fits.buckets, ("dark", "flat"), "residual_of_light", 0.01,
         "are the pages of the buckets exchanged, here or in flat?"),
    Step("timing", shots.timing, fits.timing, ("dark",), "residual_of_a_slot", 0.05),
    Step("dispersion", shots.dispersion, fits.dispersion, ("registration", "dark"),
         "x_residual_pixels", 0.2),
    Step("shear", shots.shear, fits.shear, ("registration", "dark"), "residual_pixels", 0.1),
    Step("psf", shots.psf, fits.psf, ("dark",), "residual", 0.1),
)}  # fmt: skip


def step_of(name: str) -> Step:
    """The step of a folder, ``psf0``, or of a part, ``wavefront0``."""
    return STEPS[kind_of(name).replace("wavefront", "psf")]


def steps_of(camera: Camera, manifest: dict[str, Any]) -> tuple[str, ...]:
    """Steps of a camera behind the devices of an export, in their order.

    One slot has no timing: no other one says when it begins and ends; one bucket shares its light with no other.
    """
    names = [name for name in STEPS if name in lab_camera(camera).steps and not why_without(name, camera, manifest)]
    slots = [f"psf{slot}" for slot in range(camera.slots)]
    return tuple(part for name in names for part in (slots if name == "psf" else [name]))


def why_without(step: str, camera: Camera, manifest: dict[str, Any]) -> str:
    """Why a camera behind the devices of an export has no such step; empty where it may have it."""
    if step == "timing" and camera.slots == 1:
        return "one slot alone has none"
    if step == "timing" and not exposed_whole(manifest):
        return "the sensor does not code this shutter, it is laid on the frames afterwards"
    return "the sensor has one bucket" if step == "buckets" and camera.buckets == 1 else ""


def not_measured(calibration: Calibration, camera: Camera | None = None, whole: bool = True) -> str:
    """Names of steps that a calibration lacks, of the kind of camera where it could be of several; empty if none.

    Args:
        calibration: as far as it is measured.
        camera: whose calibration it is, if that is known.
        whole: whether the sensor codes its shutter in one exposure, and has a timing.
    """
    there = {step_of(name).name for name in calibration.parts}
    kinds = [camera.kind] if camera else [kind for kind, lab in LAB_CAMERAS.items() if there <= lab.steps]
    sensor = calibration.about["camera"].get("sensor") or ()
    coded = whole and calibration.settings("flat").get(fits.WHOLE_EXPOSURES, True)
    possible = {"buckets": len(sensor) == 3, "timing": coded and (camera is None or camera.slots > 1)}
    missing = []
    for name, step in STEPS.items():
        having = [kind for kind in kinds if name in LAB_CAMERAS[kind].steps]
        if step.fit and having and name not in there and possible.get(name, True):
            missing.append(name if having == kinds else f"{name} ({', '.join(having)})")
    return ", ".join(missing)


def measure(name: str, calibration: Calibration, path: str | Path, given: StepSettings | None = None) -> Calibration:
    """A calibration with one more step, whose residuals say its ``quality``, that of the step over what good captures
    leave: above 1 a warning says so.

    Args:
        name: of the step.
        calibration: to build on.
        path: captures.
        given: what they do not say.

    Raises:
        DataError: a step before it is missing, captures that are missing, saturated or dark, or a fit that failed.
        SettingError: an impossible setting.
    """
    step, given, place = step_of(name), given or StepSettings(), Path(path)
    assert step.fit is not None
    for need in step.needs:
        if calibration.part(need) is None:
            remedy = f"run tmca calibrate {need} first, and name its file with --onto"
            raise DataError(calibration.where, f"no {need}", f"one, on which {step.name} builds", remedy)
    sensor = calibration.about["camera"]["sensor"]
    frames = read_captures(path, saturation=given.saturation, may_saturate=name == "linearity", sensor=sensor)
    for part, fitted in step.fit(Captured(frames, place, calibration, given)).items():
        residuals = dict(fitted.residuals)
        if not math.isnan(residuals.get(step.residual, math.nan)):
            left = step.residual.replace("_", " ")
            residuals["quality"] = quality_of(path, left, residuals[step.residual], step.usual, step.hint)
        sources = [path, *(source for source in fitted.sources if source is not None)]
        size = tuple(int(n) for n in frames.values.shape[1:])
        calibration = calibration.with_part(
            part, fitted.part, residuals, sources, sensor=size, codes=fitted.codes, settings=fitted.settings
        )
    return calibration


def _steps_in(folder: str | Path) -> list[str]:
    """The steps whose frames are in a folder, in the order in which they build on each other."""
    slots = sorted(Path(folder).glob("psf*"), key=lambda one: (len(one.name), one.name))
    wanted = [name for name, step in STEPS.items() if step.fit] + [one.name for one in slots]
    there = [name for name in wanted if Path(folder, name).is_dir()]
    if not there:
        remedy = "take them with tmca calibrate capture, or name one step's folder: tmca calibrate dark FOLDER"
        raise DataError(folder, "no frames of any step", f"folders {', '.join(STEPS)}", remedy)
    return there


def measure_all(
    folder: str | Path, start: Calibration, given: StepSettings | None = None
) -> Iterator[tuple[str, Calibration]]:
    """Every step whose frames are in a folder of its name, in the order in which they build on each other.

    Args:
        folder: what `tmca calibrate capture` or `tmca calibrate render` wrote: ``dark``, ``flat``, ``white``, … ,
            ``psf0`` …, ``patterns`` and, of the source's power, ``source.csv``.
        start: what is built on.
        given: what frames do not say, but for patterns, white and slot.

    Yields:
        Name of the part, and the calibration after it.

    Raises:
        DataError: a folder without any of them, or see ``measure``.
    """
    place, given = Path(folder), given or StepSettings()
    if not place.is_dir():
        raise DataError(folder, "no such folder", "one with the frames of steps", "check the path")
    there = _steps_in(folder)
    white, power = place / "white", place / "source.csv"
    if not white.is_dir() and "flat" in there and taken_with(place / "flat"):
        remedy = "take them: tmca calibrate capture white"
        raise DataError(white, "no frames", "those of white: even light of a bench is not as bright", remedy)
    given = replace(
        given, patterns=place / "patterns", white=white if white.is_dir() else None,
        reflectance=given.reflectance or taken_with(white).get("reflectance"),
        power=given.power or (power if power.is_file() else None),
    )  # fmt: skip
    for name in there:
        slot = int(name.removeprefix("psf")) if name.startswith("psf") else 0
        start = measure(name, start, place / name, replace(given, slot=slot))
        yield (f"wavefront{slot}" if name.startswith("psf") else name), start
