"""A trained decoder as a program of its own, for use beside a camera: `torch.export` and ONNX.

Mask, optics, noise and network are fixed in it: one input, the snapshot (1, 1, H, W'), one output, the scene
(1, L, H, W). Each file is run and compared with the decoder that it was made from before it is kept.
"""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from pydantic import Field
from torch import Tensor, nn

from tmca.attributes import Attributes, read_json
from tmca.cameras import Snapshot, SpectralCamera
from tmca.data import atomic_path, check_target, make_folder, write_json
from tmca.decoders import Estimate, Weights
from tmca.decoders.nets.bands import same_bands
from tmca.errors import DataError, SettingError
from tmca.lab.fixed_decoder import CameraDecoder, FixedOperator, LookedUpOperator
from tmca.lab.importing import WITHHELD
from tmca.lab.loading import load_exported, package, quiet
from tmca.operators import TapOperator, Taps
from tmca.sensor import Noise, Sensor

DESCRIPTION = "decoder.json"
Length = Annotated[int, Field(ge=1, le=2**20)]
_UNITS = "1 is one band of a white scene through open codes"
_TURNS = (0.6180339887, 0.4142135624, 0.7320508076, 0.2360679775)
"""Turns from row to row of the waves on which codes are projected: irrational, so that no regular code is missed."""
_SAME = 1e-5
"""Share of the codes' norm by which their projections may differ: a hundred times the rounding of 32-bit floats, a
fiftieth of what one closed pixel of ten million changes."""


class DecoderFile(Attributes):
    """One file of an exported decoder.

    Args:
        format: ``"torch"`` or ``"onnx"``.
        file: its name in the folder.
        error: largest difference from the decoder in torch, as a share of its largest value.
    """

    format: str = Field(pattern="^(torch|onnx)$")
    file: str = Field(pattern=r"^decoder\.(pt2|onnx)$")
    error: float


class Description(Attributes):
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
    snapshot: tuple[Length, Length, Length, Length]
    scene: tuple[Length, Length, Length, Length]
    wavelengths_m: tuple[float, ...] = Field(min_length=1)
    read_noise: float = Field(ge=0)
    shot_noise: float = Field(ge=0)
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
        projection = np.einsum("t,ty,y->", bands, code @ along_x, along_y)
        marks += [float(projection.real), float(projection.imag)]
    return marks


def read_description(folder: Path) -> Description:
    """Read ``decoder.json``.

    Raises:
        DataError: none in the folder, or another JSON file.
    """
    file = folder / DESCRIPTION
    if not file.is_file():
        raise DataError(folder, f"no {DESCRIPTION}", "a folder of `tmca decoder export`")
    about: Description = read_json(file, Description)
    return about


def check_camera(about: Description, camera: Any, where: object, *, withheld: bool = False) -> None:
    """Raises DataError unless a camera, of a snapshot or of weights, is the one that a decoder was made for; pixels
    that are withheld have a closed shutter."""
    if camera.kind != SpectralCamera.kind:
        raise DataError(where, f"a {camera.kind} camera", "the spectral camera of the decoder")
    for name, shape in (("snapshot", camera.snapshot_shape), ("scene", camera.scene_shape)):
        if (wanted := getattr(about, name)) != (1, *shape):
            raise DataError(where, f"a {name} of shape {(1, *shape)}", f"{wanted} as the decoder's")
    if not same_bands(camera.wavelengths, about.wavelengths_m):
        found, expected = (_said(waves) for waves in (camera.wavelengths, about.wavelengths_m))
        raise DataError(where, f"bands from {found}", f"{expected} as the decoder's")
    with torch.no_grad():
        operator = camera.operator()
    marks = np.array(code_marks(operator.taps)) if isinstance(operator, TapOperator) else np.inf
    if not np.abs(marks - np.array(about.codes)).max() <= _SAME * about.codes[0]:
        found = "withheld pixels" if withheld else "the codes, displacement, response or exposure of another camera"
        remedy = "use tmca reconstruct, or export a decoder that learned for this camera"
        raise DataError(where, found, "the very camera that the decoder was made for", remedy)


def _said(waves: Sequence[float]) -> str:
    return f"{waves[0] * 1e9:.4g} to {waves[-1] * 1e9:.4g} nm ({len(waves)})"


FORMATS = {"torch": "decoder.pt2", "onnx": "decoder.onnx"}
_OPERATORS = {"torch": FixedOperator, "onnx": LookedUpOperator}
_ONNX = ("onnx", "onnxscript", "onnxruntime")
_CLOSE = 1e-3
"""Largest difference, as a share of the largest value, at which a file counts as the same decoder."""


def export_decoder(
    run: str | Path,
    out: str | Path,
    formats: tuple[str, ...] | None = None,
    *,
    size: tuple[int, int] | None = None,
    noise: float | None = None,
    overwrite: bool = False,
) -> list[DecoderFile]:
    """Write the decoder of a training run as files that need no tmca, each checked on random input.

    Args:
        run: folder of `tmca train spectral`, or a weights file.
        out: folder of the files; made if it does not exist.
        formats: ``"torch"`` (`torch.export`) and ``"onnx"``; those of `usual_formats` without.
        size: (H, W) of the scene; that of the run's camera without it.
        noise: read noise in snapshot units that the network is told; that of its training without it.
        overwrite: replace files that exist.

    Raises:
        SettingError: an unknown format, a package that is missing, or a decoder that cannot stand alone.
        DataError: an exported file that does not compute what the decoder does.
        OutputError: files that exist.
    """
    formats = usual_formats() if formats is None else formats
    _check_formats(formats)
    folder = Path(out)
    for file in [FORMATS[one] for one in formats] + [DESCRIPTION]:
        if folder.is_dir():
            check_target(folder / file, overwrite)
    weights = Weights.load(run)
    camera = _camera(weights, size, sensor=_sensor(weights, noise))
    decoders = {one: _fixed(weights, camera, camera.noise, one) for one in formats}
    make_folder(folder)
    files = [_written(decoder, camera, one, folder / FORMATS[one], overwrite) for one, decoder in decoders.items()]
    about = Description(
        weights=str(weights.path), snapshot=(1, *camera.snapshot_shape), scene=(1, *camera.scene_shape),
        wavelengths_m=weights.wavelengths, read_noise=camera.noise.read, shot_noise=camera.noise.shot,
        codes=tuple(code_marks(decoders[formats[0]].operator.taps)), files=tuple(files),
    )  # fmt: skip
    write_json(about.model_dump(), folder / DESCRIPTION, overwrite=overwrite)
    return files


def _camera(weights: Weights, size: tuple[int, int] | None, **changes: Any) -> SpectralCamera:
    """The spectral camera of some weights."""
    weights.check_kind("spectral")
    camera: SpectralCamera = weights.camera_for(size, **changes)
    return camera


def _fixed(weights: Weights, camera: SpectralCamera, noise: Noise, format: str) -> CameraDecoder:
    """The decoder in the form that suits a file."""
    operator = camera.operator()
    if not isinstance(operator, TapOperator):
        raise SettingError("weights", "optics that keep the slots apart", "one code for all slots")
    return CameraDecoder(weights, operator, noise, _OPERATORS[format]).eval()


def check_decoder(folder: str | Path, run: str | Path, trust: bool = False) -> list[DecoderFile]:
    """Compare the files of an exported decoder with the run they were made from, on random input.

    Args:
        folder: of `export_decoder`.
        run: folder of the run, or its weights.
        trust: see `load_exported`.

    Raises:
        DataError: no exported decoder in the folder, one of another camera, or one that computes something else.
    """
    about = read_description(Path(folder))
    weights = Weights.load(run)
    camera = _camera(weights, (about.scene[2], about.scene[3]))
    check_camera(about, camera, weights.path)
    decoder = _fixed(weights, camera, Noise(about.read_noise, about.shot_noise), "torch")
    snapshot, checked = _random(camera, seed=1), []
    for entry in about.files:
        file = Path(folder) / entry.file
        error = _difference(decoder, file, load_exported(file, trust), snapshot)
        checked.append(entry.model_copy(update={"error": error}))
    return checked


def decoder_file(folder: str | Path, format: str) -> Path:
    """The file of one format in a folder that `export_decoder` wrote."""
    files = {entry.format: entry.file for entry in read_description(Path(folder)).files}
    if format not in files:
        raise SettingError("--format", repr(format), f"one of {', '.join(files)}")
    return Path(folder) / files[format]


def decode_exported(folder: str | Path, snapshot: str | Path, format: str, trust: bool = False) -> Estimate:
    """The scene of a snapshot file, as `decode` gives it.

    Args:
        folder: of `export_decoder`.
        snapshot: file of the camera that the decoder was made for.
        format: ``"torch"`` or ``"onnx"``.
        trust: see `load_exported`.

    Raises:
        DataError: a snapshot of another camera or with withheld pixels, or a file that is missing.
        SettingError: a format that was not exported.
    """
    about, file = read_description(Path(folder)), decoder_file(folder, format)
    taken = Snapshot.load(snapshot)
    check_camera(about, taken.camera, snapshot, withheld=bool(taken.notes.get(WITHHELD)))
    decoder = load_exported(file, trust)
    start = time.perf_counter()
    with torch.no_grad():
        scene = decoder(taken.values)
    return Estimate(scene, taken.camera, file.name, seconds=time.perf_counter() - start, notes=dict(taken.notes))


def _written(decoder: CameraDecoder, camera: SpectralCamera, format: str, path: Path, overwrite: bool) -> DecoderFile:
    """One file, kept only if it computes what the decoder does."""
    snapshot = _random(camera, seed=0)
    with torch.no_grad(), atomic_path(path, overwrite=overwrite) as temporary:
        if format == "torch":
            archive = io.BytesIO()  # torch ends the process where a write to a disk fails
            torch.export.save(torch.export.export(decoder, (snapshot,), strict=False), archive)
            temporary.write_bytes(archive.getvalue())
        else:
            with quiet("torch.onnx"):  # it warns of packages that no decoder uses
                program = torch.onnx.export(
                    decoder, (snapshot,), dynamo=True, input_names=["snapshot"], output_names=["scene"], verbose=False
                )
            assert program is not None  # it is one with dynamo
            program.save(str(temporary), external_data=False)
        error = _difference(decoder, path, load_exported(temporary), snapshot)
    return DecoderFile(format=format, file=path.name, error=error)


@torch.no_grad()
def _difference(decoder: nn.Module, path: Path, exported: Callable[[Tensor], Tensor], snapshot: Tensor) -> float:
    """Largest difference of an exported file from the decoder, as a share of the largest value; DataError if large."""
    wanted = decoder(snapshot)
    error = float((exported(snapshot) - wanted).abs().max() / wanted.abs().max())
    if not error <= _CLOSE:
        found = f"values that differ by {error:.2g} of the largest from the network's"
        raise DataError(path, found, f"{_CLOSE:g} at most", "export it again from this run")
    return error


def _random(camera: SpectralCamera, seed: int) -> Tensor:
    """A snapshot of noise, as bright as an ordinary one."""
    values = np.random.default_rng(seed).random((1, *camera.snapshot_shape), dtype=np.float32)
    return torch.from_numpy(5 * values)


def _sensor(weights: Weights, noise: float | None) -> Sensor:
    """The sensor that the network is told of."""
    trained = weights.card.get("training", {}).get("noise", [{}])[0]
    return Sensor(**trained) if noise is None else Sensor(read_noise=noise)


def usual_formats() -> tuple[str, ...]:
    """All formats, without ONNX where its packages are not installed."""
    return tuple(FORMATS) if all(map(find_spec, _ONNX)) else ("torch",)


def _check_formats(formats: tuple[str, ...]) -> None:
    if (unknown := sorted({*formats} - {*FORMATS})) or not formats:
        raise SettingError("formats", ", ".join(unknown) or "none", f"some of {', '.join(FORMATS)}")
    if "onnx" in formats:
        for name in _ONNX:
            package(name)
