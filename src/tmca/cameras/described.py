"""Cameras from their specs: presets, files of codes and patterns, benches in metres."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any
from warnings import warn

import numpy as np
import torch
from torch import Tensor

from tmca.cameras.camera import CAMERAS, Camera
from tmca.cameras.coded import CodedCamera
from tmca.cameras.phase_codes import read_phase_codes
from tmca.cameras.spectral_depth import SpectralDepthCamera
from tmca.codes import BURST, FAMILIES, bucket_shutters
from tmca.codes.files import read_codes
from tmca.data import read_array
from tmca.errors import SettingError, TmcaError
from tmca.optics import DepthPlanes, Dispersion, MaskGeometry, changed_bench
from tmca.sensor import Sensor, band_wavelengths
from tmca.specs import (
    CameraSpec,
    CodedSpec,
    LightFieldSpec,
    MaskPlaceSpec,
    PhaseBenchSpec,
    SensorSpec,
    Spec,
    SpectralDepthSpec,
    SpectralSpec,
)

_MOST_CODES = 2**33
"""Bytes of codes that a machine may hold."""
_PLANES = ("aperture", "shutter")
_IN_CODES = (*_PLANES, "heights", "filters", "channels", "exposure", "energy")
"""Arguments of cameras that files of codes may give."""
_SHOWN = ("slots", "aperture", "shutter", "buckets", "transmittance", "duty", "codes", "weights", "coloured")
"""Fields that say what a camera shows."""


class CodesWarning(UserWarning):
    """Something about codes that a user should know."""


def camera_of(spec: CameraSpec, sensor: SensorSpec | None = None, bench: Spec | None = None, **shape: Any) -> Any:
    """The camera that a spec describes; weights of learned codes are `tmca.decoders.Weights`' matter.

    Args:
        spec: of its kind.
        sensor: an ideal one without.
        bench: `MaskPlaceSpec` of a light-field camera, `PhaseBenchSpec` of a spectral-depth camera.
        shape: what a scene gives: ``size``, and ``bands`` or ``views``.

    Raises:
        SettingError, ShapeError: what makes no camera; ``where`` is a field of the spec.
        DataError: a file that cannot be read.

    Warns:
        CodesWarning: patterns whose middle is taken, a tile larger than the scene, buckets that see no light.
    """
    kind: Any = CAMERAS[spec.kind]
    _check_memory(getattr(spec, "slots", None) or 1, shape)
    arguments = {**_arguments(spec, bench, shape), "sensor": Sensor(**(sensor or SensorSpec()).model_dump())}
    try:
        camera: Camera = kind(**arguments)
        if isinstance(camera, CodedCamera) and camera.throughput() == 0:
            expected = "some open pixels in aperture and shutter together"
            raise SettingError("aperture", "none that let light through", expected)
    except TmcaError as error:
        if (named := _of_file(error, spec)) is error:
            raise
        raise named from error
    _warn_of_buckets(camera, arguments.get("shutter"))
    return camera


def _warn_of_buckets(camera: Any, shutter: Any) -> None:
    """Warns of buckets that never see light, as behind an open shutter, and of a burst without buckets."""
    if camera.buckets == 1 and isinstance(shutter, str) and shutter == BURST:
        warn("shutter: burst with one bucket is an open shutter; add --buckets 2", CodesWarning, stacklevel=3)
    elif camera.buckets > 1:
        plane = camera.codes.shutter()
        dark = ~bucket_shutters(plane, camera.slots, camera.buckets).any(1)
        if bool(dark.any(0).all()):
            text = f"buckets: of the {camera.buckets} of every pixel one or more never sees light; "
            warn(f"{text}take more slots, and --shutter balanced or burst", CodesWarning, stacklevel=3)


@dataclass(frozen=True)
class SeenRange:
    """Bands in metres and depth planes of a camera."""

    wavelengths: tuple[float, ...]
    planes: DepthPlanes


def seen_by(spec: CameraSpec, bench: Spec | None = None) -> SeenRange:
    """What the spectral-depth camera that a spec describes sees, without building it.

    Raises:
        SettingError: impossible bands or planes.
        DataError: a file of codes that cannot be read.
    """
    arguments = _arguments(spec, bench, {})
    near, far = arguments["depth"]
    return SeenRange(band_wavelengths(arguments["bands"]), DepthPlanes(near, far, arguments["planes"]))


def _arguments(spec: CameraSpec, bench: Spec | None, shape: dict[str, Any]) -> dict[str, Any]:
    """Arguments of the constructor that a spec gives: its preset's, the scene's, its own."""
    preset = getattr(spec, "preset", None) or (None if spec.only(*_SHOWN) else spec.usual)
    with_files = _ARGUMENTS.get(spec.kind, lambda spec, bench, shape: spec.arguments())(spec, bench, shape)
    return {**(CAMERAS[spec.kind].preset(preset) if preset else {}), **shape, **with_files}


def _of_file(error: TmcaError, spec: CameraSpec) -> TmcaError:
    """An error about what stands in a file names the field and the file that it may have come from."""
    files = [*["codes"][: error.where in _IN_CODES], *["coloured"][: error.where in _PLANES]]
    for name in (error.where, *files):
        value = getattr(spec, name, None) if name.isidentifier() else None
        if isinstance(value, str | Path) and Path(value).suffix:
            return type(error)(f"{name} {value}", error.found, error.expected, error.remedy)
    return error


def _coded(spec: CodedSpec, shape: dict[str, Any]) -> dict[str, Any]:
    """Arguments of any camera with an aperture and a shutter."""
    arguments = spec.arguments()
    if spec.codes is not None:
        others = spec.only("preset", "weights", "coloured")
        arguments |= _alone(read_codes(spec.codes).settings(), arguments, others)
    for plane in _PLANES:
        if isinstance(arguments.get(plane), str) and arguments[plane] not in _families(plane):
            arguments[plane] = read_patterns(arguments[plane], plane)
    patterns = [arguments[plane] for plane in _PLANES if isinstance(arguments.get(plane), Tensor)]
    if patterns and patterns[0].ndim == 3:
        arguments.setdefault("slots", len(patterns[0]))
    if spec.period and "size" in shape and spec.period > min(shape["size"]):
        text = f"a period of {spec.period} pixels is larger than the scene: the codes do not repeat"
        warn(text, CodesWarning, stacklevel=3)
    return arguments


def _spectral(spec: SpectralSpec, bench: Spec | None, shape: dict[str, Any]) -> dict[str, Any]:
    arguments = _coded(spec, shape)
    for plane in _PLANES:
        if isinstance(arguments.get(plane), Tensor) and not arguments.get("period"):
            arguments[plane] = _middle(arguments[plane], plane, arguments, shape)
    if spec.coloured is not None:
        arguments["coloured"] = read_transmittance(spec.coloured)
    return arguments


def _light_field(spec: LightFieldSpec, bench: Spec | None, shape: dict[str, Any]) -> dict[str, Any]:
    arguments = _coded(spec, shape)
    if spec.vignetting is not None:
        arguments["vignetting"] = read_array(spec.vignetting).copy()
    if isinstance(bench, MaskPlaceSpec) and bench.given():
        return {**arguments, **shear_of(bench, spec, shape["views"])}
    return arguments


def _spectral_depth(spec: SpectralDepthSpec, bench: Spec | None, shape: dict[str, Any]) -> dict[str, Any]:
    arguments, place = spec.arguments(), bench if isinstance(bench, PhaseBenchSpec) else PhaseBenchSpec()
    if changes := place.arguments():
        arguments["bench"] = changed_bench(SpectralDepthCamera.preset(spec.preset)["bench"], changes)
    if spec.codes is not None:
        arguments |= _alone(read_phase_codes(spec.codes), arguments, [*place.given(), *spec.only("rms_nm", "modes")])
    return arguments


_ARGUMENTS: dict[str, Callable[..., dict[str, Any]]] = {
    "spectral": _spectral,
    "light-field": _light_field,
    "spectral-depth": _spectral_depth,
}


def _alone(found: dict[str, Any], given: dict[str, Any], others: Iterable[str]) -> dict[str, Any]:
    """Arguments of a file of codes, beside which nothing else may say the same."""
    beside = [*others, *(name for name in given if name in found and name not in ("slots", "bench"))]
    if beside:
        text, remedy = f"--{beside[0].replace('_', '-')} beside it", "leave one out"
        if beside[0] == "period" and found["period"] is None:
            remedy = "write the attribute period: [rows, columns] into the file (docs/devices.md)"
        raise SettingError("codes", text, "one of them", remedy)
    if given.get("slots", found["slots"]) != found["slots"]:
        raise SettingError("slots", str(given["slots"]), f"{found['slots']}, as the codes have", "leave it out")
    return found


def shear_of(bench: MaskPlaceSpec, spec: LightFieldSpec, views: tuple[int, int]) -> dict[str, Any]:
    """``shear`` and ``mask_scale`` of a bench, which are said as a warning.

    Raises:
        SettingError: a length that is missing or impossible, or beside another that says the same.
    """
    if spec.has("mask_scale"):
        raise SettingError("mask_scale", "beside a bench", "one of them", "leave it out: the bench says it")
    geometry = _geometry(bench, views, spec.shear if spec.has("shear") else None)
    shear, pitch = geometry.shear(bench.mask_pitch), bench.mask_pitch or geometry.mask_pitch
    warn(
        f"mask of pitch {pitch * 1e6:.5g} µm at {geometry.mask_distance * 1e3:.5g} mm from the sensor: "
        f"{shear.step[0]:.5g} mask pixels per view, {shear.scale:.6g} per sensor pixel",
        CodesWarning, stacklevel=2,
    )  # fmt: skip
    return {"shear": shear.step, "mask_scale": shear.scale}


def _geometry(bench: MaskPlaceSpec, views: tuple[int, int], shear: tuple[float, ...] | None) -> MaskGeometry:
    lengths: dict[str, Any] = {**bench.lengths(), "views": views[0]}
    if shear is not None and (bench.mask_distance is not None or bench.mask_pitch is not None):
        raise SettingError("shear", "beside --mask-distance or --mask-pitch", "one of them")
    if bench.mask_distance is not None:
        return MaskGeometry(bench.mask_distance, **lengths)
    if bench.mask_pitch is not None:
        return MaskGeometry.for_pitch(bench.mask_pitch, **lengths)
    if shear is not None and shear[0] != shear[1]:
        raise SettingError("shear", f"{shear[0]:g},{shear[1]:g}", "one number beside a bench")
    return MaskGeometry.for_shear(1.0 if shear is None else shear[0], **lengths)


def _families(plane: str) -> tuple[str, ...]:
    """Names of the codes of a plane."""
    return (*FAMILIES, BURST) if plane == "shutter" else tuple(FAMILIES)


def read_patterns(file: str, plane: str) -> Tensor:
    """(K, H, W) patterns of a file, shares of light; MATLAB's (H, W, K) too; whole numbers over their type's maximum.

    Raises:
        SettingError: neither a family nor a file, or values outside [0, 1].
    """
    if not Path(file).suffix:
        raise SettingError(plane, repr(file), f"one of {', '.join(_families(plane))}, or a file of patterns")
    patterns = _shares(read_array(file), plane, file)
    turned = patterns.ndim == 3 and patterns.shape[2] < min(patterns.shape[:2])
    return patterns.movedim(2, 0).contiguous() if turned else patterns


def read_transmittance(file: str | Path) -> Tensor:
    """(L, H, W) of a static coloured aperture; whole numbers over their type's maximum."""
    return _shares(np.squeeze(read_array(file)), "coloured", str(file))


def _shares(stored: np.ndarray, where: str, file: str) -> Tensor:
    scale = float(np.iinfo(stored.dtype).max) if stored.dtype.kind in "ui" and stored.max() > 1 else 1.0
    values = torch.from_numpy(stored.astype("float32") / scale)
    low, high = float(values.min()), float(values.max())
    if not 0 <= low <= high <= 1:
        remedy = "divide them by the largest, or store whole numbers as such"
        raise SettingError(f"{where} {file}", f"values from {low:g} to {high:g}", "0 = closed to 1 = open", remedy)
    return values


def _middle(patterns: Tensor, plane: str, arguments: dict[str, Any], shape: dict[str, Any]) -> Tensor:
    """Patterns larger than the plane they are for: their middle."""
    wide = plane == ("shutter" if arguments.get("disperser", "single") == "single" else "aperture")
    count = shape["bands"] if isinstance(shape["bands"], int) else len(shape["bands"])
    wider = Dispersion.of(arguments.get("dispersion", 1.0), count).extent if wide else 0
    rows, columns = shape["size"][0], shape["size"][1] + wider
    height, width = patterns.shape[-2:]
    if (height, width) == (rows, columns) or height < rows or width < columns:
        return patterns
    top, left = (height - rows) // 2, (width - columns) // 2
    warn(f"{plane}: the middle {rows}×{columns} of {height}×{width} pixels", CodesWarning, stacklevel=4)
    return patterns[..., top : top + rows, left : left + columns].contiguous()


def _check_memory(slots: int, shape: dict[str, Any]) -> None:
    needed = 8.0 * slots * prod(shape.get("size", (1, 1)))
    if needed > _MOST_CODES:
        found = f"{slots}: codes of {needed / 2**30:.0f} GiB"
        raise SettingError("slots", found, f"at most {_MOST_CODES / 2**30:.0f} GiB")
