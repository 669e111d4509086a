"""Codes for a sensor: searched, judged on example scenes, written as files with a page that explains them.

The same for every camera; `tmca.reports.cameras` says which scenes it is for.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from torch import Tensor

from tmca.applications.report import Section, write_report
from tmca.arguments import checked
from tmca.cameras import CodedCamera
from tmca.codes import BURST, write_codes
from tmca.data import atomic_path, check_folder, make_folder, tiff_bytes, write_json
from tmca.design import (
    SURVEY,
    Advice,
    Candidate,
    Effort,
    Examples,
    Progress,
    SensorSheet,
    advise,
    check_search,
    check_size,
    decibels,
    measures,
)
from tmca.design.advised import WITHIN, advice_lines, code_advice
from tmca.design.kinds import buckets_of
from tmca.errors import DataError
from tmca.evaluation.tables import check_new, repository_commit
from tmca.lab.notes import CODES_DATE, now
from tmca.plots.curves import Gain, gains_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FILES = ("design.json", "design.html", "aperture.tif", "shutter.tif", "codes.nc", "burst.nc")
_OF_SLOTS = re.compile(r"codes_k\d+\.nc")
COLUMNS = (
    ("codes", "codes", ""),
    ("slots", "K", "d"),
    ("readings", "readings of a pixel", "d"),
    ("expected_psnr", "expected PSNR (dB)", ".2f"),
    ("random_psnr", "random codes (dB)", ".2f"),
    ("held_out_psnr", "each scene under the prior of the others (dB)", ".2f"),
    ("gain", "gain over static (dB)", "+.2f"),
    ("spread", "± from scene to scene", ".2f"),
    ("throughput", "light", ".1%"),
    ("seconds", "CPU seconds", ".0f"),
)
_OF_OTHERS = ("held_out_psnr", "spread")
"""Columns of what is judged on each scene under the prior of the others."""


def columns_of(record: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Columns of the table of designs: of one scene, which has no others, without those of the others."""
    return [column for column in COLUMNS if len(record["scenes"]) > 1 or column[0] not in _OF_OTHERS]


@dataclass(frozen=True)
class Learned:
    """What a design knows of scenes.

    Args:
        examples: as priors of the blocks that designs are judged on.
        camera: arguments of ``designable`` beside kind, slots and period.
    """

    examples: Examples
    camera: dict[str, Any]


def read_scenes(names: Sequence[str], read: Callable[[str], Any], progress: Progress) -> dict[str, Any]:
    """What ``read`` gives of every scene, by the stem of its name, or by its name where the stem is taken."""
    scenes: dict[str, Any] = {}
    for place, name in enumerate(names):
        progress(place / len(names), f"reading {name}")
        scene = read(name)
        scenes[name if Path(name).stem in scenes else Path(name).stem] = scene
    return scenes


def named_once(names: Sequence[str]) -> None:
    """Raises DataError for a scene that is named twice."""
    for name in names:
        if list(names).count(name) > 1:
            raise DataError(name, "the same scene twice", "each scene once", "leave one out")


@checked
def search_codes(
    sheet: SensorSheet,
    out: Path,
    learn: Callable[[Progress], Learned],
    bare: Mapping[str, Any],
    scenes: int,
    *,
    slots: Sequence[int] | None = None,
    kinds: Sequence[str] | None = None,
    period: int = 32,
    survey: Effort = SURVEY,
    effort: Effort | None = None,
    throughput: float | None = None,
    light: float | None = None,
    within: float = WITHIN,
    seed: int = 0,
    overwrite: bool = False,
    progress: Progress | None = None,
    command: Sequence[str] = (),
) -> tuple[Advice, dict[str, Any]]:
    """Search codes of a camera for a sensor and write them to a folder.

    Args:
        sheet: sensor and modulator.
        out: folder of ``design.json``, ``design.html``, ``aperture.tif``, ``shutter.tif`` and ``codes.nc`` with the
            recommended codes, ``codes_k1.nc`` with the static ones, ``codes_kK.nc`` with the best of several slots K,
            whether they are recommended or not, and ``burst.nc`` with those of the burst.
        learn: reads the example scenes, once all else is seen to be possible.
        bare: arguments of ``designable`` as far as they are known before scenes are read.
        scenes: number of example scenes.
        slots: numbers of slots to try; those that fit without.
        kinds: structures of codes to try; free and one-hot ones without, and of two buckets where pixels have two.
        period: side of the tile of codes, pixels.
        survey: effort of each search of the survey.
        effort: of the last searches.
        throughput: share of light that all codes shall let through; free if None.
        light: mean irradiance that the examples are dimmed to, share of white; as they are if None.
        within: see ``tmca.design.advise``.
        seed: of random codes.
        overwrite: replace files that exist.
        progress: called with the share that is done and what is done.
        command: how it was called, kept in the files.

    Returns:
        The advice, and what ``design.json`` holds.

    Raises:
        SettingError: impossible sensor, slots, kinds or period, or more than fits the memory.
        DataError, ShapeError: scenes that cannot be used, or that are too small.
        OutputError: files exist, or none can be written.
    """
    check_search(sheet, slots, kinds, period, seed, throughput, light)
    of_slots = [f"codes_k{k}.nc" for k in (1, *sheet.allowed(slots))]
    check_new((out / name for name in (*FILES, *of_slots)), overwrite)
    frames = buckets_of(BURST, max(slots)) if slots and BURST in (kinds or ()) else 1
    check_size(bare, (period, period), sheet.allowed(slots), scenes, max(frames, sheet.buckets))
    check_folder(out)
    progress = progress or (lambda share, step: None)
    learned = learn(progress)
    examples = learned.examples if light is None else learned.examples.under(light)
    advice = advise(
        examples, sheet, slots=slots, kinds=kinds, period=(period, period), survey=survey, effort=effort,
        throughput=throughput,
        within=within, seed=seed, progress=lambda share, step: progress(0.3 + 0.68 * share, step), **learned.camera,
    )  # fmt: skip
    make_folder(out)
    record = _described(advice, examples, learned.examples.light, period, command)
    sections = _sections(advice, record)  # before anything is written
    _write_codes(advice, out, record, overwrite)
    write_json(record, out / "design.json", overwrite=overwrite)
    title = f"Codes for a {advice.best.design.camera.kind} camera"
    write_report(out / "design.html", title, sections, overwrite=overwrite)
    return advice, record


def _described(
    advice: Advice, examples: Examples, given_light: float, period: int, command: Sequence[str]
) -> dict[str, Any]:
    best = advice.best
    light = measures(best.design.camera)
    return {
        "command": " ".join(command), "commit": repository_commit(), "advice": code_advice(advice),
        "multiplex": advice.multiplex, "more_slots": advice.more_slots, "within": advice.within,
        "sensor": asdict(advice.sheet), "most_slots": advice.sheet.most_slots,
        "noise": {"read": advice.noise[0], "shot": advice.noise[1]}, "period": period,
        "device": str(examples.device),
        "camera": best.design.camera.kind, "buckets": best.design.camera.buckets, "channels": examples.model.block[0],
        "light": examples.light, "examples_light": given_light,
        "block": list(examples.model.block), "scenes": list(examples.scenes),
        "best": {**_row(best), "held_out": best.held_out, "gains": best.gains,
                 "contrast": light.contrast, "band_likeness": light.likeness, "coherence": light.coherence,
                 "levels": {f"{level:g}": share for level, share in light.levels.items()}},
        "static": _row(advice.static), "designs": [_row(candidate) for candidate in advice.finals],
        "chosen": None if advice.chosen is None else _row(advice.chosen), "files": _files(advice),
        "surveyed": [_row(candidate) for candidate in advice.surveyed],
    }  # fmt: skip


def _row(candidate: Candidate) -> dict[str, Any]:
    """A design for tables and files."""
    design = candidate.design
    return {
        "codes": design.kind, "slots": design.slots, "readings": design.camera.buckets, "expected_psnr": design.psnr,
        "random_psnr": decibels(design.random),
        "held_out_psnr": candidate.psnr, "gain": candidate.gain,
        "spread": candidate.spread, "throughput": design.camera.throughput(), "seconds": design.seconds,
    }  # fmt: skip


def _write_codes(advice: Advice, out: Path, record: Mapping[str, Any], overwrite: bool) -> None:
    """One period of the codes: stacks of 0 and 255 for devices and ImageJ, and both planes with labels; of those that
    are not recommended the planes alone."""
    camera = advice.best.design.camera
    for name, tile in zip(("aperture", "shutter"), _tiles(camera), strict=True):
        with atomic_path(out / f"{name}.tif", overwrite=overwrite) as temporary:
            temporary.write_bytes(
                tiff_bytes(255 * tile.numpy().astype(np.uint8), imagej=True, metadata={"axes": "TYX"})
            )
    notes = {"advice": record["advice"], "sensor": record["sensor"], CODES_DATE: now()}
    period = (int(record["period"]), int(record["period"]))
    written = _files(advice)
    for name, each in _searched(advice).items():
        shown = each.design.camera
        write_codes(out / name, *_tiles(shown), period, notes, buckets=shown.buckets, overwrite=overwrite)
    for file in list(out.iterdir()) if overwrite else ():  # of an earlier design
        if file.name not in written and (file.name == "burst.nc" or _OF_SLOTS.fullmatch(file.name)):
            file.unlink()


def _searched(advice: Advice) -> dict[str, Candidate]:
    """Names of files, and the codes that they hold: the recommended ones, the static ones, the best of several slots,
    and the rival."""
    files = {"codes.nc": advice.best, "codes_k1.nc": advice.static}
    if advice.chosen is not None:
        files.setdefault(f"codes_k{advice.chosen.design.slots}.nc", advice.chosen)
    return files if advice.burst is None else {**files, "burst.nc": advice.burst}


def _files(advice: Advice) -> dict[str, dict[str, Any]]:
    """Names of files of codes → their kind and slots."""
    return {name: {"codes": each.design.kind, "slots": each.design.slots} for name, each in _searched(advice).items()}


def _tiles(camera: CodedCamera) -> tuple[Tensor, Tensor]:
    """One period of aperture and shutter."""
    return camera.codes.aperture.tile().detach(), camera.codes.shutter.tile().detach()


def other_files(files: Mapping[str, Mapping[str, Any]]) -> str:
    """What codes.nc holds, and where those are that are not recommended."""
    own = files["codes.nc"]
    text = f"codes.nc holds K = {own['slots']} ({own['codes']})"
    others = [(name, of["slots"]) for name, of in files.items() if _OF_SLOTS.fullmatch(name) and of != own]
    named = [f"the static code is {name}" if k == 1 else f"the best of K = {k} is {name}" for name, k in others]
    return "; ".join([text, *named])


def _light(record: Mapping[str, Any]) -> str:
    """How bright the scenes are taken to be."""
    light, given = record["light"], record["examples_light"]
    if light == given:
        return f"Scenes of mean irradiance {given:.3g} (white = 1), as given; dimmed ones see more noise, see --light."
    changed = "dimmed" if light < given else "lit"
    return (
        f"Judged as if {changed} to a mean irradiance of {light:.3g} (the examples have {given:.3g}, white = 1), by an "
        f"estimate whose prior is {changed} alike; that of tmca reconstruct is not. PSNR counts against white, so "
        "compare gains, not PSNR."
    )


def _training(record: Mapping[str, Any]) -> str:
    """The command that trains a network for the codes."""
    camera = {"slots": record["best"]["slots"], "period": record["period"], "learn": "none"}
    if record["best"]["slots"] == 1:
        camera["shutter"] = "open"
    camera |= {"buckets": record["buckets"]} if record["buckets"] > 1 else {}
    camera |= {"views": round(record["channels"] ** 0.5)} if record["camera"] == "light-field" else {}
    options = " ".join(f"--set camera.{name}={value}" for name, value in camera.items())
    options += f" --set data.bands={record['channels']}" if record["camera"] == "spectral" else ""
    return f"tmca train {record['camera']} --preset quick --set codes.start=codes.nc {options}"


def _sections(advice: Advice, record: Mapping[str, Any]) -> list[Section]:
    designs, several = columns_of(record), len(advice.best.held_out) > 1
    survey = ["A survey with less effort; gains are over its own static code, the first row."]
    caption = "Gain over the static code" + (", and its spread over the scenes" if several else "")
    return [
        Section("Advice", _about(advice, record), record["designs"], designs, points=advice_lines(advice)),
        Section("Every number of slots", survey, record["surveyed"], designs, {caption: _gains(advice)}),
        *([_each_scene(advice)] if several else []),
        Section("The codes", _about_files(advice, record),
                figures={"One period": advice.best.design.camera.plot(record["period"])}),
    ]  # fmt: skip


def _about(advice: Advice, record: Mapping[str, Any]) -> list[str]:
    """Paragraphs on the sensor, and on how designs were judged."""
    sheet = {name: value for name, value in record["sensor"].items() if value not in (None, 0.0)}
    channel, (read, shot) = advice.best.design.camera.channel, advice.noise
    about = [
        "Sensor: " + ", ".join(f"{name} {value:g}" for name, value in sheet.items()) + ".",
        f"In snapshot units (1 = one {channel} of a white scene): read noise {read:.3g}, shot variance {shot:.3g} per "
        f"unit. {_light(record)}",
        "Expected PSNR is that of the best linear estimate under the scenes' Gaussian prior, block by block, before "
        "anything is captured. Codes are searched for all scenes; "
        + ("gains are those of each scene when the estimate knows only the others." if len(advice.best.held_out) > 1
           else "with one scene the prior knows what it is judged on, and gains may be too large."),
    ]  # fmt: skip
    if advice.burst is not None:
        about.append(
            "A burst is static frames with an aperture each, one after the other within the same time: it loses no "
            "light either. Each bucket and each frame has its own read noise and its own full well."
        )
    return about


def _each_scene(advice: Advice) -> Section:
    scenes = [
        {"scene": name, "static": advice.static.held_out[name], "own": value, "gain": advice.best.gains[name]}
        for name, value in advice.best.held_out.items()
    ]
    columns = [("scene", "scene", ""), ("static", "static (dB)", ".2f"), ("own", "recommended (dB)", ".2f")]
    return Section("Scene by scene", [], scenes, [*columns, ("gain", "gain (dB)", "+.2f")])


def _about_files(advice: Advice, record: Mapping[str, Any]) -> list[str]:
    """Paragraphs on what is done with the files of codes."""
    codes = [f"Take them along: tmca simulate {record['camera']} SCENE --codes codes.nc; train a network for them: "
             f"{_training(record)}."]  # fmt: skip
    codes += [other_files(record["files"])]
    return codes + (["Those of the burst, to compare with: --codes burst.nc."] if advice.burst is not None else [])


def _gains(advice: Advice) -> Figure:
    surveyed: dict[str, list[Gain]] = {}
    for candidate in advice.surveyed:
        if candidate.design.kind != "static":
            surveyed.setdefault(candidate.design.kind, []).append(_gain(candidate))
    label = ("recommended, " if advice.multiplex else "") + "searched longer, over its own static code"
    chosen = None if advice.chosen is None else (label, _gain(advice.chosen))
    several = len(advice.static.held_out) > 1
    title = "each scene under the prior of the others" if several else "expected of the example scene"
    return gains_figure({kind: sorted(gains) for kind, gains in surveyed.items()}, title, chosen)


def _gain(candidate: Candidate) -> Gain:
    return candidate.design.slots, candidate.gain, candidate.spread or 0.0
