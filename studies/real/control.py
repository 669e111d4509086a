"""Merit without a truth held against the truth: known scenes behind the mask of a real capture, with its noise."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor

from studies.bench import scene_at
from studies.real.decoding import stored_estimate
from studies.real.merit import neighbours_error, part_of, prediction_error, withheld
from studies.real.records import ControlRow
from studies.real.study import Told, first_capture
from tmca.cameras import Snapshot, SpectralCamera
from tmca.decoders import Weights
from tmca.errors import DataError
from tmca.metrics import psnr, sam

_LARGEST = 256
"""Rows and columns of a scene at most, its middle."""


def known_scene(name: str, camera: SpectralCamera) -> Tensor:
    """(1, L, H, W): the middle of a scene at the bands of a camera, interpolated along the spectrum.

    Args:
        name: of a rendered scene, or a file.
        camera: of the captures.

    Raises:
        DataError: no such scene, or one that does not reach the first or last band.
    """
    cube = scene_at(name, camera.wavelengths)
    sides = [min(cube.sizes[axis], own, _LARGEST) for axis, own in zip(("y", "x"), camera.size, strict=True)]
    tops = [(cube.sizes[axis] - side) // 2 for axis, side in zip(("y", "x"), sides, strict=True)]
    middle = cube.isel(y=slice(tops[0], tops[0] + sides[0]), x=slice(tops[1], tops[1] + sides[1]))
    if not float(middle.max()) > 0:
        raise DataError(name, "no light in its middle", "a scene to image", "leave it out")
    return torch.from_numpy(middle.values.copy())[None]


def image_behind(capture: Snapshot[SpectralCamera], scene: Tensor) -> Snapshot[SpectralCamera]:
    """A snapshot of a scene (1, L, H, W), dark around, behind the middle of a capture's mask, with its noise."""
    height, width = capture.camera.size
    top, left = (height - scene.shape[2]) // 2, (width - scene.shape[3]) // 2
    window = slice(top, top + scene.shape[2]), slice(left, left + scene.shape[3])
    camera = part_of(capture.camera, *window)
    with torch.no_grad():
        return Snapshot(camera(scene, generator=0), camera)


def check_known(names: Sequence[str], folder: Path) -> None:
    """Raises DataError for a scene that cannot be imaged behind the captures' mask."""
    if names:
        camera = first_capture(folder).camera
        for name in names:
            known_scene(name, camera)


def study_control(
    capture: Snapshot[SpectralCamera],
    name: str,
    decoders: Sequence[str],
    weights: Weights | None,
    keep: Path,
    told: Told,
) -> list[ControlRow]:
    """A row per decoder: errors against the truth, and what withheld pixels say of them.

    Args:
        capture: whose mask, optics and noise the scene is seen with.
        name: of a scene, as in `known_scene`.
        decoders: of ``REAL_DECODERS``.
        weights: of the network.
        keep: folder of estimates.
        told: what is done next.
    """
    told(f"{name}, whose truth is known")
    scene = known_scene(name, capture.camera)
    taken, stem = image_behind(capture, scene), Path(name).stem
    operator, (blind, hidden) = taken.camera.operator(), withheld(taken)
    rows: list[ControlRow] = []
    for decoder in decoders:
        cube, _ = stored_estimate(keep, f"{stem}_{decoder}", taken, decoder, weights)
        guess, _ = stored_estimate(keep, f"{stem}_{decoder}_withheld", blind, decoder, weights)
        row: ControlRow = {
            "scene": stem, "decoder": decoder, "psnr": float(psnr(cube, scene)), "sam": float(sam(cube, scene)),
            "withheld": prediction_error(operator, guess, taken.values, hidden),
            "truth": prediction_error(operator, scene, taken.values, hidden),
            "neighbours": neighbours_error(taken.values, hidden),
        }  # fmt: skip
        rows.append(row)
    return rows
