"""``tmca calibrate capture``: frames for the steps of a calibration, taken by a bench."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tmca.cli.lab.bench import BenchOptions
from tmca.cli.options.numbers import Whole, numbers
from tmca.errors import check_range
from tmca.progress import progress_bar

_BENCH = BenchOptions()


def capture(
    step: str,
    export: Path,
    /,
    *,
    out: Path = Path("bench"),
    wavelength: str | None = None,
    depth: str | None = None,
    frames: Whole = 16,
    pattern: Whole = 3,
    count: Whole = 2,
    reflectance: float = 0.5,
    bench: BenchOptions = _BENCH,
) -> None:
    """Take the frames of STEP on the bench that EXPORT is to be captured on, and say how to measure them.

    STEP is dark, flat, white, linearity, registration, buckets, timing, dispersion or shear, of a spectral-depth camera
    dark or psf0, psf1, …; or all, where the bench sets its light itself. Patterns lie on the devices as the codes of
    EXPORT do. A step that was stopped goes on.

    Args:
        step: dark, flat, white, linearity, registration, buckets, timing, dispersion, shear, psf0 …, or all.
        export: folder of `tmca export`.
        out: folder of all steps; one folder each, and the patterns that were shown.
        wavelength: NM or NM,NM,… of the light; a simulated spectral camera's bands without.
        depth: METRES,METRES,… of the point of psf; three planes of a simulated camera without.
        frames: of dark, flat and white.
        pattern: that dispersion and shear show, counted from 0.
        count: of coded patterns.
        reflectance: of the white reference.
    """
    from tmca.data import nm_to_metres
    from tmca.lab.calibration.capturing import capture_step
    from tmca.lab.calibration.shots import Asked
    from tmca.lab.calibration.steps import steps_of
    from tmca.lab.cameras import lab_camera
    from tmca.lab.display.manifest import exposed_whole, read_manifest

    bench.check()
    taken = bench.known(export)
    waves = tuple(float(nm_to_metres(one)) for one in _each(wavelength, "--wavelength", 100, 20000, "nm"))
    depths = _each(depth, "--depth", 1e-3, 1e6, "m")
    if bench.simulated:
        lab = lab_camera(taken.camera)
        waves, depths = waves or tuple(lab.wavelengths(taken.camera)), depths or tuple(lab.depths(taken.camera))
    asked = Asked(frames, waves, depths, pattern, count, reflectance)
    manifest = read_manifest(export)
    steps, whole = steps_of(taken.camera, manifest), exposed_whole(manifest)
    for one in _all(steps, bench.simulated, taken.camera, whole) if step == "all" else (step,):
        with progress_bar(f"capture: {one}") as report:
            capture_step(
                one, export, bench.bench(taken, whole), out, taken.camera, asked, bench=bench.said(),
                timeout=bench.timeout, progress=lambda done, total, name: report(done / total, name),
            )  # fmt: skip
        print(f"{out / one}: measure it with tmca calibrate all {out} --out NAME")


def _all(steps: tuple[str, ...], simulated: bool, camera: Any, whole: bool) -> list[str]:
    """All steps; a simulated sensor without shot noise has no electrons to count, and one slot no timing."""
    silent = simulated and camera.sensor.full_well is None
    if silent:
        print("linearity: left out, the simulated sensor has no shot noise (tmca simulate … --full-well)")
    if camera.slots == 1 and whole and "registration" in steps:
        print("timing: left out, one slot alone has none")
    return [one for one in steps if not (silent and one == "linearity")]


def _each(text: str | None, option: str, low: float, high: float, unit: str) -> tuple[float, ...]:
    """The numbers of an option; none without it."""
    if text is None:
        return ()
    values = numbers(text, option)
    each = tuple(values) if isinstance(values, list) else (values,)
    for one in each:
        check_range(option, one, low, high, unit=unit)
    return each
