"""Codes of a spectral camera for a sensor: the scenes that they are designed for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
import torch

from tmca.data.scenes import DarkScene, load_scene
from tmca.design import Advice, Examples, SensorSheet, design_model, designable, learn_examples
from tmca.errors import DataError
from tmca.experiments.design.checks import named_once
from tmca.experiments.design.codes import Learned, Told, design_codes

_RENDERED_SIZE = (256, 256)


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
    """Search codes for a sensor and write them to a folder; ``design_codes`` says what is not said here.

    Args:
        sheet: sensor and modulator.
        out: folder of the results.
        scenes: to design for, files or rendered scenes; the rendered training scenes without any.
        bands: number of bands from 400 to 700 nm.
        reading: further arguments of ``load_scene``.
        camera: further arguments of ``SpectralCamera``.
        how: further arguments of ``design_codes``.
    """
    from tmca.data import split_rendered

    named_once(scenes)
    own, names = dict(camera or {}), list(scenes) or sorted(split_rendered()["train"])
    how_read = {"size": None if scenes else _RENDERED_SIZE, **(reading or {})}

    def learn(told: Told) -> Learned:
        examples, wavelengths = _examples(names, bands, own, how_read, told)
        return Learned(examples, {"bands": wavelengths, **own})

    return design_codes(sheet, out, learn, {"bands": bands, **own}, len(names), **how)


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
