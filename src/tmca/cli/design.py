"""``tmca design``: which codes to use with a given sensor, before anything is built."""

from __future__ import annotations

import json as json_module
import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Group, Parameter

from tmca.cli.numbers import MaybeWhole, Whole
from tmca.cli.options import SceneOptions
from tmca.errors import DataError, SettingError

app = App(name="design", help="Find codes for a sensor, and say what they gain before anything is built.")
_SCENE = SceneOptions()
_SHEET = Group("Sensor and modulator", sort_key=1)
_Number = Annotated[float | None, Parameter(group=_SHEET)]


@app.command
def spectral(
    *scenes: str,
    out: Path = Path("tmca-design"),
    sensor: Annotated[Path | None, Parameter(group=_SHEET)] = None,
    full_well: _Number = None,
    read_noise_electrons: _Number = None,
    read_noise: _Number = None,
    bits: Annotated[MaybeWhole, Parameter(group=_SHEET)] = None,
    exposure: _Number = None,
    pattern_rate: _Number = None,
    slot_time: _Number = None,
    split: Path | None = None,
    bands: Whole = 12,
    dispersion: str | None = None,
    disperser: str | None = None,
    slots: str | None = None,
    kinds: str = "free,one-hot",
    period: Whole = 32,
    throughput: float | None = None,
    light: float | None = None,
    seed: Whole = 0,
    reading: SceneOptions = _SCENE,
    overwrite: Annotated[bool, Parameter(negative="")] = False,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Recommend the number of slots and the codes of a spectral camera for a sensor and SCENES like those to come.

    Writes into --out: design.html (start there), design.json, the codes as aperture.tif and shutter.tif (0 and 255, a
    page per slot, one period) and together as codes.nc.

    Args:
        scenes: cubes or rendered scenes to design for, two at least to judge the gain; the rendered ones without any.
        out: folder of the results.
        sensor: YAML file with the names of this group; options replace its values.
        full_well: electrons at full scale; switches shot noise on.
        read_noise_electrons: read noise in electrons, standard deviation.
        read_noise: read noise in snapshot units (1 = one band of a white scene) where electrons are not known.
        bits: of the analogue-to-digital converter.
        exposure: time of a snapshot, seconds.
        pattern_rate: most patterns per second of aperture and shutter, Hz.
        slot_time: shortest time a pattern may be shown, seconds.
        split: split file whose scenes are added.
        bands: nearest to even spacing from 400 to 700 nm.
        dispersion: pixels per band, or the displacement of every band separated by commas. [default: 1]
        disperser: single or dual. [default: single]
        slots: numbers of slots to try, separated by commas. [default: those of 2, 4, 8, 16 that fit the exposure]
        kinds: structures of codes to try: free, one-hot, complementary, blue-noise, s-matrix;
            open-shutter where each pixel cannot have a shutter of its own, static-aperture where the mask stands still.
        period: tile of the codes, pixels.
        throughput: share of light that codes shall let through, as near as their kind allows. [default: free]
        light: mean irradiance that SCENES are dimmed to before codes are searched, share of white: the same scenes
            under less light, where noise weighs more. [default: as they are]
        seed: of random codes.
        overwrite: replace files that exist.
        json: print JSON instead of text.
    """
    from tmca.cli.options import numbers
    from tmca.cli.progress import progress_bar
    from tmca.data import read_split
    from tmca.experiments.design_spectral import design_spectral

    given = {
        "full_well": full_well, "read_noise_electrons": read_noise_electrons, "read_noise": read_noise, "bits": bits,
        "exposure": exposure, "pattern_rate": pattern_rate, "slot_time": slot_time,
    }  # fmt: skip
    sheet = _sheet(sensor, {name: value for name, value in given.items() if value is not None})
    camera: dict[str, Any] = {} if disperser is None else {"disperser": disperser}
    if dispersion is not None:
        camera["dispersion"] = numbers(dispersion, "--dispersion")
    named = [*scenes, *(map(str, read_split(split)) if split else ())]
    with progress_bar(f"design {out.name}") as progress:
        advice, found = design_spectral(
            sheet, out, scenes=named, bands=bands, reading=reading.reading(), camera=camera,
            slots=_whole_numbers(slots), kinds=kinds.split(","), period=period, throughput=throughput, light=light,
            seed=seed, overwrite=overwrite, progress=progress, command=["tmca", *sys.argv[1:]],
        )  # fmt: skip
    _say(advice, found, out, json)


@app.command
def light_field(
    *scenes: str,
    out: Path = Path("tmca-design"),
    sensor: Annotated[Path | None, Parameter(group=_SHEET)] = None,
    full_well: _Number = None,
    read_noise_electrons: _Number = None,
    read_noise: _Number = None,
    bits: Annotated[MaybeWhole, Parameter(group=_SHEET)] = None,
    exposure: _Number = None,
    pattern_rate: _Number = None,
    slot_time: _Number = None,
    split: Path | None = None,
    views: Whole = 5,
    scale: MaybeWhole = None,
    shear: str | None = None,
    slots: str | None = None,
    kinds: str = "free,one-hot",
    period: Whole = 16,
    throughput: float | None = None,
    light: float | None = None,
    seed: Whole = 0,
    overwrite: Annotated[bool, Parameter(negative="")] = False,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Recommend the number of slots and the codes of a light-field camera for a sensor and SCENES like those to come.

    Writes into --out what `tmca design spectral` writes.

    Args:
        scenes: light fields to design for, two at least to judge the gain; the rendered ones without any.
        out: folder of the results.
        sensor: YAML file with the names of this group; options replace its values.
        full_well: electrons at full scale; switches shot noise on.
        read_noise_electrons: read noise in electrons, standard deviation.
        read_noise: read noise in snapshot units (1 = one view of a white scene) where electrons are not known.
        bits: of the analogue-to-digital converter.
        exposure: time of a snapshot, seconds.
        pattern_rate: most patterns per second of mask and shutter, Hz.
        slot_time: shortest time a pattern may be shown, seconds.
        split: split file whose light fields are added.
        views: n for the centre n×n views, odd.
        scale: of light fields from files, whole number of pixels per axis that are averaged into one.
        shear: mask pixels per view, one number or ALONG_Y,ALONG_X. [default: 1]
        slots: numbers of slots to try, separated by commas. [default: those of 2, 4, 8, 16 that fit the exposure]
        kinds: structures of codes to try, as in `tmca design spectral`.
        period: tile of the codes, pixels.
        throughput: share of light that codes shall let through, as near as their kind allows. [default: free]
        light: mean irradiance that SCENES are dimmed to before codes are searched, share of white: the same scenes
            under less light, where noise weighs more. [default: as they are]
        seed: of random codes.
        overwrite: replace files that exist.
        json: print JSON instead of text.
    """
    from tmca.cli.cameras import shear_argument
    from tmca.cli.progress import progress_bar
    from tmca.data import read_split
    from tmca.experiments.design_light_field import design_light_field

    given = {
        "full_well": full_well, "read_noise_electrons": read_noise_electrons, "read_noise": read_noise, "bits": bits,
        "exposure": exposure, "pattern_rate": pattern_rate, "slot_time": slot_time,
    }  # fmt: skip
    sheet = _sheet(sensor, {name: value for name, value in given.items() if value is not None})
    named = [*scenes, *(map(str, read_split(split)) if split else ())]
    with progress_bar(f"design {out.name}") as progress:
        advice, found = design_light_field(
            sheet, out, scenes=named, views=views, scale=scale,
            camera={} if shear is None else {"shear": shear_argument(shear)},
            slots=_whole_numbers(slots), kinds=kinds.split(","), period=period, throughput=throughput, light=light,
            seed=seed, overwrite=overwrite, progress=progress, command=["tmca", *sys.argv[1:]],
        )  # fmt: skip
    _say(advice, found, out, json)


def _say(advice: Any, found: dict[str, Any], out: Path, json: bool) -> None:
    """The advice as a table and a sentence, or as JSON."""
    from tmca.experiments.design_codes import COLUMNS
    from tmca.experiments.results import markdown_table

    if json:
        print(json_module.dumps(found, indent=1))
        return
    rows = [found["static"], *([found["chosen"]] if found["chosen"] else []), *found["surveyed"]]
    print(markdown_table(rows, COLUMNS))
    print(f"{advice.sentence()}\nopen {out / 'design.html'}")


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
    from tmca.cli.options import size
    from tmca.data import read_split
    from tmca.experiments.codes import study_codes

    def told(done: int, total: int, name: str) -> None:
        print(f"[{done}/{total}] {name}", file=sys.stderr)

    tile = size(period, "--period") or (16, 24)
    examples, scenes, checked = (
        list(map(str, read_split(split))) if split else [] for split in (train, test, validation)
    )
    found = study_codes(
        examples, scenes, out, work, bands=bands, slots=_whole_numbers(slots) or [], period=tile, test_slots=test_slots,
        validation=checked, steps=steps, seeds=seeds, jobs=jobs, overwrite=overwrite, progress=told,
        command=["tmca", *sys.argv[1:]],
    )  # fmt: skip
    print(json_module.dumps(found, indent=1) if json else (out / "codes.md").read_text())


def _sheet(file: Path | None, options: dict[str, Any]) -> Any:
    """The sensor's sheet from a YAML file and options."""
    import yaml

    from tmca.design import SensorSheet

    known = list(SensorSheet.__dataclass_fields__)
    described: Any = {}
    if file is not None:
        try:
            described = yaml.safe_load(file.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise DataError(file, "no such file", f"YAML with some of {', '.join(known)}") from None
        except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
            raise DataError(file, f"no readable YAML ({error})", f"some of {', '.join(known)}") from None
        if not isinstance(described, dict):
            raise DataError(file, f"a {type(described).__name__}", "names and values, such as full_well: 10000")
    for name, value in described.items():
        if name not in known:
            raise DataError(file or "sensor", f"{name}", f"some of {', '.join(known)}")
        described[name] = _number(file, name, value)
    known_values = {name: value for name, value in described.items() if value is not None}
    return SensorSheet(**{**known_values, **options})


def _number(file: Path | None, name: str, value: Any) -> float | int | None:
    try:
        if isinstance(value, bool):
            raise TypeError
        number = None if value is None else float(value)
    except (TypeError, ValueError):
        raise DataError(file or "sensor", f"{name} = {value}", "a number") from None
    if name != "bits" or number is None:
        return number
    if not number.is_integer():
        raise DataError(file or "sensor", f"bits = {value}", "a whole number")
    return int(number)


def _whole_numbers(text: str | None) -> list[int] | None:
    if text is None:
        return None
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise SettingError("--slots", repr(text), "whole numbers separated by commas") from None
