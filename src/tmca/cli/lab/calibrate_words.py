"""What ``tmca calibrate`` shares among its steps, and what it says in words."""

from __future__ import annotations

import json as json_module
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from tmca.cli.options.numbers import On

if TYPE_CHECKING:
    from tmca.lab.calibration.file import Calibration

_OUTPUT = Group("Calibration", sort_key=3)

GUIDE = """A calibration is measured step by step; each writes a new dated file and builds on the one named by --onto.
NAME stands for your camera; --onto NAME takes the newest file NAME_….nc.

  a spectral or light-field camera on a bench with a driver (docs/devices.md), or on the simulated one
       tmca calibrate capture all patterns --out bench               frames of every step; patterns: tmca export
       tmca calibrate all bench --out NAME                           every step below

  every camera
    0  tmca calibrate patterns shown --device 64x80                  what to show on the mask
    1  tmca calibrate dark dark --out NAME                           lens covered, 16 frames
    2  tmca calibrate flat flat --white white --onto NAME            even light; then white, everything held open
    3  tmca calibrate linearity linearity --onto NAME                even light, 6 exposures or more, 2 frames each
  spectral and light-field cameras
    4  tmca calibrate registration registration --patterns shown --wavelength 550 --onto NAME
                                                                     every pattern, one colour (middle view open)
    5  tmca calibrate timing timing --onto NAME                      one slot of aperture and shutter open each
  spectral camera
    6  tmca calibrate dispersion dispersion --patterns shown --power source.csv --onto NAME
                                                                     pattern 3, wavelength by wavelength
  light-field camera
    6  tmca calibrate shear shear --patterns shown --onto NAME       pattern 3, one view open each
  spectral-depth camera
    4  tmca calibrate psf psf0 --slot 0 --snapshot snapshot.nc --onto NAME
                                                                     a point, 2 depths or more, each slot's mask
  then
       tmca calibrate show NAME
       tmca reconstruct snapshot.nc --calibration NAME

Without a bench: tmca calibrate render bench writes all these captures. Details: docs/calibration.md"""


@Parameter(name="*")
@dataclass(frozen=True)
class CalibrationOptions:
    """What a step builds on, and where it writes."""

    onto: Annotated[Path | None, Parameter(group=_OUTPUT)] = None
    "Calibration to build on: a file, or its name without the date for the newest."
    out: Annotated[Path | None, Parameter(group=_OUTPUT)] = None
    "Name of the new files, to which the date is added; that of --onto without it."
    camera: Annotated[str | None, Parameter(group=_OUTPUT)] = None
    "Name of the camera, kept in the file; that of --onto, or of --out, without it."
    saturation: Annotated[float | None, Parameter(group=_OUTPUT)] = None
    "Value from which on a pixel is saturated; an integer type's maximum without it."
    figures: Annotated[On, Parameter(group=_OUTPUT)] = True
    "Write a picture beside the file."
    json: Annotated[bool, Parameter(group=_OUTPUT, negative="")] = False
    "Print JSON instead of text."

    @property
    def prefix(self) -> Path:
        """What the new files are called before their date."""
        return self.out or self.onto or Path("calibration")


def started(how: CalibrationOptions) -> Calibration:
    """The calibration that a step builds on.

    Raises:
        DataError: that is none, or of a camera of another name.
    """
    from tmca.data import check_target
    from tmca.errors import DataError
    from tmca.lab.calibration.file import Calibration, load_calibration

    check_target(how.prefix.with_name(f"{how.prefix.name}_date.nc"), overwrite=True)
    if how.onto is None:
        return Calibration.empty(how.camera or how.prefix.name)
    calibration = load_calibration(how.onto)
    name = calibration.about["camera"]["name"]
    if how.camera is not None and how.camera != name:
        remedy = "build on a calibration of this camera, or start a new one without --onto"
        raise DataError(calibration.where, f"a calibration of camera {name}", f"one of {how.camera}", remedy)
    return calibration


def finished(calibration: Calibration, part: str, how: CalibrationOptions) -> None:
    """Save, draw and say what a step measured."""
    from tmca.lab.calibration.steps import part_figure
    from tmca.plots.style import save_figure

    saved = calibration.save(how.prefix)
    if how.figures and saved.path is not None:
        save_figure(part_figure(saved, part, saved.path.stem), saved.path.with_suffix(".png"))
    residuals = saved.about["steps"][part]["residuals"]
    if how.json:
        print(json_module.dumps({"calibration": str(saved.path), "step": part, **plain_numbers(residuals)}, indent=1))
        return
    print(f"{saved.path}: {part}")
    _said(residuals)


def plain_numbers(values: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers as JSON holds them: not a number is null."""
    from tmca.data import plain

    return dict(plain(values))


def _said(residuals: Mapping[str, Any]) -> None:
    for name, value in residuals.items():
        shown = "not known" if value is None or value != value else f"{value:.5g}"
        print(f"  {name.replace('_', ' '):<32} {shown}")


def said_all(calibration: Calibration, json: bool) -> None:
    """Everything that the JSON file of a calibration says."""
    about = calibration.about
    if json:
        print(json_module.dumps({"calibration": str(calibration.path), **about}, indent=1))
        return
    camera = about["camera"]
    sizes = [f"{what} {'×'.join(map(str, camera[what]))}" for what in ("sensor", "codes") if camera[what]]
    print(f"{calibration.path}: camera {camera['name']}, {', '.join(sizes)}, written {about['created']}")
    for name, step in about["steps"].items():
        print(f"{name} (measured {step['measured']} from {', '.join(one['path'] for one in step['sources'])})")
        _said(step["residuals"])


def said_proof(results: Mapping[str, Any], json: bool) -> None:
    """A line per quantity with its bound, then the reconstructions."""
    if json:
        print(json_module.dumps(plain_numbers(results), indent=1))
        return
    print(f"{'worst of ' + str(results['seeds']) + ' benches':<44} {'error':>10} {'bound':>8}")
    for row in results["errors"]:
        bound = "" if row["bound"] is None else f"{row['bound']:g}"
        mark = "" if row["bound"] is None or row["error"] <= row["bound"] else "  missed"
        print(f"{row['quantity'] + ' (' + row['unit'] + ')':<44} {row['error']:>10.4g} {bound:>8}{mark}")
    print(f"\n{'camera':<16}{'operator':<30} {'PSNR (dB)':>10} {'snapshot explained (dB)':>25}")
    for row in results["reconstruction"]:
        psnr = "" if row["psnr"] is None else f"{row['psnr']:.2f}"
        print(f"{row['camera']:<16}{row['operator']:<30} {psnr:>10} {row['explained']:>25.1f}")
