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
        wavelength: NM or NM,NM,… of the light, the first that of registration; the camera's bands without, the middle
            one first, where the bench sets its light.
        depth: METRES,METRES,… of the point of psf; three of the camera's planes without, where the bench sets its
            light.
        frames: of dark, flat and white.
        pattern: that dispersion and shear show, counted from 0.
        count: of coded patterns.
        reflectance: of the white reference.
    """
    from tmca.data import nm_to_metres
    from tmca.lab.bench import sets_light, steps_before, usual_frames
    from tmca.lab.calibration.capturing import check_lights
    from tmca.lab.display.manifest import exposed_whole, read_manifest

    bench.check()
    taken = bench.known(export)
    waves = tuple(float(nm_to_metres(one)) for one in _each(wavelength, "--wavelength", 100, 20000, "nm"))
    depths = _each(depth, "--depth", 1e-3, 1e6, "m")
    manifest = read_manifest(export)
    driver = bench.bench(taken, exposed_whole(manifest))
    asked = usual_frames(
        taken.camera, sets_light(driver), frames=frames, wavelengths=waves, depths=depths, pattern=pattern, count=count,
        reflectance=reflectance,
    )  # fmt: skip
    steps, left_out = steps_before(taken.camera, manifest, bench.simulated) if step == "all" else ([step], [])
    _say_light(check_lights(steps, taken.camera, manifest, asked, driver))
    for one in steps:
        _capture_step(one, export, driver, out, taken.camera, asked, bench)
    for line in left_out:
        print(line)
    print(f"measure them with tmca calibrate all {out}{_curve(steps, taken.camera, asked)} --out NAME")


def _say_light(shots: dict[str, Any]) -> None:
    """Say of which wavelength the light of a registration has to be."""
    from tmca.data import metres_to_nm

    if (wave := shots["registration"][0].light.wavelength if "registration" in shots else None) is not None:
        print(f"registration: light of {metres_to_nm(wave):g} nm")


def _capture_step(
    step: str, export: Path, driver: Any, out: Path, camera: Any, asked: Any, bench: BenchOptions
) -> None:
    """Take the frames of a step, and say where they are."""
    from tmca.lab.calibration.capturing import capture_step

    with progress_bar(f"capture: {step}") as report:
        capture_step(
            step, export, driver, out, camera, asked, bench=bench.said(),
            timeout=bench.timeout, progress=lambda done, total, name: report(done / total, name),
        )  # fmt: skip
    print(f"{out / step}: captured")


def _curve(steps: list[str], camera: Any, asked: Any) -> str:
    """Where light of every band was captured no curve has to say what lies between them: bands may lie on none."""
    captured = {round(wave * 1e12) for wave in asked.wavelengths}
    bands = {round(wave * 1e12) for wave in getattr(camera, "wavelengths", ())}
    return " --curve measured" if "dispersion" in steps and bands <= captured else ""


def _each(text: str | None, option: str, low: float, high: float, unit: str) -> tuple[float, ...]:
    """The numbers of an option; none without it."""
    if text is None:
        return ()
    values = numbers(text, option)
    each = tuple(values) if isinstance(values, list) else (values,)
    for one in each:
        check_range(option, one, low, high, unit=unit)
    return each
