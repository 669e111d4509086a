"""``tmca calibrate capture|all``: frames for the steps of a calibration, taken by a bench; all steps measured."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter

from tmca.cli.cameras import Faults
from tmca.cli.lab.bench import AskedBench, known_camera
from tmca.cli.lab.calibrate_words import CalibrationOptions, finished, started
from tmca.cli.options.numbers import MaybeWhole, Whole
from tmca.errors import SettingError
from tmca.specs import Hardware

if TYPE_CHECKING:
    from tmca.lab.calibration.shots import Asked

_BENCH = Group("Simulated bench", sort_key=1)
_USUAL = CalibrationOptions()


def capture(
    step: str,
    export: Path,
    /,
    *,
    out: Path = Path("bench"),
    device: str = "simulated",
    like: Path | None = None,
    wavelength: str | None = None,
    depth: str | None = None,
    frames: Whole = 16,
    pattern: Whole = 3,
    count: Whole = 2,
    reflectance: float = 0.5,
    set_: Annotated[list[str] | None, Parameter(name="--set")] = None,
    timeout: float | None = None,
    bits: Annotated[MaybeWhole, Parameter(group=_BENCH)] = None,
    seed: Annotated[MaybeWhole, Parameter(group=_BENCH)] = None,
    stops_after: Annotated[MaybeWhole, Parameter(group=_BENCH)] = None,
    hardware: Faults = None,
) -> None:
    """Take the frames of STEP on the bench that EXPORT is to be captured on, and say how to measure them.

    STEP is dark, flat, white, linearity, registration, timing, dispersion or shear, of a spectral-depth camera dark or
    psf0, psf1, …; or all, where the bench sets its light itself. Patterns lie on the devices as the codes of EXPORT do.
    A step that was stopped goes on.

    Args:
        step: dark, flat, white, linearity, registration, timing, dispersion, shear, psf0 …, or all.
        export: folder of `tmca export`.
        out: folder of all steps; one folder each, and the patterns that were shown.
        device: simulated, or the name of a driver (entry points tmca.devices).
        like: snapshot file whose camera this is; that of the export where it was made from a snapshot.
        wavelength: NM or NM,NM,… of the light; a simulated spectral camera's bands without.
        depth: METRES,METRES,… of the point of psf; three planes of a simulated camera without.
        frames: of dark, flat and white.
        pattern: that dispersion and shear show, counted from 0.
        count: of coded patterns.
        reflectance: of the white reference.
        set_: NAME=VALUE settings of a driver.
        timeout: seconds that a driver has for each answer, 0 for no limit; 30 s or three exposures without.
        bits: of the simulated bench's digital numbers, 16 without.
        seed: of its noise and faults, 0 without.
        stops_after: frames after which it does not answer any more.
    """
    from tmca.lab.calibration.capturing import refuse_recorded
    from tmca.lab.calibration.shots import Asked
    from tmca.lab.calibration.steps import steps_of
    from tmca.lab.display.manifest import exposed_whole, read_manifest

    if device == "folder":
        refuse_recorded(device)
    taken = known_camera(export, like)
    asked = AskedBench(device, set_ or [], bits, seed, stops_after, Hardware.read(hardware), None, timeout)
    waves = _wavelengths(wavelength, taken.camera, device)
    wanted = Asked(frames, waves, _depths(depth, taken.camera, device), pattern, count, reflectance)
    manifest = read_manifest(export)
    steps, whole = steps_of(taken.camera, manifest), exposed_whole(manifest)
    for one in _all(steps, device, taken.camera, whole) if step == "all" else (step,):
        bench = asked.bench(taken, whole)
        _captured(one, export, bench, out, taken.camera, wanted, asked)
        print(_next(one, out, wanted))


def _all(steps: tuple[str, ...], device: str, camera: Any, whole: bool) -> list[str]:
    """All steps; a simulated sensor without shot noise has no electrons to count, and one slot no timing."""
    silent = device == "simulated" and camera.sensor.full_well is None
    if silent:
        print("linearity: left out, the simulated sensor has no shot noise (tmca simulate … --full-well)")
    if camera.slots == 1 and whole and "registration" in steps:
        print("timing: left out, one slot alone has none")
    return [one for one in steps if not (silent and one == "linearity")]


def measured(
    folder: Path,
    /,
    *,
    wavelength: float | None = None,
    reflectance: float | None = None,
    power: Path | None = None,
    curve: Literal["cauchy", "polynomial", "measured"] = "cauchy",
    scale: float = 1.0,
    snapshot: Path | None = None,
    how: CalibrationOptions = _USUAL,
) -> None:
    """Measure every step whose frames are in FOLDER, in their order: what capture and render write.

    Args:
        folder: with folders dark, flat, white, linearity, registration, timing, dispersion, shear, psf0 …, patterns.
        wavelength: of the registration, nm; what capture took says it.
        reflectance: of the white reference; what capture took says it, else 1.
        power: text file of the source: wavelength in nm, power; FOLDER/source.csv where it is there.
        curve: of the dispersion: powers of 1/λ² (cauchy) or of λ (polynomial), or none (measured).
        scale: sensor pixels per mask pixel, to 6 %.
        snapshot: a snapshot file of the camera, for points before a spectral-depth camera (psf0, …).
    """
    from tmca.data import nm_to_metres
    from tmca.lab.calibration.fits import StepSettings
    from tmca.lab.calibration.steps import measure_all

    waves = _parsed(f"{wavelength:g}") if wavelength is not None else ()
    metres = float(nm_to_metres(waves[0])) if waves else None
    given = StepSettings(
        reflectance=reflectance, wavelength=metres, scale=scale, power=power, curve=curve, camera=snapshot,
        saturation=how.saturation,
    )  # fmt: skip
    for step, calibration in measure_all(folder, started(how), given):
        finished(calibration, step, how)


def _wavelengths(text: str | None, camera: Any, device: str) -> tuple[float, ...]:
    """Metres; of a simulated bench without a choice those of its camera."""
    from tmca.data import nm_to_metres
    from tmca.lab.cameras import lab_camera

    if text is None:
        return tuple(lab_camera(camera).wavelengths(camera)) if device == "simulated" else ()
    return tuple(float(nm_to_metres(one)) for one in _parsed(text))


def _depths(text: str | None, camera: Any, device: str) -> tuple[float, ...]:
    """Metres; of a simulated bench without a choice those of its camera."""
    from tmca.lab.cameras import lab_camera

    if text is None:
        return tuple(lab_camera(camera).depths(camera)) if device == "simulated" else ()
    try:
        metres = [float(part) for part in text.split(",")]
    except ValueError:
        metres = [0.0]
    if not all(0 < one < inf for one in metres):
        raise SettingError("--depth", repr(text), "metres above 0, METRES,METRES")
    return tuple(metres)


def _parsed(text: str) -> list[float]:
    """Nanometres of NM,NM,…"""
    try:
        nanometres = [float(part) for part in text.split(",")]
    except ValueError:
        nanometres = [0.0]
    if not all(100 <= one <= 20000 for one in nanometres):
        raise SettingError("--wavelength", repr(text), "nanometres of light, 100 to 20000, NM or NM,NM")
    return nanometres


def _captured(step: str, export: Path, bench: Any, out: Path, camera: Any, wanted: Asked, asked: AskedBench) -> None:
    from tmca.cli.progress import progress_bar
    from tmca.lab.calibration.capturing import capture_step

    with progress_bar(f"capture: {step}") as report:
        capture_step(
            step, export, bench, out, camera, wanted, bench=asked.said(), timeout=asked.timeout,
            progress=lambda done, total, name: report(done / total, name),
        )  # fmt: skip


def _next(step: str, out: Path, asked: Asked) -> str:
    """The command that measures what was taken."""
    from tmca.data import metres_to_nm

    shown, place = f"--patterns {out / 'patterns'}", out / step
    if step == "white":
        return f"{place}: for tmca calibrate flat {out / 'flat'} --white {place} --reflectance {asked.reflectance:g}"
    if step.startswith("psf"):
        slot = step.removeprefix("psf")
        return f"{place}: measure it with tmca calibrate psf {place} --slot {slot} --snapshot CAMERA.nc --onto NAME"
    wave = f" --wavelength {metres_to_nm(asked.wavelengths[0]):g}" if asked.wavelengths else ""
    options = {
        "flat": f" --white {out / 'white'} --reflectance {asked.reflectance:g}",
        "registration": f" {shown}{wave}",
        "dispersion": f" {shown} --pattern {asked.pattern}",
        "shear": f" {shown} --pattern {asked.pattern}",
    }.get(step, "")
    return f"{place}: measure it with tmca calibrate {step} {place}{options} --onto NAME"
