"""``tmca calibrate``: from captures to a dated calibration of a coded camera."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from cyclopts import App

from tmca.cli.lab.calibrate_steps import missing_lines, residual_lines, step_commands
from tmca.cli.options.numbers import Whole
from tmca.cli.options.numbers import size as parsed_size
from tmca.cli.options.output import Figure, Json, Overwrite, check_figure, check_targets, say

app = App(name="calibrate", help="From captures to a dated calibration; without a step, the order of the steps.")
for _name, _command in step_commands():
    app.command(_command, name=_name)
app.command(
    "tmca.cli.lab.calibrate_capture:capture", name="capture", help="Frames for a step, taken by a device or simulated."
)


_GUIDE = """A calibration is measured step by step; each writes a new dated file and builds on the one named by --onto.
NAME stands for your camera; --onto NAME takes the newest file NAME_….nc.

  on a bench with a driver (docs/devices.md), or on the simulated one
       tmca calibrate capture all patterns --out bench               frames of every step; patterns: tmca export
       tmca calibrate all bench --out NAME                           every step below

  from captures of other software; all cameras
    0  tmca calibrate patterns shown --device 64x80                  what to show on the mask
    1  tmca calibrate dark dark --out NAME                           lens covered, 16 frames
    2  tmca calibrate flat flat --white white --onto NAME            even light; then white, everything held open
    3  tmca calibrate linearity linearity --onto NAME                even light, 6 exposures or more, 2 frames each
  spectral and light-field cameras
    4  tmca calibrate registration registration --patterns shown --wavelength 550 --onto NAME
    5  tmca calibrate buckets buckets --onto NAME                    sensors with several buckets: even light in each
       tmca calibrate timing timing --onto NAME                      one slot of aperture and shutter open each
    6  tmca calibrate dispersion dispersion --patterns shown --power source.csv --onto NAME
       tmca calibrate shear shear --patterns shown --onto NAME       pattern 3, by wavelengths; or one view open each
  spectral-depth camera
    4  tmca calibrate psf psf0 --slot 0 --snapshot snapshot.nc --onto NAME

  then tmca calibrate show NAME, and tmca reconstruct snapshot.nc --calibration NAME

Without a bench: tmca calibrate render bench writes all these captures. Details: docs/calibration.md"""


@app.default
def guide() -> None:
    """Print the order of the steps, and what to capture for each."""
    print(_GUIDE)


@app.command
def patterns(
    folder: Path, /, *, device: str = "64x80", count: Whole = 2, seed: Whole = 0, overwrite: Overwrite = False
) -> None:
    """Write the patterns to show into FOLDER: open, dark and random ones, a PNG each.

    Args:
        folder: to make.
        device: HEIGHTxWIDTH of the mask, pixels.
        count: of random patterns.
        seed: of them.
    """
    from tmca.lab.calibration.captures import write_patterns

    names = write_patterns(folder, parsed_size(device, "--device") or (64, 80), count, seed, overwrite=overwrite)
    print(f"{folder}: {', '.join(names)}")


@app.command
def render(
    folder: Path,
    /,
    *,
    camera: Literal["spectral", "light-field", "spectral-depth"] = "spectral",
    size: str = "64x80",
    slots: Whole = 4,
    snr: float = 40.0,
    seed: Whole = 0,
    overwrite: Overwrite = False,
) -> None:
    """Write a rendered bench into FOLDER: captures for every step, a raw snapshot, and the hidden truth.

    Args:
        folder: to make.
        camera: which one.
        size: HEIGHTxWIDTH of its scene, pixels.
        slots: of its codes.
        snr: of captures of patterns and points, dB.
        seed: of the truth, the codes and the noise.
    """
    from tmca.cli.studies import study_module
    from tmca.data import check_target

    check_target(folder, overwrite)
    asked = parsed_size(size) or (64, 80)
    rendered = study_module("rendered_bench")
    rendered.write_bench(folder, camera=camera, size=asked, slots=slots, snr_db=snr, seed=seed, overwrite=overwrite)
    print(f"{folder}: {', '.join(sorted(entry.name for entry in folder.iterdir()))}")


@app.command
def show(calibration: Path, /, *, json: Json = False) -> None:
    """Say what CALIBRATION holds: of which camera, when measured, with which residuals, from what.

    Args:
        calibration: file, or its name without the date for the newest.
    """
    from tmca.lab.calibration.file import load_calibration
    from tmca.lab.calibration.steps import not_measured

    found = load_calibration(calibration)
    about = found.about
    camera = about["camera"]
    sizes = [f"{what} {'×'.join(map(str, camera[what]))}" for what in ("sensor", "codes") if camera[what]]
    lines = [f"{found.path}: camera {camera['name']}, {', '.join(sizes)}, written {about['created']}"]
    for name, step in about["steps"].items():
        lines.append(f"{name} (measured {step['measured']} from {', '.join(one['path'] for one in step['sources'])})")
        lines += residual_lines(step["residuals"])
    missing = not_measured(found)
    say({"calibration": str(found.path), **about, "not_measured": missing}, json, *lines, *missing_lines(missing))


@app.command
def proof(
    *,
    seeds: Whole = 1,
    size: str = "64x80",
    snr: float = 40.0,
    out: Path | None = None,
    figure: Figure = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Calibrate rendered benches from their captures alone, and hold what was found against their hidden truth.

    Args:
        seeds: benches of each camera, from seed 0.
        size: HEIGHTxWIDTH of the scenes, pixels.
        snr: of the captures, dB.
        out: JSON file of the results.
    """
    from tmca.cli.studies import study_module
    from tmca.data import plain, write_json
    from tmca.plots.style import save_figure

    check_figure(figure, overwrite)
    check_targets([] if out is None else [out], overwrite)
    proofs = study_module("calibration_proof")
    results = proofs.prove(seeds, parsed_size(size) or (64, 80), snr)
    if out is not None:
        write_json(results.stated(), out, overwrite=overwrite)
    if figure is not None:
        save_figure(proofs.reconstructions_figure(results), figure, overwrite=overwrite)
    say(plain(results.stated()), json, proofs.table_of(results.stated()))
