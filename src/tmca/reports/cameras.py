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
from tmca.data import split_rendered, split_rendered_light_fields
from tmca.data.light_field_scenes import NOTHING, Reading, check_asked, read_middle
from tmca.data.scenes import DarkScene, load_scene
from tmca.design import Advice, Examples, MaskAdvice, Progress, SensorSheet, design_model, designable, learn_examples
from tmca.devices import computing_on
from tmca.errors import DataError, SettingError, check_choice
from tmca.optics import view_grid
from tmca.priors import views_of
from tmca.progress import Asked, reporting
from tmca.reports.codes import Learned, named_once, read_scenes, search_codes
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
    device: str | torch.device | None = None,
    overwrite: bool = False,
    progress: Asked = None,
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
        device: that computes the search, such as ``"cuda"``; the processor if None.
        overwrite: replace files that exist.
        progress: called with the share that is done and what is done next; True for a bar, False for none; None for
            one that is shown after a second in a terminal or a notebook.
        how: further settings of a camera's search, such as ``kinds``, ``period``, ``throughput`` and ``effort``, or of
            masks ``mask``, ``learn`` and ``window``.

    Raises:
        SettingError, DataError, OutputError: an impossible setting, a device that is not there or too small, scenes
            that cannot be used, files that exist.
    """
    check_choice("camera", camera, DESIGNS)
    sheet = _sheet(sensor)
    with computing_on(device), reporting(progress, f"design {Path(out).name}") as report:
        advice: Advice | MaskAdvice = DESIGNS[camera](
            sheet, Path(out), scenes=scenes, slots=slots, seed=seed, overwrite=overwrite, progress=report, **how
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
    named_once(scenes)
    settings, names = dict(camera or {}), list(scenes) or sorted(split_rendered()["train"])
    how_read = {"size": None if scenes else _RENDERED_SIZE, **(reading or {})}

    def learn(progress: Progress) -> Learned:
        examples, wavelengths = _examples(names, bands, settings, how_read, progress)
        return Learned(examples, {"bands": wavelengths, **settings})

    return search_codes(sheet, out, learn, {"bands": bands, **settings}, len(names), **how)


def _examples(
    names: Sequence[str],
    bands: int,
    camera: Mapping[str, Any],
    reading: Mapping[str, Any],
    progress: Progress,
) -> tuple[Examples, list[float]]:
    """Example scenes as priors of the blocks that designs are judged on."""
    wavelengths: list[float] = []

    def read(name: str) -> torch.Tensor:
        with catch_warnings():
            simplefilter("ignore", DarkScene)  # which are refused by name when all are read
            cube = load_scene(name, bands=bands, **reading)
        stored = cube["wavelength"].values.tolist()
        if wavelengths and (len(stored) != len(wavelengths) or not np.allclose(stored, wavelengths, 0, 1e-9)):
            raise DataError(name, "other wavelengths", f"those of {names[0]}", "choose scenes of the same bands")
        wavelengths[:] = wavelengths or stored
        return torch.from_numpy(np.ascontiguousarray(cube.values))

    cubes = read_scenes(names, read, lambda share, step: progress(0.2 * share, step))
    one = designable("static", 1, (8, 8), **{"bands": wavelengths, **camera})
    progress(0.2, "learning what the scenes have in common")
    return learn_examples(cubes, design_model(one.taps()), wavelengths), wavelengths


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
    named_once(scenes)
    if reading.scale is not None and reading.scale < 1:
        raise SettingError("scale", str(reading.scale), "1 or more pixels that are averaged into one")
    check_asked(scenes, **vars(reading))
    names = list(scenes) or sorted(split_rendered_light_fields()["train"])
    settings = {"camera_type": LightFieldCamera, "views": view_grid(views), **(camera or {})}

    def learn(progress: Progress) -> Learned:
        def read(name: str) -> torch.Tensor:
            return views_of(read_middle(name, views, reading))[0].flatten(0, 1)

        fields = read_scenes(names, read, lambda share, step: progress(0.2 * share, step))
        progress(0.2, "learning what the light fields have in common")
        one = designable("static", 1, (8, 8), **settings)
        return Learned(learn_examples(fields, design_model(one.taps()), None, views=settings["views"]), settings)

    return search_codes(sheet, out, learn, settings, len(names), **how)


DESIGNS: dict[str, Callable[..., tuple[Any, dict[str, Any]]]] = {
    "spectral": design_spectral,
    "light-field": design_light_field,
    "spectral-depth": design_spectral_depth,
}
"""The search of every camera."""
