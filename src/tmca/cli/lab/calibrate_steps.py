"""``tmca calibrate dark|flat|…|psf|all``: from the captures of steps to new dated files."""

from __future__ import annotations

import inspect
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter

from tmca.cli.options.numbers import On, Whole, size
from tmca.cli.options.output import say

if TYPE_CHECKING:
    from tmca.lab.calibration.captured import StepSettings
    from tmca.lab.calibration.file import Calibration

_REQUIRED: Any = inspect.Parameter.empty
_OUTPUT = Group("Calibration", sort_key=3)
Curve = Literal["cauchy", "polynomial", "measured"]


@Parameter(name="*", group=_OUTPUT)
@dataclass(frozen=True)
class CalibrationOptions:
    """What a step builds on, and where it writes."""

    onto: Path | None = None
    "Calibration to build on: a file, or its name without the date for the newest."
    out: Path | None = None
    "Name of the new files, to which the date is added; that of --onto without it."
    camera: str | None = None
    "Name of the camera, kept in the file; that of --onto, or of --out, without it."
    saturation: float | None = None
    "Value from which on a pixel is saturated; an integer type's maximum without it."
    figures: On = True
    "Write a picture beside the file."
    json: Annotated[bool, Parameter(negative="")] = False
    "Print JSON instead of text."

    @property
    def prefix(self) -> Path:
        """What the new files are called before their date."""
        return self.out or self.onto or Path("calibration")

    def started(self) -> Calibration:
        """The calibration that a step builds on.

        Raises:
            DataError: that is none, or of a camera of another name.
        """
        from tmca.data import check_target
        from tmca.errors import DataError
        from tmca.lab.calibration.file import Calibration, load_calibration

        check_target(self.prefix.with_name(f"{self.prefix.name}_date.nc"), overwrite=True)
        if self.onto is None:
            return Calibration.empty(self.camera or self.prefix.name)
        calibration = load_calibration(self.onto)
        name = calibration.about["camera"]["name"]
        if self.camera is not None and self.camera != name:
            remedy = "build on a calibration of this camera, or start a new one without --onto"
            raise DataError(calibration.where, f"a calibration of camera {name}", f"one of {self.camera}", remedy)
        return calibration

    def finished(self, calibration: Calibration, part: str) -> None:
        """Save, draw and say what a step measured."""
        from tmca.data import plain
        from tmca.lab.calibration.figures import part_figure
        from tmca.plots.style import save_figure

        saved = calibration.save(self.prefix)
        if self.figures and saved.path is not None:
            save_figure(part_figure(saved.parts, part, saved.path.stem), saved.path.with_suffix(".png"))
        residuals = saved.about["steps"][part]["residuals"]
        about = {"calibration": str(saved.path), "step": part, **plain(residuals)}
        say(about, self.json, f"{saved.path}: {part}", *residual_lines(residuals))


_USUAL = CalibrationOptions()


def residual_lines(residuals: Mapping[str, Any]) -> list[str]:
    """A line for each."""
    through = dict.fromkeys(("x_residual_pixels", "y_residual_pixels"), "none: lines through all points")
    shown = {
        name: through.get(name, "not known") if value is None or not math.isfinite(value) else f"{value:.5g}"
        for name, value in residuals.items()
    }
    return [f"  {name.replace('_', ' '):<32} {value}" for name, value in shown.items()]


def missing_lines(missing: str) -> list[str]:
    """What is said of steps that a calibration lacks; nothing where there are none."""
    return [f"not measured: {missing}; what was drawn is used"] if missing else []


def _settings(how: CalibrationOptions, **given: Any) -> StepSettings:
    """What options of steps say, in SI units."""
    from tmca.data import nm_to_metres
    from tmca.errors import check_range
    from tmca.lab.calibration.captured import StepSettings

    if given.get("wavelength") is not None:
        check_range("--wavelength", given["wavelength"], 100, 20000, unit="nm")
        given["wavelength"] = float(nm_to_metres(given["wavelength"]))
    if "device" in given:
        given["device"] = size(given["device"], "--device")
    return StepSettings(saturation=how.saturation, **given)


_OPTIONS: dict[str, tuple[Any, Any, str]] = {
    "white": (Path | None, None, "frames of a white scene, mask and shutter held open for a snapshot's exposure."),
    "reflectance": (float, 1.0, "of that scene: 0.5 of a grey reference, which does not saturate."),
    "patterns": (Path, _REQUIRED, "that were shown, for a registration an open and a dark one among them."),
    "pattern": (Whole, 3, "which of them was shown, counted from 0."),
    "wavelength": (float | None, None, "of the light, nm; needed before a disperser; what capture took says it."),
    "scale": (float, 1.0, "sensor pixels per mask pixel, to 6 %."),
    "device": (str | None, None, "HEIGHTxWIDTH of the mask, refused if the patterns differ."),
    "power": (Path | None, None, "text file of the source: wavelength in nm, power."),
    "curve": (Curve, "cauchy", "powers of 1/λ² (cauchy) or λ (polynomial); or straight lines between (measured)."),
    "order": (Whole, 3, "highest power."),
    "snapshot": (Path, _REQUIRED, "a snapshot file of the camera: its bench, and the heights that were asked for."),
    "slot": (Whole, 0, "whose mask was shown, counted from 0."),
}
"""Option of a step → its type, default and help."""
_OF_ALL: dict[str, tuple[Any, Any, str]] = {
    "wavelength": (float | None, None, "of the registration, nm; what capture took says it."),
    "reflectance": (float | None, None, "of the white reference; what capture took says it, else 1."),
    "power": (Path | None, None, "text file of the source: nm, power; FOLDER/source.csv where it is there."),
    "snapshot": (Path | None, None, "a snapshot file of the camera, for points before a spectral-depth one (psf0, …)."),
}
"""The same where all steps are measured."""
_COMMANDS = {
    "all": ("wavelength reflectance power curve scale snapshot",
        "Measure every step whose frames are in FOLDER, in their order: what capture and render write.",
        "with folders dark, flat, white, linearity, registration, buckets, timing, dispersion, shear, psf0 …, "
        "patterns."),
    "dark": ("", "Offset, read noise and hot pixels, from CAPTURES without light.",
        "folder of frames (PNG, TIFF, NPY) or a stack; two or more, exposed like the others."),
    "flat": ("white reflectance", "Response of every pixel, from CAPTURES of even light; the level of white.",
        "folder or stack of frames of even light, two or more."),
    "linearity": ("", "Linearity, saturation and electrons per digital number, from CAPTURES of even light.",
        "folder of frames named by their exposure, such as even_5ms_0; two or more at each."),
    "registration": ("patterns wavelength scale device",
        "Where mask pixels fall on the sensor, and what closed ones pass, from CAPTURES of patterns.",
        "folder or stack, in the order of the patterns."),
    "dispersion": ("patterns pattern power curve order",
        "Displacement and response of every wavelength, from monochromatic CAPTURES of one pattern.",
        "folder of frames named by their wavelength, such as band_450nm, exposed alike."),
    "shear": ("patterns pattern",
        "Pixels per view, and the light of views, from CAPTURES of one pattern with one view open each.",
        "folder of frames named by their view, such as view_-1_2 (row, column from the middle)."),
    "buckets": ("", "Leakage between the buckets of a pixel, and the time of a change, from CAPTURES of even light.",
        "folder of frames with a page for each bucket: bucket_0_0 (all slots in the first), …, in_turn_4_0 (one of "
        "four slots in each after the other)."),
    "timing": ("",
        "Delay, duration and leakage of the shutter's slots, from CAPTURES with one slot of both devices open each.",
        "folder of frames named by their slots, such as aperture_0_shutter_1."),
    "psf": ("snapshot slot",
        "Point spread functions and the wavefront of the mask of one slot, from CAPTURES of a point source.",
        "folder of frames named by depth and wavelength, such as point_0.6m_550nm."),
}  # fmt: skip
"""Step → its options, what it measures, its captures."""


def step_commands() -> Iterator[tuple[str, Callable[..., None]]]:
    """Name of every step and of all, and the function of ``tmca calibrate NAME``."""
    place, option = inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.KEYWORD_ONLY
    for step, (names, text, captures) in _COMMANDS.items():
        known = _OPTIONS | _OF_ALL if step == "all" else _OPTIONS
        options, where = {name: known[name] for name in names.split()}, "folder" if step == "all" else "captures"
        parameters = [inspect.Parameter(where, place, annotation=Path)]
        for name, (kind, default, _) in (options | {"how": (CalibrationOptions, _USUAL, "")}).items():
            parameters.append(inspect.Parameter(name, option, annotation=kind, default=default))
        helps = {where: captures} | {name: about for name, (_, _, about) in options.items()}
        command = _command(step)
        command.__doc__ = "\n    ".join([f"{text}\n\nArgs:", *(f"{name}: {about}" for name, about in helps.items())])
        command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        yield step, command


def _command(step: str) -> Callable[..., None]:
    def command(captures: Path, /, *, how: CalibrationOptions = _USUAL, **given: Any) -> None:
        from tmca.lab.calibration.steps import measure, measure_all, not_measured

        start, asked = how.started(), _settings(how, **given)
        if step == "all":
            whole = start
            for part, whole in measure_all(captures, start, asked):
                how.finished(whole, part)
            for line in missing_lines(not_measured(whole)):
                print(line, file=sys.stderr if how.json else sys.stdout)
        else:
            part = f"wavefront{asked.slot}" if step == "psf" else step
            how.finished(measure(step, start, captures, asked), part)

    return command
