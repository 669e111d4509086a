"""Every real capture of a data folder, decoded and judged; what was computed once is kept and used again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

import numpy as np

from studies.bench import (
    PixelShutter,
    SingleDisperser,
    block_shifts,
    explained,
    fine_part,
    flattened,
    import_capture,
    load_prototype,
    register_mask,
    registered,
)
from studies.real.decoding import stored_estimate
from studies.real.geometry import explained_share, light_by_offset, mask_evidence, order_evidence
from studies.real.merit import (
    agreement,
    brightest_rows,
    neighbours_error,
    prediction_error,
    reprojection_error,
    withheld,
)
from studies.real.movies import study_movie
from studies.real.records import Geometry, MovieRow, PairRow, SceneRow
from tmca.cameras import Snapshot, SpectralCamera
from tmca.data import read_array
from tmca.decoders import Weights
from tmca.errors import DataError

Spectra = dict[str, np.ndarray]
"""Arrays by the name of a decoder, of a point, of a capture."""
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
    estimates: Spectra = field(default_factory=dict)
    rows: list[SceneRow] = field(default_factory=list)
    pairs: list[PairRow] = field(default_factory=list)
    mask_spectra: Spectra = field(default_factory=dict)


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
    """Decode one capture with every decoder, whole and without the pixels that it has to predict."""
    prototype = single_disperser()
    scene = Scene(name, import_capture(folder / f"tsa/{name}.mat", prototype, folder / MASK))
    operator, part = scene.snapshot.camera.operator(), brightest_rows(scene.snapshot, _ROWS)
    blind, hidden = withheld(part)
    for decoder in decoders:
        told(f"{name}: {decoder}")
        cube, seconds = stored_estimate(keep, f"{name}_{decoder}", scene.snapshot, decoder, weights)
        guess, _ = stored_estimate(keep, f"{name}_{decoder}_withheld", blind, decoder, weights)
        scene.estimates[decoder] = cube.numpy()[0]
        row: SceneRow = {
            "scene": name, "decoder": decoder, "seconds": seconds,
            "reprojection": reprojection_error(operator, cube, scene.snapshot.values),
            "withheld": prediction_error(part.camera.operator(), guess, part.values, hidden),
            "neighbours": neighbours_error(part.values, hidden),
        }  # fmt: skip
        scene.rows.append(row)
    for one, other in combinations(decoders, 2):
        psnr, sam = agreement(scene.estimates[one], scene.estimates[other])
        scene.pairs.append({"scene": name, "one": one, "other": other, "psnr": psnr, "sam": sam})
    scene.mask_spectra = _mask_spectra(folder, scene, prototype)
    return scene


def _mask_spectra(folder: Path, scene: Scene, prototype: SingleDisperser) -> Spectra:
    """Spectral density around the points by regression on the mask's copies alone."""
    capture = read_array(folder / f"tsa/{scene.name}.mat", prototype.capture_key)
    mask = fine_part(registered(read_array(folder / MASK, prototype.mask_key), prototype.registration))
    flat, found = fine_part(flattened(capture, prototype.black)), Spectra()
    step, bands = int(prototype.pixels_per_band), len(prototype.wavelengths_nm)
    offsets = range(0, step * bands, step)
    for name, (row, column) in prototype.points.get(scene.name, {}).items():
        top, left = row - 24, column + step * bands // 2 - 32
        _, weights = explained(flat[top : top + 48, left : left + 64], mask, top, left, offsets)
        found[name] = weights.clip(0) / prototype.response_of_bands()
    return found


def study_geometry(folder: Path) -> tuple[Geometry, Spectra]:
    """What the captures say of mask, displacement and order, and the blocks behind the registration."""
    prototype = single_disperser()
    captures = [read_array(folder / f"tsa/{name}.mat", prototype.capture_key).astype(float) for name in SCENES]
    mask = read_array(folder / MASK, prototype.mask_key).astype(float)
    in_register = registered(mask, prototype.registration)
    step, bands, black = int(prototype.pixels_per_band), len(prototype.wavelengths_nm), prototype.black
    offsets, wide = range(0, step * bands, step), list(range(-8, bands * step + 10, step))
    registration, deviation = register_mask(captures, mask, offsets, black=black)
    blocks = {name: block_shifts(one, mask, offsets, black=black) for name, one in zip(SCENES, captures, strict=True)}
    found: Geometry = {
        "explained": mask_evidence(captures, mask, offsets, black),
        "explained_registered": explained_share(captures, in_register, offsets, black),
        "offsets": wide,
        "light": light_by_offset(captures, in_register, wide, black).tolist(),
        "registration": registration.model_dump(),
        "deviation": deviation,
        "order": {
            name: order_evidence(import_capture(folder / f"tsa/{name}.mat", prototype, folder / MASK))
            for name in SCENES
        },
    }
    return found, blocks


def study_movies(folder: Path, told: Told) -> tuple[list[MovieRow], Spectra, Spectra]:
    """Rows, frames and captures behind the pixel shutter."""
    prototype = load_prototype("pixel-shutter-wine")
    assert isinstance(prototype, PixelShutter)
    rows, frames, captures = list[MovieRow](), Spectra(), Spectra()
    for name in prototype.captures:
        told(f"wine, {name}")
        taken = import_capture(folder / WINE / "wine.mat", prototype, name=name)
        movie_rows, movies = study_movie(taken, name)
        rows += movie_rows
        for method, movie in movies.items():
            frames[f"{name}, {method}"] = movie
            captures[f"{name}, {method}"] = taken.values[0, 0].numpy()
    return rows, frames, captures
