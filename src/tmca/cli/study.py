"""``tmca study``: one's own scenes, sensor, codes and decoders in one comparison, or one described in a YAML file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from tmca.cli.options.grid import GridOptions
from tmca.cli.options.numbers import MaybeWhole, size
from tmca.cli.options.output import say
from tmca.cli.progress import cell_done
from tmca.cli.sweep import one_value
from tmca.errors import SettingError

if TYPE_CHECKING:
    from tmca.evaluation.study import Study

_GRID = GridOptions()
_YAML = (".yaml", ".yml")


def study(
    *scenes: str,
    sensor: Path | None = None,
    codes: str | None = None,
    decoders: str | None = None,
    weights: str | None = None,
    camera: str | None = None,
    crop: str | None = None,
    bands: MaybeWhole = None,
    range: str | None = None,
    seeds: MaybeWhole = None,
    reading: Annotated[list[str] | None, Parameter(name="--reading")] = None,
    out: Path | None = None,
    work: Path | None = None,
    grid: GridOptions = _GRID,
) -> None:
    """Compare codes and decoders on SCENES of your own, under your sensor: a table, a figure for a paper, a page.

    `tmca study my.mat --sensor sensor.yaml --codes cassi,one-hot,designed --decoders lmmse,mixture`; or `tmca study
    FILE.yaml`, which describes any comparison (docs/studies.md). Writes NAME.csv, NAME.md, NAME.json, NAME.pdf,
    NAME.png and NAME.html for the first scene's NAME. The same command again computes only what is missing.

    Args:
        scenes: files, folders or names of rendered scenes that are measured; or one YAML file.
        sensor: YAML file with arguments of the sensor, such as full_well: 10000; or with several sensors by their
            names. An ideal one without it.
        codes: separated by commas: presets of `tmca simulate` (cassi, one-hot, two-bucket, burst, …), designed (a short
            search for this sensor), default (the camera that comes with tmca), or files of codes or snapshots and runs
            of `tmca train`, with a name of yours as NAME=FILE. [default: the usual ones of the camera]
        decoders: separated by commas: names that `tmca decoders` lists, your own as FILE.py:Class, or FILE.pt2 of `tmca
            decoder export`. Beside a YAML file: more of them. [default: lmmse or the like, which needs no weights]
        weights: of the decoder network, which then takes part: a file or run of `tmca train`, universal or default.
            [default with network: universal; of another camera than a spectral one, default]
        camera: spectral, light-field, spectral-depth, or one of another package; what the scenes are for without it.
        crop: HEIGHTxWIDTH, the middle of every scene.
        bands: of a spectral camera, nearest to even spacing over the range. [default: 12, or all of fewer]
        range: FIRST:LAST in nm that bands are taken from, such as 400:1000. [default: 400:700 where all scenes cover
            it, else what all cover]
        seeds: how many draws of codes and noise. [default: 1]
        reading: NAME=VALUE, further entries of the study's reading (docs/studies.md); may be given several times.
        out: folder of the results. [default: NAME-study; results for a YAML file]
        work: folder of priors, codes, trainings and finished cells. [default: cells in --out; runs/study-NAME for a
            YAML file]
    """
    from tmca.evaluation.grid import CellsFailed
    from tmca.evaluation.run import run_study

    described = len(scenes) == 1 and Path(scenes[0]).suffix in _YAML
    given: dict[str, Any] = {"sensor": sensor, "codes": codes, "camera": camera, "crop": crop, "bands": bands}
    given |= {"range": range, "reading": reading, "weights": weights}
    if described:
        asked = _described(scenes[0], decoders, seeds, given)
        out, work = out or Path("results"), work or Path("runs") / f"study-{asked.name}"
    else:
        asked = _own(scenes, decoders, seeds, given)
        out = out or Path(f"{asked.name}-study")
        work = work or out / "cells"
    try:
        found = run_study(asked, out, work, progress=cell_done, **grid.how())
    except CellsFailed as failed:
        if failed.results is not None:
            _tell(asked, failed.results, out, grid.json, page=described, markdown=grid.markdown)
        raise
    _tell(asked, found, out, grid.json, page=described, markdown=grid.markdown)


def _tell(asked: Study, found: dict[str, Any], out: Path, json: bool, page: bool, markdown: bool) -> None:
    """The whole page, or the table that people read first and where the rest is."""
    from tmca.evaluation.gains import multiplexing
    from tmca.evaluation.paper import summary
    from tmca.evaluation.tables import markdown_table

    if page:
        say(found, json, (out / f"{asked.name}.md").read_text().rstrip(), markdown=markdown)
        return
    names = f"{asked.name}.pdf and .png, the figure; {asked.name}.csv, .md, .tex and .json"
    open_first = f"open {out / asked.name}.html; beside it {names}"
    rows, columns = summary(asked, found)
    notes = [*([found["bands"]] if found.get("bands") else []), *asked.evaluation.warnings(rows)]
    notes += multiplexing(found, asked)
    say(found, json, markdown_table(rows, columns), *notes, open_first, markdown=markdown)


def _own(scenes: tuple[str, ...], decoders: str | None, seeds: int | None, given: dict[str, Any]) -> Study:
    """The study that options describe."""
    from tmca.evaluation.own import own_study
    from tmca.evaluation.tables import check_counts
    from tmca.specs.base import range_of_nm
    from tmca.yaml_files import parsed_yaml

    if not scenes:
        raise SettingError("study", "no scenes", "files or names of rendered scenes, or a YAML file")
    check_counts(seeds=1 if seeds is None else seeds)
    codes = [part.strip() for part in (given["codes"] or "").split(",") if part.strip()]
    how = {name: given[name] for name in ("sensor", "camera", "bands", "weights")} | {"codes": codes}
    how |= {
        "reading": {
            name: parsed_yaml(text) for name, text in one_value(given["reading"], "--reading", "views=3").items()
        }
    }
    how |= {"crop": size(given["crop"], "--crop"), "seeds": seeds or 1, "range": range_of_nm(given["range"])}
    named = [text.strip() for text in (decoders or "").split(",") if text.strip()]
    return own_study(scenes, decoders=named, **how)


def _described(file: str, decoders: str | None, seeds: int | None, given: dict[str, Any]) -> Study:
    """The study of a YAML file, with decoders and seeds of the command line; code that the file alone names is
    refused."""
    from tmca.evaluation.study import read_study
    from tmca.lab.decoder_files import names_of, place_of

    beside = [name for name, value in given.items() if value is not None]
    if beside:
        remedy = "write it into the file, or leave the file out"
        raise SettingError(beside[0], f"one beside {file}", "what the file says", remedy)
    typed = names_of([text.strip() for text in (decoders or "").split(",") if text.strip()])
    by_place = {place_of(text): name for text, name in typed.items()}
    asked = read_study(file)
    names = {name: by_place.get(place_of(name), name) for name in (*asked.decoders, *asked.options)}
    return asked.with_(
        decoders=[*dict.fromkeys([*(names[name] for name in asked.decoders), *typed.values()])],
        options={names[name]: settings for name, settings in asked.options.items()},
        shown=None if asked.shown is None else [(code, names.get(name, name)) for code, name in asked.shown],
        seeds=seeds,
    )
