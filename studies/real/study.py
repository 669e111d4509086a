"""Every real capture of a data folder, decoded and judged; what was computed once is kept and used again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from tmca.experiments.real.geometry import geometry, order_evidence
from tmca.experiments.real.kept import kept_estimate
from tmca.experiments.real.merit import (
    agreement,
    brightest_rows,
    foretelling_error,
    neighbours_error,
    reprojection_error,
    withheld,
)
from tmca.experiments.real.movies import study_movie

from tmca.cameras import Snapshot, SpectralCamera
from tmca.data import read_array
from tmca.decoders import Weights
from tmca.errors import DataError
from tmca.lab.importing import import_capture
from tmca.lab.prototype import PixelShutter, SingleDisperser, load_prototype
from tmca.lab.registering import block_shifts, explained, fine_part, flattened, register_mask, registered

MASK, SCENES, WINE = "tsa/mask_660_real.mat", ("real_scene1", "real_scene2", "real_scene3"), "pixel_shutter_wine"
_ROWS = 200
Told = Callable[[str], None]


@dataclass
class Scene:
    """One capture behind the single disperser.

    Args:
        name: stem of its file.
        snapshot: imported.
        estimates: decoder → (L, H, W).
        rows: a row of the table per decoder.
        pairs: agreement of every two decoders.
        mask_spectra: point → (L,) regression on the mask's copies.
    """

    name: str
    snapshot: Snapshot[SpectralCamera]
    estimates: dict[str, np.ndarray] = field(default_factory=dict)
    rows: list[dict[str, Any]] = field(default_factory=list)
    pairs: list[dict[str, Any]] = field(default_factory=list)
    mask_spectra: dict[str, np.ndarray] = field(default_factory=dict)


def captures_folder(data: Path) -> Path:
    """The folder that holds ``tsa/`` and ``pixel_shutter_wine/``: the one given, or ``cassi/`` in it.

    Raises:
        DataError: neither holds them.
    """
    for folder in (data, data / "cassi"):
        if (folder / MASK).is_file():
            return folder
    raise DataError(data, f"no {MASK}", "the folder with tsa/ and pixel_shutter_wine/", "name it with --data")


def single_disperser() -> SingleDisperser:
    """The prototype of the captures in ``tsa/``."""
    found = load_prototype("tsa")
    assert isinstance(found, SingleDisperser)
    return found


def first_capture(folder: Path) -> Snapshot[SpectralCamera]:
    """The first capture of the single disperser, imported."""
    return import_capture(folder / f"tsa/{SCENES[0]}.mat", single_disperser(), folder / MASK)


def study_scene(
    folder: Path, name: str, decoders: Sequence[str], weights: Weights | None, keep: Path, told: Told
) -> Scene:
    """Decode one capture with every decoder, whole and without the pixels that it has to foretell."""
    prototype = single_disperser()
    scene = Scene(name, import_capture(folder / f"tsa/{name}.mat", prototype, folder / MASK))
    operator, values = scene.snapshot.camera.operator(), scene.snapshot.values
    part = brightest_rows(scene.snapshot, _ROWS)
    blind, hidden = withheld(part)
    for decoder in decoders:
        told(f"{name}: {decoder}")
        cube, seconds = kept_estimate(keep, f"{name}_{decoder}", scene.snapshot, decoder, weights)
        guess, _ = kept_estimate(keep, f"{name}_{decoder}_withheld", blind, decoder, weights)
        scene.estimates[decoder] = cube.numpy()[0]
        scene.rows.append(
            {
                "scene": name, "decoder": decoder, "seconds": seconds,
                "reprojection": reprojection_error(operator, cube, values),
                "withheld": foretelling_error(part.camera.operator(), guess, part.values, hidden),
                "neighbours": neighbours_error(part.values, hidden),
            }
        )  # fmt: skip
    for one, other in combinations(decoders, 2):
        scene.pairs.append({"scene": name, "one": one, "other": other, **_agreement(scene, one, other)})
    scene.mask_spectra = _mask_spectra(folder, scene, prototype)
    return scene


def _agreement(scene: Scene, one: str, other: str) -> dict[str, float]:
    return agreement(scene.estimates[one], scene.estimates[other])


def _mask_spectra(folder: Path, scene: Scene, prototype: SingleDisperser) -> dict[str, np.ndarray]:
    """Spectral density around the points by regression on the mask's copies alone."""
    capture = read_array(folder / f"tsa/{scene.name}.mat", prototype.capture_key)
    mask = fine_part(registered(read_array(folder / MASK, prototype.mask_key), prototype.registration))
    flat, found = fine_part(flattened(capture, prototype.black)), {}
    step, bands = int(prototype.pixels_per_band), len(prototype.wavelengths_nm)
    offsets = range(0, step * bands, step)
    for name, (row, column) in prototype.points.get(scene.name, {}).items():
        top, left = row - 24, column + step * bands // 2 - 32
        _, weights = explained(flat[top : top + 48, left : left + 64], mask, top, left, offsets)
        found[name] = weights.clip(0) / prototype.response_of_bands()
    return found


def study_geometry(folder: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What the captures say of mask, displacement and order, and the blocks behind the registration."""
    prototype = single_disperser()
    captures = [read_array(folder / f"tsa/{name}.mat", prototype.capture_key).astype(float) for name in SCENES]
    mask = read_array(folder / MASK, prototype.mask_key).astype(float)
    step, bands, black = int(prototype.pixels_per_band), len(prototype.wavelengths_nm), prototype.black
    offsets = range(0, step * bands, step)
    found = geometry(captures, mask, registered(mask, prototype.registration), bands, step, black)
    registration, deviation = register_mask(captures, mask, offsets, black=black)
    found |= {"registration": registration.model_dump(), "deviation": deviation}
    blocks = {name: block_shifts(one, mask, offsets, black=black) for name, one in zip(SCENES, captures, strict=True)}
    found["order"] = {
        name: order_evidence(import_capture(folder / f"tsa/{name}.mat", prototype, folder / MASK)) for name in SCENES
    }
    return found, blocks


def study_movies(folder: Path, told: Told) -> tuple[list[dict[str, Any]], dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Rows, frames and captures behind the pixel shutter."""
    prototype = load_prototype("pixel-shutter-wine")
    assert isinstance(prototype, PixelShutter)
    rows, frames, captures = [], {}, {}
    for name in prototype.captures:
        told(f"wine, {name}")
        taken = import_capture(folder / WINE / "wine.mat", prototype, name=name)
        own, movies = study_movie(taken)
        rows += [{"capture": name, **row} for row in own]
        for method, movie in movies.items():
            frames[f"{name}, {method}"] = movie
            captures[f"{name}, {method}"] = taken.values[0, 0].numpy()
    return rows, frames, captures
