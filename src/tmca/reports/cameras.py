"""Codes and masks for a sensor, camera by camera: the scenes that they are designed for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
import torch

from tmca.arguments import Ints, Kind, Names, Seed, checked
from tmca.cameras import LightFieldCamera
from tmca.data.light_field_scenes import NOTHING, Reading, check_asked, read_middle
from tmca.data.scenes import DarkScene, load_scene
from tmca.design import Advice, Examples, MaskAdvice, SensorSheet, design_model, designable, learn_examples
from tmca.errors import DataError, SettingError, check_choice
from tmca.optics import view_grid
from tmca.priors import views_of
from tmca.reports.codes import Learned, Told, named_once, search_codes
from tmca.reports.masks import design_spectral_depth
from tmca.sensor import Sensor

_RENDERED_SIZE = (256, 256)


@checked
def design_codes(
    camera: Kind = "spectral",
    *,
    out: str | Path,
    scenes: Names = (),
    sensor: Mapping[str, Any] | SensorSheet | Sensor | None = None,
    slots: Ints | None = None,
    seed: Seed = 0,
    overwrite: bool = False,
    progress: Callable[[float, str], None] | None = None,
    **how: Any,
) -> Advice | MaskAdvice:
    """Search codes for a sensor, say what they gain over static ones, and write them to a folder.

    Args:
        camera: kind of the camera, such as ``SpectralCamera.kind``.
        out: folder of ``design.json``, ``design.html`` and ``codes.nc``, which cameras take.
        scenes: to design for, files or rendered scenes; the rendered training scenes without any.
        sensor: of a camera, or with its modulator: arguments of `tmca.design.SensorSheet`, which are ``full_well``,
            ``read_noise_electrons``, ``exposure``, ….
        slots: numbers of slots to try; those that fit the exposure if None.
        seed: of random codes.
        overwrite: replace files that exist.
        progress: called with the share that is done and what is done next.
        how: further settings of a camera's search, such as ``kinds``, ``period``, ``throughput`` and ``effort``, or of
            masks ``mask``, ``learn`` and ``window``.

    Raises:
        SettingError, DataError, OutputError: an impossible setting, scenes that cannot be used, files that exist.
    """
    check_choice("camera", camera, DESIGNS)
    sheet = _sheet(sensor)
    advice: Advice | MaskAdvice = DESIGNS[camera](
        sheet, Path(out), scenes=scenes, slots=slots, seed=seed, overwrite=overwrite, progress=progress, **how
    )[0]
    return advice


def _sheet(sensor: Mapping[str, Any] | SensorSheet | Sensor | None) -> SensorSheet:
    if isinstance(sensor, SensorSheet):
        return sensor
    if isinstance(sensor, Sensor):
        sensor = {name: value for name, value in sensor.settings().items() if name in vars(SensorSheet())}
    return SensorSheet(**(sensor or {}))


@checked
def design_spectral(
    sheet: SensorSheet,
    out: Path,
    *,
    scenes: Sequence[str] = (),
    bands: int = 12,
    reading: Mapping[str, Any] | None = None,
    camera: Mapping[str, Any] | None = None,
    **how: Any,
) -> tuple[Advice, dict[str, Any]]:
    """Search codes for a sensor and write them to a folder; ``search_codes`` says what is not said here.

    Args:
        sheet: sensor and modulator.
        out: folder of the results.
        scenes: to design for, files or rendered scenes; the rendered training scenes without any.
        bands: number of bands from 400 to 700 nm.
        reading: further arguments of ``load_scene``.
        camera: further arguments of ``SpectralCamera``.
        how: further arguments of ``search_codes``.
    """
    from tmca.data import split_rendered

    named_once(scenes)
    own, names = dict(camera or {}), list(scenes) or sorted(split_rendered()["train"])
    how_read = {"size": None if scenes else _RENDERED_SIZE, **(reading or {})}

    def learn(told: Told) -> Learned:
        examples, wavelengths = _examples(names, bands, own, how_read, told)
        return Learned(examples, {"bands": wavelengths, **own})

    return search_codes(sheet, out, learn, {"bands": bands, **own}, len(names), **how)


def _examples(
    names: Sequence[str],
    bands: int,
    camera: Mapping[str, Any],
    reading: Mapping[str, Any],
    told: Told,
) -> tuple[Examples, list[float]]:
    """Example scenes as priors of the blocks that designs are judged on."""
    cubes: dict[str, torch.Tensor] = {}
    wavelengths: list[float] = []
    for place, name in enumerate(names):
        told(0.2 * place / len(names), f"reading {name}")
        with catch_warnings():
            simplefilter("ignore", DarkScene)  # which are refused by name when all are read
            cube = load_scene(name, bands=bands, **reading)
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


@checked
def design_light_field(
    sheet: SensorSheet,
    out: Path,
    *,
    scenes: Sequence[str] = (),
    views: int = 5,
    reading: Reading = NOTHING,
    camera: Mapping[str, Any] | None = None,
    **how: Any,
) -> tuple[Advice, dict[str, Any]]:
    """Search codes for a sensor and write them to a folder; ``search_codes`` says what is not said here.

    Args:
        sheet: sensor and modulator.
        out: folder of the results.
        scenes: to design for, what ``load_light_field`` reads; the rendered training light fields without any.
        views: n for the centre n×n views.
        reading: of light fields from files.
        camera: further arguments of ``LightFieldCamera``.
        how: further arguments of ``search_codes``.

    Raises:
        SettingError: a scale below 1; what ``search_codes`` refuses.
    """
    from tmca.data import split_rendered_light_fields

    named_once(scenes)
    if reading.scale is not None and reading.scale < 1:
        raise SettingError("--scale", str(reading.scale), "1 or more pixels that are averaged into one")
    check_asked(scenes, **vars(reading))
    names = list(scenes) or sorted(split_rendered_light_fields()["train"])
    own = {"camera_type": LightFieldCamera, "views": view_grid(views), **(camera or {})}

    def learn(told: Told) -> Learned:
        fields = _light_fields(names, views, reading, told)
        told(0.2, "learning what the light fields have in common")
        one = designable("static", 1, (8, 8), **own)
        return Learned(learn_examples(fields, design_model(one.taps()), None, views=own["views"]), own)

    return search_codes(sheet, out, learn, own, len(names), **how)


def _light_fields(names: Sequence[str], views: int, reading: Reading, told: Told) -> dict[str, Any]:
    """(V·U, H, W) of every light field in grey, by name."""
    found: dict[str, Any] = {}
    for place, name in enumerate(names):
        told(0.2 * place / len(names), f"reading {name}")
        field = read_middle(name, views, reading)
        found[Path(name).stem if Path(name).stem not in found else name] = views_of(field)[0].flatten(0, 1)
    return found


DESIGNS: dict[str, Callable[..., tuple[Any, dict[str, Any]]]] = {
    "spectral": design_spectral,
    "light-field": design_light_field,
    "spectral-depth": design_spectral_depth,
}
"""The search of every camera."""
