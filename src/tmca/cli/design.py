"""``tmca design``: which codes to use with a given sensor, before anything is built."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from tmca.cli.cameras import BENCH, READING, group, scenes_of
from tmca.cli.options.numbers import Whole, size, whole_numbers
from tmca.cli.options.output import Json, Markdown, Overwrite, check_figure, say
from tmca.cli.progress import cell_done
from tmca.errors import SettingError
from tmca.progress import progress_bar
from tmca.specs import (
    BandsReading,
    CodeSearchSpec,
    LightFieldSpec,
    LightFieldsReading,
    MaskCameraSpec,
    MaskSearchSpec,
    PhaseBenchSpec,
    SensorFileSpec,
    SheetSpec,
    SpectralSpec,
    read_sensor,
    spec_of,
)

app = App(name="design", help="Find codes for a sensor, and say what they gain before anything is built.")
SHEET, SEARCH, MASKS = group("Sensor and modulator", 2), group("Search", 3), group("Camera", 1)
_CUBE, _VIEWS, _SHEET, _BENCH = BandsReading(), LightFieldsReading(), SheetSpec(), PhaseBenchSpec()
_SEARCH, _MASK_SEARCH, _MASK_CAMERA = CodeSearchSpec(), MaskSearchSpec(), MaskCameraSpec()
_SENSOR = "YAML file with the names of the sensor and modulator; options replace its values."
Sensor = Annotated[Path | None, Parameter(help=_SENSOR)]


@Parameter(name="*")
@dataclass(frozen=True)
class DesignOptions:
    """Where a design goes, and the sensor that it is for."""

    out: Path = Path("tmca-design")
    "Folder of the results."
    sensor: Sensor = None
    device: str | None = None
    "Device that computes the search: cpu, cuda or cuda:1."
    overwrite: Overwrite = False
    json: Json = False
    markdown: Markdown = False

    def how(self, sheet: SheetSpec) -> dict[str, Any]:
        """Arguments of a search for the sensor, whose values ``sheet`` replaces."""
        command = ["tmca", *sys.argv[1:]]
        return {"sheet": _sheet(self.sensor, sheet), "out": self.out, "overwrite": self.overwrite, "command": command}


_DESIGN = DesignOptions()


@app.command
def spectral(
    *scenes: str,
    split: Path | None = None,
    bands: Whole = 12,
    dispersion: str | None = None,
    disperser: str | None = None,
    period: Whole | None = None,
    sheet: Annotated[SheetSpec, SHEET] = _SHEET,
    search: Annotated[CodeSearchSpec, SEARCH] = _SEARCH,
    reading: Annotated[BandsReading, READING] = _CUBE,
    run: DesignOptions = _DESIGN,
) -> None:
    """Recommend the number of slots and the codes of a spectral camera for a sensor and SCENES like those to come.

    Writes into --out: design.html (start there), design.json, the codes as aperture.tif and shutter.tif (0 and 255, a
    page per slot, one period) and together as codes.nc. codes_k1.nc are the static ones, codes_kK.nc the best of
    several slots, recommended or not, and burst.nc those of the burst of frames.

    Args:
        scenes: cubes or rendered scenes to design for, two at least to judge the gain; the rendered ones without any.
        split: split file whose scenes are added.
        bands: nearest to even spacing from 400 to 700 nm.
        dispersion: pixels per band, or the displacement of every band separated by commas. [default: 1]
        disperser: single or dual. [default: single]
        period: tile of the codes, pixels. [default: 32, with --quick 16]
    """
    from tmca.reports.cameras import design_spectral

    about = {"bands": bands, "reading": reading.given(), "camera": _optics(dispersion, disperser)}
    about["period"] = (16 if search.quick else 32) if period is None else period
    _search_codes(design_spectral, run, search, scenes=scenes_of(scenes, split), **about, **run.how(sheet))


@app.command
def light_field(
    *scenes: str,
    split: Path | None = None,
    shear: str | None = None,
    period: Whole = 16,
    sheet: Annotated[SheetSpec, SHEET] = _SHEET,
    search: Annotated[CodeSearchSpec, SEARCH] = _SEARCH,
    reading: Annotated[LightFieldsReading, READING] = _VIEWS,
    run: DesignOptions = _DESIGN,
) -> None:
    """Recommend the number of slots and the codes of a light-field camera for a sensor and SCENES like those to come.

    Writes into --out what `tmca design spectral` writes.

    Args:
        scenes: light fields to design for, two at least to judge the gain; the rendered ones without any.
        split: split file whose scenes are added.
        shear: mask pixels per view, one number or ALONG_Y,ALONG_X. [default: 1]
        period: tile of the codes, pixels.
    """
    from tmca.data.light_field_scenes import Reading
    from tmca.reports.cameras import design_light_field

    camera = {} if shear is None else spec_of(LightFieldSpec, {"shear": shear}).arguments()
    about = {"views": reading.views, "reading": Reading(**reading.files()), "camera": camera, "period": period}
    _search_codes(design_light_field, run, search, scenes=scenes_of(scenes, split), **about, **run.how(sheet))


@app.command
def spectral_depth(
    *scenes: str,
    sheet: Annotated[SheetSpec, SHEET] = _SHEET,
    camera: Annotated[MaskCameraSpec, MASKS] = _MASK_CAMERA,
    bench: Annotated[PhaseBenchSpec, BENCH] = _BENCH,
    search: Annotated[MaskSearchSpec, SEARCH] = _MASK_SEARCH,
    run: DesignOptions = _DESIGN,
) -> None:
    """Recommend the number of slots and the phase masks that tell depths apart best, for a sensor and a bench.

    Writes into --out: design.html (start there), design.json, the recommended masks with shutter and filters as
    codes.nc, those of every number of slots as codes_kK.nc, and pictures. With --buckets 2 also those of two buckets,
    codes_kK_two_buckets.nc, and of a burst of two frames, burst.nc.

    Args:
        scenes: cubes or rendered scenes whose patches the scenes to come are like; the rendered ones without any.
    """
    from tmca.design import MaskEffort
    from tmca.design.mask_advised import mask_advice_lines
    from tmca.devices import computing_on
    from tmca.reports.mask_page import columns_of
    from tmca.reports.masks import design_spectral_depth

    how = {**camera.arguments(), **search.arguments(), "effort": MaskEffort(search.starts, search.steps)}
    how |= {"bench": bench.arguments(), **run.how(sheet)}
    with computing_on(run.device), progress_bar(f"design {run.out.name}") as progress:
        advice, report = design_spectral_depth(scenes=scenes, progress=progress, **how)
    _report(report, mask_advice_lines(advice), report["designs"], columns_of(report), run)


def _search_codes(design: Any, run: DesignOptions, search: CodeSearchSpec, **how: Any) -> None:
    """Search codes of a camera with an aperture and a shutter, and say what was found."""
    from tmca.design import QUICK
    from tmca.design.advised import advice_lines
    from tmca.devices import computing_on
    from tmca.reports.codes import columns_of, other_files

    how |= {**search.model_dump(exclude={"quick"}), **({"survey": QUICK, "effort": QUICK} if search.quick else {})}
    with computing_on(run.device), progress_bar(f"design {run.out.name}") as progress:
        advice, report = design(progress=progress, **how)
    said, has = advice_lines(advice), "; it has the survey of every number of slots"
    _report(report, said, report["designs"], columns_of(report), run, has, other_files(report["files"]))


def _optics(dispersion: str | None, disperser: str | None) -> dict[str, Any]:
    """Arguments of the spectral camera that were given."""
    given = {"dispersion": dispersion, "disperser": disperser}
    return spec_of(SpectralSpec, {name: value for name, value in given.items() if value is not None}).arguments()


def _sheet(file: Path | None, options: SheetSpec) -> Any:
    """The sensor's sheet of a YAML file, its values replaced by options."""
    from tmca.design import SensorSheet

    described = {} if file is None else read_sensor(file, SensorFileSpec).only(*SheetSpec.model_fields)
    try:
        return SensorSheet(**{**described, **options.given()})
    except SettingError as error:
        where = error.where if file is None else f"{error.where} (of {file} and options)"
        raise SettingError(where, error.found, error.expected, error.remedy) from None


def _report(
    report: dict[str, Any],
    advice: list[str],
    rows: list[Any],
    columns: Any,
    run: DesignOptions,
    has: str = "",
    *last: str,
) -> None:
    """The designs that were searched on as a table, the advice line by line, what the page ``has``, and the ``last``
    lines; or JSON."""
    from tmca.evaluation.tables import markdown_table

    lines = (markdown_table(rows, columns), *advice, "", f"open {run.out / 'design.html'}{has}", *last)
    say(report, run.json, *lines, markdown=run.markdown)


@app.command
def judge(
    codes: Path,
    /,
    *,
    bands: Whole = 12,
    dispersion: str | None = None,
    disperser: str | None = None,
    prior: Path | None = None,
    sensor: Sensor = None,
    sheet: Annotated[SheetSpec, SHEET] = _SHEET,
    figure: Path | None = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Judge codes without a decoder: light, contrast and levels, likeness of bands, singular values, coherence.

    Args:
        codes: codes.nc of `tmca design spectral`, a snapshot file, or weights of `tmca train`.
        bands: of the spectral camera, for codes.nc.
        dispersion: for codes.nc: pixels per band, or the displacement of every band separated by commas. [default: 1]
        disperser: for codes.nc: single or dual. [default: single]
        prior: file of `tmca prior learn`: also say the expected PSNR under it, for the sensor or that of the snapshot.
        figure: write levels, correlations and singular values as a picture (PNG).
        json: print JSON, with all levels, correlations and singular values.
    """
    from tmca.reports.judged import judge_codes

    check_figure(figure, overwrite, codes)
    data_sheet = _sheet(sensor, sheet) if sensor is not None or sheet.given() else None
    camera = _optics(dispersion, disperser)
    figures = judge_codes(
        codes, bands=bands, prior=prior, sheet=data_sheet, camera=camera, figure=figure, overwrite=overwrite
    )
    values, names = figures["singular_values"], ("throughput", "contrast", "likeness", "coherence", "expected_psnr")
    seen = sum(value > 1e-3 * values[0] for value in values)
    say(
        figures, json,
        f"{codes}: {figures['camera']} camera, K = {figures['slots']}, {figures['channels']} channels"
        + (f", {figures['buckets']} buckets" if figures["buckets"] > 1 else ""),
        *(f"  {name:24s} {figures[name]:.4f}" for name in names if name in figures),
        f"  {'levels':24s} {len(figures['levels'])}",
        f"  {'singular values':24s} {values[0]:.3g} down to {values[-1]:.3g}, {seen} above a thousandth of the first",
    )  # fmt: skip


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
    overwrite: Overwrite = False,
    json: Json = False,
    markdown: Markdown = False,
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
    """
    from tmca.cli.studies import study_module

    tile = size(period, "--period") or (16, 24)
    examples, scenes, checked = (scenes_of((), split) for split in (train, test, validation))
    results = study_module("codes.study").study_codes(
        examples, scenes, out, work, bands=bands, slots=whole_numbers(slots, "--slots"), period=tile,
        test_slots=test_slots, validation=checked, steps=steps, seeds=seeds, jobs=jobs, overwrite=overwrite,
        progress=cell_done, command=["tmca", *sys.argv[1:]],
    )  # fmt: skip
    say(results, json, (out / "codes.md").read_text(), markdown=markdown)
