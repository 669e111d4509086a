"""Codes for a sensor: searched, judged on example scenes, written as files with a page that explains them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tmca.cameras import CodedCamera
from tmca.codes import write_codes
from tmca.design import (
    Advice,
    Effort,
    Examples,
    SensorSheet,
    advise,
    design_model,
    designable,
    learn_examples,
    measures,
)
from tmca.design.flips import tile_bytes
from tmca.design.kinds import check_kind
from tmca.errors import DataError, SettingError
from tmca.experiments.camera_figures import codes_figure
from tmca.experiments.design_figures import gains_figure
from tmca.experiments.report import Section, write_report
from tmca.experiments.results import check_new, repository_commit
from tmca.experiments.scenes import load_scene

FILES = ("design.json", "design.html", "aperture.tif", "shutter.tif", "codes.nc")
COLUMNS = (
    ("codes", "codes", ""),
    ("slots", "K", "d"),
    ("expected_psnr", "expected PSNR (dB)", ".2f"),
    ("random_psnr", "random codes (dB)", ".2f"),
    ("held_out_psnr", "each scene under the prior of the others (dB)", ".2f"),
    ("gain", "gain over static (dB)", "+.2f"),
    ("spread", "± from scene to scene", ".2f"),
    ("throughput", "light", ".1%"),
    ("seconds", "CPU seconds", ".0f"),
)
_RENDERED_SIZE = (256, 256)
_MOST_BYTES, _MOST_PIXELS = 4e9, 2**20


def design_spectral(
    sheet: SensorSheet,
    out: Path,
    *,
    scenes: Sequence[str] = (),
    bands: int = 12,
    slots: Sequence[int] | None = None,
    kinds: Sequence[str] = ("free", "one-hot"),
    period: int = 32,
    effort: Effort | None = None,
    throughput: float | None = None,
    light: float | None = None,
    seed: int = 0,
    reading: Mapping[str, Any] | None = None,
    overwrite: bool = False,
    progress: Callable[[float, str], None] | None = None,
    command: Sequence[str] = (),
    **camera: Any,
) -> tuple[Advice, dict[str, Any]]:
    """Search codes for a sensor and write them to a folder.

    Args:
        sheet: sensor and modulator.
        out: folder of ``design.json``, ``design.html``, ``aperture.tif``, ``shutter.tif`` and ``codes.nc``.
        scenes: to design for, files or rendered scenes; the rendered training scenes without any.
        bands: number of bands from 400 to 700 nm.
        slots: numbers of slots to try; those that fit without.
        kinds: structures of codes to try.
        period: side of the tile of codes, pixels.
        effort: of the last searches.
        throughput: share of light that all codes shall let through; free if None.
        light: mean irradiance of the scenes to come, share of white; as bright as the examples if None.
        seed: of random codes.
        reading: further arguments of ``load_scene``.
        overwrite: replace files that exist.
        progress: told the share that is done and what is done.
        command: how it was called, kept in the files.
        camera: further arguments of ``SpectralCamera``.

    Returns:
        The advice, and what ``design.json`` holds.

    Raises:
        SettingError: impossible sensor, slots, kinds or period.
        DataError, ShapeError: scenes that cannot be used, or that are too small.
        OutputError: files exist.
    """
    from tmca.data import make_folder, write_json

    check_new((out / name for name in FILES), overwrite)
    _check(sheet, slots, kinds, period, seed, throughput, light, {"bands": bands, **camera})
    for name in scenes:
        if list(scenes).count(name) > 1:
            raise DataError(name, "the same scene twice", "each scene once", "leave one out")
    if out.exists():
        make_folder(out)  # refuses a file of this name before anything is searched
    told = progress or (lambda share, step: None)
    examples, wavelengths = _examples(scenes, bands, camera, reading or {}, told)
    examples = examples if light is None else examples.under(light)
    camera = {"bands": wavelengths, **camera}
    advice = advise(
        examples, sheet, slots=slots, kinds=kinds, period=(period, period), effort=effort, throughput=throughput,
        seed=seed, progress=lambda share, step: told(0.3 + 0.68 * share, step), **camera,
    )  # fmt: skip
    make_folder(out)
    found = _described(advice, examples, period, command)
    sections = _sections(advice, found)  # before anything is written
    _write_codes(advice.best.design.camera, out, found, overwrite)
    write_json(found, out / "design.json", overwrite=overwrite)
    write_report(out / "design.html", "Codes for a spectral camera", sections, overwrite=overwrite)
    return advice, found


def _check(
    sheet: SensorSheet,
    slots: Sequence[int] | None,
    kinds: Sequence[str],
    period: int,
    seed: int,
    throughput: float | None,
    light: float | None,
    camera: Mapping[str, Any],
) -> None:
    """Refuse what cannot be searched, before scenes are read."""
    if period < 1:
        raise SettingError("--period", str(period), "1 pixel or more")
    if seed < 0:
        raise SettingError("--seed", str(seed), "0 or more")
    for name, share in (("--throughput", throughput), ("--light", light)):
        if share is not None and not 0 < share < 1:
            raise SettingError(name, f"{share:g}", "a share between 0 and 1")
    needed = tile_bytes(design_model(designable("static", 1, (8, 8), **camera).taps()), (period, period))
    if needed > _MOST_BYTES:
        found = f"{period}, {needed / 1e9:.1f} GB for the blocks of one tile"
        raise SettingError(
            "--period", found, f"at most {_MOST_BYTES / 1e9:g} GB", "take a smaller period or fewer bands"
        )
    for k in sheet.allowed(slots):
        if k * period**2 > _MOST_PIXELS:
            found = f"{k} slots of {period}×{period} pixels"
            raise SettingError(
                "--slots", found, f"at most {_MOST_PIXELS} code pixels", "take fewer or a smaller period"
            )
    for kind in kinds:
        check_kind(kind)
    if "static" in kinds:
        raise SettingError("--kinds", "static", "codes of several slots", "the static code is always searched")


def _examples(
    scenes: Sequence[str],
    bands: int,
    camera: Mapping[str, Any],
    reading: Mapping[str, Any],
    told: Callable[[float, str], None],
) -> tuple[Examples, list[float]]:
    """Example scenes as priors of the blocks that designs are judged on."""
    from tmca.data import split_rendered

    names = list(scenes) or sorted(split_rendered()["train"])
    cubes: dict[str, torch.Tensor] = {}
    wavelengths: list[float] = []
    for place, name in enumerate(names):
        told(0.3 * place / len(names), f"reading {name}")
        cube = load_scene(name, bands=bands, size=None if scenes else _RENDERED_SIZE, **reading)
        own = cube["wavelength"].values.tolist()
        if wavelengths and (len(own) != len(wavelengths) or max(map(_apart, own, wavelengths)) > 1e-9):
            raise DataError(name, "other wavelengths", f"those of {names[0]}", "choose scenes of the same bands")
        wavelengths = wavelengths or own
        label = name if Path(name).stem in cubes else Path(name).stem
        cubes[label] = torch.from_numpy(np.ascontiguousarray(cube.values))
    one = designable("static", 1, (8, 8), **{"bands": wavelengths, **camera})
    told(0.2, "learning what the scenes have in common")
    return learn_examples(cubes, design_model(one.taps()), wavelengths), wavelengths


def _apart(one: float, other: float) -> float:
    return abs(one - other)


def _described(advice: Advice, examples: Examples, period: int, command: Sequence[str]) -> dict[str, Any]:
    best = advice.best
    light = measures(best.design.camera)
    return {
        "command": " ".join(command), "commit": repository_commit(), "advice": advice.sentence(),
        "multiplex": advice.multiplex, "sensor": asdict(advice.sheet), "most_slots": advice.sheet.most_slots,
        "noise": {"read": advice.noise[0], "shot": advice.noise[1]}, "period": period, "bands": examples.model.block[0],
        "light": examples.light,
        "block": list(examples.model.block), "scenes": list(examples.scenes),
        "best": {**best.row(), "held_out": best.held_out, "gains": best.gains,
                 "contrast": light.contrast, "band_likeness": light.likeness, "coherence": light.coherence,
                 "levels": {f"{level:g}": share for level, share in light.levels.items()}},
        "static": advice.static.row(),
        "chosen": None if advice.chosen is None else advice.chosen.row(),
        "surveyed": [candidate.row() for candidate in advice.surveyed],
    }  # fmt: skip


def _write_codes(camera: CodedCamera, out: Path, found: Mapping[str, Any], overwrite: bool) -> None:
    """One period of the codes: stacks of 0 and 255 for devices and ImageJ, and both planes with labels."""
    import tifffile

    from tmca.data import atomic_path

    codes = camera.multiplexed
    aperture, shutter = codes.aperture.tile().detach(), codes.shutter.tile().detach()
    for name, tile in (("aperture", aperture), ("shutter", shutter)):
        with atomic_path(out / f"{name}.tif", overwrite=overwrite) as temporary:
            tifffile.imwrite(temporary, 255 * tile.numpy().astype(np.uint8), imagej=True, metadata={"axes": "TYX"})
    notes = {"advice": found["advice"], "sensor": found["sensor"]}
    period = (int(found["period"]), int(found["period"]))
    write_codes(out / "codes.nc", aperture, shutter, period, notes, overwrite=overwrite)


def _training(found: Mapping[str, Any]) -> str:
    """The command that trains a network for the codes."""
    camera = {"slots": found["best"]["slots"], "period": found["period"], "learn": "none"}
    if found["best"]["slots"] == 1:
        camera["shutter"] = "open"
    told = " ".join(f"--set camera.{name}={value}" for name, value in camera.items())
    return f"tmca train spectral --preset quick --set data.bands={found['bands']} --set codes.start=codes.nc {told}"


def _sections(advice: Advice, found: Mapping[str, Any]) -> list[Section]:
    final = [found["static"], *([found["chosen"]] if found["chosen"] else [])]
    scenes = [
        {"scene": name, "static": advice.static.held_out[name], "own": value, "gain": advice.best.gains[name]}
        for name, value in advice.best.held_out.items()
    ]
    sheet = {name: value for name, value in found["sensor"].items() if value not in (None, 0.0)}
    read, shot = advice.noise
    about = [
        advice.sentence(),
        "Sensor: " + (", ".join(f"{name} {value:g}" for name, value in sheet.items()) or "no noise") + ".",
        f"In snapshot units (1 = one band of a white scene): read noise {read:.3g}, shot variance {shot:.3g} per unit. "
        f"Scenes of mean irradiance {found['light']:.3g} (white = 1); darker ones see more noise, see --light.",
        "Expected PSNR is that of the best linear estimate under the scenes' Gaussian prior, block by block, before "
        "anything is captured. Codes are searched for all scenes; gains are those of each scene when the estimate "
        "knows only the others.",
    ]
    columns = [("scene", "scene", ""), ("static", "static (dB)", ".2f"), ("own", "recommended (dB)", ".2f")]
    survey = ["A survey with less effort; gains are over its own static code, the first row."]
    codes = ["Take them along: tmca simulate spectral SCENE --codes codes.nc; train a network for them: "
             f"{_training(found)}."]  # fmt: skip
    return [
        Section("Advice", about, final, COLUMNS),
        Section("Every number of slots", survey, found["surveyed"], COLUMNS,
                {"Gain over the static code, and its spread over the scenes": gains_figure(advice)}),
        Section("Scene by scene", [], scenes, [*columns, ("gain", "gain (dB)", "+.2f")]),
        Section("The codes", codes, figures={"One period": codes_figure(advice.best.design.camera)}),
    ]  # fmt: skip
