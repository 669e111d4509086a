"""What lies beside an exported decoder: its files, its camera, and how another camera is known from it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from pydantic import BaseModel, Field, ValidationError

from tmca.cameras import SpectralCamera
from tmca.data import write_json
from tmca.decoders.nets.weights import same_bands
from tmca.errors import DataError
from tmca.operators import TapOperator, Taps

NAME = "decoder.json"
_UNITS = "1 is one band of a white scene through open codes"
_TURNS = (0.6180339887, 0.4142135624, 0.7320508076, 0.2360679775)
"""Turns from row to row of the waves on which codes are projected: irrational, so that no regular code is missed."""
_SAME = 1e-5
"""Share of the codes' norm by which their projections may differ: a hundred times the rounding of 32-bit floats, a
fiftieth of what one closed pixel of ten million changes."""


class DecoderFile(BaseModel):
    """One file of an exported decoder, and its largest difference from the network's estimate."""

    format: str
    file: str
    error: float


class Description(BaseModel):
    """An exported decoder.

    Args:
        weights: file of the network.
        snapshot: (1, 1, H, W').
        scene: (1, L, H, W).
        wavelengths_m: of the bands, metres.
        read_noise, shot_noise: that the network is told, snapshot units.
        units: of the snapshot, in words.
        codes: of `code_marks`.
        files: one per format.
    """

    weights: str
    snapshot: tuple[int, int, int, int]
    scene: tuple[int, int, int, int]
    wavelengths_m: tuple[float, ...] = Field(min_length=1)
    read_noise: float = Field(ge=0, allow_inf_nan=False)
    shot_noise: float = Field(ge=0, allow_inf_nan=False)
    units: str = _UNITS
    codes: tuple[float, ...] = Field(min_length=2 * len(_TURNS) + 1, max_length=2 * len(_TURNS) + 1)
    files: tuple[DecoderFile, ...] = Field(min_length=1)


def code_marks(taps: Taps) -> list[float]:
    """What tells the codes of one camera from another's: their norm, and their projections on a few plane waves.

    The codes are those of the collapsed camera, with response and exposure folded in, each at its displacement. Unlike
    a checksum, the numbers differ as little as the codes do, so that rounding makes no other camera.
    """
    code = taps.code.detach().cpu().double().numpy()
    rows, columns = (np.arange(n) for n in code.shape[1:])
    marks = [float(np.linalg.norm(code))]
    for turn in _TURNS:
        bands = np.exp(2j * np.pi * turn * (np.array(taps.channels) * turn + np.array(taps.offsets) * turn**2))
        along_y, along_x = np.exp(2j * np.pi * turn * rows), np.exp(2j * np.pi * turn**2 * columns)
        found = np.einsum("t,ty,y->", bands, code @ along_x, along_y)
        marks += [float(found.real), float(found.imag)]
    return marks


def write_description(about: Description, folder: Path, *, overwrite: bool = False) -> None:
    """Write ``decoder.json``.

    Raises:
        OutputError: see `tmca.data.atomic_path`.
    """
    write_json(about.model_dump(), folder / NAME, overwrite=overwrite)


def read_description(folder: Path) -> Description:
    """Read ``decoder.json``.

    Raises:
        DataError: none in the folder, or one that `write_description` did not write.
    """
    file = folder / NAME
    if not file.is_file():
        raise DataError(folder, f"no {NAME}", "a folder of `tmca decoder export`")
    try:
        return Description.model_validate_json(file.read_bytes())
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "no JSON"
        found = f"no description of a decoder ({place}: {first['msg']})"
        raise DataError(file, found, "what `tmca decoder export` wrote", "export it again") from None


def check_shapes(about: Description, camera: SpectralCamera, where: object) -> None:
    """Raises DataError unless snapshot, scene and bands of a camera are those of the decoder."""
    for name, own, wanted in (
        ("a snapshot", camera.snapshot_shape, about.snapshot[1:]),
        ("a scene", camera.scene_shape, about.scene[1:]),
    ):
        if own != wanted:
            raise DataError(where, f"{name} of shape {(1, *own)}", f"{(1, *wanted)} as the decoder's")
    if not same_bands(camera.wavelengths, about.wavelengths_m):
        found, expected = (_said(waves) for waves in (camera.wavelengths, about.wavelengths_m))
        raise DataError(where, f"bands from {found}", f"{expected} as the decoder's")


def check_camera(about: Description, camera: Any, where: object, *, withheld: bool = False) -> None:
    """Raises DataError unless a camera is the one that a decoder was made for.

    Args:
        about: the decoder.
        camera: that took a snapshot.
        where: file of the snapshot or of the weights.
        withheld: pixels of the snapshot are, which closes their shutter.
    """
    if not isinstance(camera, SpectralCamera):
        raise DataError(where, f"a {camera.kind} camera", "the spectral camera of the decoder")
    check_shapes(about, camera, where)
    with torch.no_grad():
        operator = camera.operator()
    marks = np.array(code_marks(operator.taps)) if isinstance(operator, TapOperator) else np.inf
    if not np.abs(marks - np.array(about.codes)).max() <= _SAME * about.codes[0]:
        found = "withheld pixels" if withheld else "the codes, displacement, response or exposure of another camera"
        remedy = "use tmca reconstruct, or export a decoder that learned for this camera"
        raise DataError(where, found, "the very camera that the decoder was made for", remedy)


def _said(waves: Sequence[float]) -> str:
    return f"{waves[0] * 1e9:.4g} to {waves[-1] * 1e9:.4g} nm ({len(waves)})"
