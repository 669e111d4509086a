"""``tmca design``: which codes to use with a given sensor, before anything is built."""

from __future__ import annotations

import json as json_module
import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from tmca.cli.options.bench import BenchOptions
from tmca.cli.options.light_field import LightFieldsOptions
from tmca.cli.options.mask_search import MaskCameraOptions, MaskSearchOptions
from tmca.cli.options.numbers import Whole
from tmca.cli.options.scenes import SceneOptions
from tmca.cli.options.sheets import SearchOptions, SheetOptions, whole_numbers
from tmca.cli.progress import cell_done

app = App(name="design", help="Find codes for a sensor, and say what they gain before anything is built.")
_SCENE, _SHEET, _SEARCH = SceneOptions(), SheetOptions(), SearchOptions()
_VIEWS, _BENCH, _MASKS = LightFieldsOptions(), MaskCameraOptions(), MaskSearchOptions()
_OPTICS = BenchOptions()


@app.command
def spectral(
    *scenes: str,
    out: Path = Path("tmca-design"),
    sensor: SheetOptions = _SHEET,
    bands: Whole = 12,
    dispersion: str | None = None,
    disperser: str | None = None,
    period: Whole = 32,
    search: SearchOptions = _SEARCH,
    reading: SceneOptions = _SCENE,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Recommend the number of slots and the codes of a spectral camera for a sensor and SCENES like those to come.

    Writes into --out: design.html (start there), design.json, the codes as aperture.tif and shutter.tif (0 and 255, a
    page per slot, one period) and together as codes.nc.

    Args:
        scenes: cubes or rendered scenes to design for, two at least to judge the gain; the rendered ones without any.
        out: folder of the results.
        bands: nearest to even spacing from 400 to 700 nm.
        dispersion: pixels per band, or the displacement of every band separated by commas. [default: 1]
        disperser: single or dual. [default: single]
        period: tile of the codes, pixels.
        json: print JSON instead of text.
    """
    from tmca.cli.options.numbers import numbers
    from tmca.cli.progress import progress_bar
    from tmca.reports.cameras import design_spectral

    camera: dict[str, Any] = {} if disperser is None else {"disperser": disperser}
    if dispersion is not None:
        camera["dispersion"] = numbers(dispersion, "--dispersion")
    sheet, named = sensor.sheet(), search.scenes(scenes)
    with progress_bar(f"design {out.name}") as progress:
        _, found = design_spectral(
            sheet, out, scenes=named, bands=bands, reading=reading.reading(), camera=camera, period=period,
            progress=progress, **search.search(),
        )  # fmt: skip
    _say(found, out, json)


@app.command
def light_field(
    *scenes: str,
    out: Path = Path("tmca-design"),
    sensor: SheetOptions = _SHEET,
    reading: LightFieldsOptions = _VIEWS,
    shear: str | None = None,
    period: Whole = 16,
    search: SearchOptions = _SEARCH,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Recommend the number of slots and the codes of a light-field camera for a sensor and SCENES like those to come.

    Writes into --out what `tmca design spectral` writes.

    Args:
        scenes: light fields to design for, two at least to judge the gain; the rendered ones without any.
        out: folder of the results.
        shear: mask pixels per view, one number or ALONG_Y,ALONG_X. [default: 1]
        period: tile of the codes, pixels.
        json: print JSON instead of text.
    """
    from tmca.cli.options.cameras import shear_argument
    from tmca.cli.progress import progress_bar
    from tmca.reports.cameras import design_light_field

    sheet, named = sensor.sheet(), search.scenes(scenes)
    with progress_bar(f"design {out.name}") as progress:
        _, found = design_light_field(
            sheet, out, scenes=named, views=reading.views, reading=reading.asked(), period=period, progress=progress,
            camera={} if shear is None else {"shear": shear_argument(shear)}, **search.search(),
        )  # fmt: skip
    _say(found, out, json)


@app.command
def spectral_depth(
    *scenes: str,
    out: Path = Path("tmca-design"),
    sensor: SheetOptions = _SHEET,
    camera: MaskCameraOptions = _BENCH,
    bench: BenchOptions = _OPTICS,
    search: MaskSearchOptions = _MASKS,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Recommend the number of slots and the phase masks that tell depths apart best, for a sensor and a bench.

    Writes into --out: design.html (start there), design.json, the recommended masks with shutter and filters as
    codes.nc, those of every number of slots as codes_kK.nc, and pictures.

    Args:
        scenes: cubes or rendered scenes whose patches the scenes to come are like; the rendered ones without any.
        out: folder of the results.
        json: print JSON instead of text.
    """
    from tmca.cli.progress import progress_bar
    from tmca.experiments.results import markdown_table
    from tmca.reports.mask_page import COLUMNS
    from tmca.reports.masks import design_spectral_depth

    with progress_bar(f"design {out.name}") as progress:
        _, found = design_spectral_depth(
            sensor.sheet(),
            out,
            scenes=scenes,
            progress=progress,
            bench=bench.changes(),
            **camera.described(),
            **search.search(),
        )
    if json:
        print(json_module.dumps(found, indent=1))
        return
    print(markdown_table(found["designs"], COLUMNS))
    print(f"{found['advice']}\nopen {out / 'design.html'}")


def _say(found: dict[str, Any], out: Path, json: bool) -> None:
    """The advice as a table and a sentence, or as JSON."""
    from tmca.experiments.results import markdown_table
    from tmca.reports.codes import COLUMNS

    if json:
        print(json_module.dumps(found, indent=1))
        return
    rows = [found["static"], *([found["chosen"]] if found["chosen"] else []), *found["surveyed"]]
    print(markdown_table(rows, COLUMNS))
    print(f"{found['advice']}\nopen {out / 'design.html'}")


@app.command
def judge(
    codes: Path,
    /,
    *,
    bands: Whole = 12,
    dispersion: str | None = None,
    disperser: str | None = None,
    prior: Path | None = None,
    sensor: SheetOptions = _SHEET,
    figure: Path | None = None,
    overwrite: Annotated[bool, Parameter(negative="")] = False,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Judge codes without a decoder: light, contrast and levels, likeness of bands, singular values, coherence.

    Args:
        codes: codes.nc of `tmca design spectral`, a snapshot file, or weights of `tmca train`.
        bands: of the spectral camera, for codes.nc.
        dispersion: for codes.nc: pixels per band, or the displacement of every band separated by commas. [default: 1]
        disperser: for codes.nc: single or dual. [default: single]
        prior: file of `tmca prior learn`: also say the expected PSNR under it, for the sensor or that of the snapshot.
        figure: write levels, correlations and singular values as a picture (PNG).
        overwrite: replace the picture if it exists.
        json: print JSON, with all levels, correlations and singular values.
    """
    from tmca.cli.options.numbers import numbers
    from tmca.cli.options.output import check_figure
    from tmca.reports.judged import judge_codes

    check_figure(figure, overwrite, codes)
    camera: dict[str, Any] = {} if disperser is None else {"disperser": disperser}
    if dispersion is not None:
        camera["dispersion"] = numbers(dispersion, "--dispersion")
    sheet = sensor.sheet() if any(value is not None for value in vars(sensor).values()) else None
    found = judge_codes(codes, bands=bands, prior=prior, sheet=sheet, camera=camera, figure=figure, overwrite=overwrite)
    if json:
        print(json_module.dumps(found, indent=1))
        return
    values = found["singular_values"]
    seen = sum(value > 1e-3 * values[0] for value in values)
    print(f"{codes}: {found['camera']} camera, K = {found['slots']}, {found['channels']} channels")
    for name in ("throughput", "contrast", "likeness", "coherence", "expected_psnr"):
        if name in found:
            print(f"  {name:24s} {found[name]:.4f}")
    print(f"  {'levels':24s} {len(found['levels'])}")
    print(f"  {'singular values':24s} {values[0]:.3g} down to {values[-1]:.3g}, {seen} above a thousandth of the first")


@app.command
def study(
    *,
    train: Path,
    test: Path | None = None,
    out: Path = Path("docs/results"),
    work: Path = Path("runs/codes-study"),
    bands: Whole = 12,
    slots: str = "2,4,8,16",
    period: str = "16x24",
    test_slots: Whole = 8,
    validation: Path | None = None,
    steps: Whole = 0,
    seeds: Whole = 1,
    jobs: Whole = 1,
    overwrite: Annotated[bool, Parameter(negative="")] = False,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Where time multiplexing pays: designed and random codes over read noise, full well and number of slots.

    Writes codes.md, codes.json and maps of the gain. Finished cells are kept in --work: a study that was stopped goes
    on.

    Args:
        train: split file of the scenes that codes are designed for.
        test: split file of scenes on which designs are measured; it chooses nothing.
        out: folder of the results.
        work: folder of finished cells.
        bands: nearest to even spacing from 400 to 700 nm.
        slots: numbers of slots, separated by commas.
        period: ROWSxCOLUMNS of the tile of codes, pixels.
        test_slots: slots of the designs on the test scenes.
        validation: split file of the scenes that choose a network's best step.
        steps: of an unrolled network for each code at the corners and each code whose order is checked; none with 0.
        seeds: of codes and noise on the test scenes.
        jobs: processes side by side.
        overwrite: replace results that exist.
        json: print JSON instead of text.
    """
    from tmca.cli.options.numbers import size
    from tmca.cli.studies import study_module
    from tmca.data import read_split

    tile = size(period, "--period") or (16, 24)
    examples, scenes, checked = (
        list(map(str, read_split(split))) if split else [] for split in (train, test, validation)
    )
    found = study_module("codes.study").study_codes(
        examples, scenes, out, work, bands=bands, slots=whole_numbers(slots) or [], period=tile, test_slots=test_slots,
        validation=checked, steps=steps, seeds=seeds, jobs=jobs, overwrite=overwrite, progress=cell_done,
        command=["tmca", *sys.argv[1:]],
    )  # fmt: skip
    print(json_module.dumps(found, indent=1) if json else (out / "codes.md").read_text())
