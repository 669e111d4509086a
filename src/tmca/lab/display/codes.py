"""The codes that are exported, wherever they are kept: sorted into buckets of a sensor, or as terms of a mirror."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field, Json
from torch import Tensor

from tmca.attributes import Attributes, attributes_of
from tmca.cameras import Snapshot
from tmca.cameras.phase_codes import read_phase_codes
from tmca.codes import CodePlane, read_codes
from tmca.codes.buckets import bucket_shutters, check_once, check_patterns
from tmca.decoders import Weights
from tmca.errors import DataError, SettingError, ShapeError
from tmca.lab.display.devices import DeviceDescription
from tmca.optics import family_parameters
from tmca.optics.zernike import fit_zernike, noll, zernike_modes
from tmca.stored_numbers import check_finite
from tmca.text_files import read_text

Size = tuple[int, int]


class _DesignedSensor(Attributes):
    """The sensor that codes were designed for."""

    exposure: Annotated[float, Field(gt=0)] | None = None


class _Designed(Attributes):
    """What a file of codes says of it."""

    sensor: Json[_DesignedSensor] | None = None


SENSOR = "sensor"
"""Setting of an export: (rows, columns) of the frames that its camera takes."""


@dataclass(frozen=True)
class Planes:
    """Codes of one exposure.

    Args:
        source: file or folder they came from.
        application: name of the camera; empty where the codes do not say.
        planes: ``aperture`` (K, h, w) and ``shutter`` (K, h, w'), or ``heights`` (K, h, w) in metres and ``shutter``:
            full frames, or one tile. A shutter of several buckets is (R, K, h, w') unless two share all light.
        tiled: names of planes that are one tile.
        modes: of Zernike masks ``coefficients`` (K, M) in metres rms and ``noll`` (M,).
        settings: of the camera, as far as they are known.
        buckets: R of a pixel of the sensor.
        exposure: of all slots together that they were designed for, seconds, if that is known.
    """

    source: str
    application: str
    planes: Mapping[str, Tensor]
    tiled: tuple[str, ...] = ()
    modes: Mapping[str, Tensor] | None = None
    settings: Mapping[str, Any] | None = None
    buckets: int = 1
    exposure: float | None = None

    @property
    def slots(self) -> int:
        """K."""
        return int(next(iter(self.planes.values())).shape[-3])

    def full(self, name: str, size: Size | None = None) -> Tensor:
        """(K, H, W) a plane over a whole device, (R, K, H, W) of the buckets that do not share all light.

        Args:
            name: of the plane.
            size: (H, W) over which a tile is repeated, or of the middle of a larger plane; as it is without.

        Raises:
            SettingError: no such plane.
            ShapeError: a plane that is smaller and no tile.
        """
        if name not in self.planes:
            raise SettingError(self.source, f"codes of {', '.join(self.planes)}", f"{name}, which this device shows")
        plane = self.planes[name]
        pixels = (int(plane.shape[-2]), int(plane.shape[-1]))
        if size is None or size == pixels:
            return plane
        if name in self.tiled:
            patterns = plane.flatten(0, -3)
            whole = CodePlane(patterns, len(patterns), size, period=pixels, name=name)()
            return whole.reshape(*plane.shape[:-2], *size)
        if pixels[0] < size[0] or pixels[1] < size[1]:
            found, expected = f"{name} of {pixels[0]}×{pixels[1]} pixels", f"{size[0]}×{size[1]} or more"
            raise ShapeError(self.source, found, expected, "codes that repeat fill any size (tmca simulate --period 8)")
        top, left = (pixels[0] - size[0]) // 2, (pixels[1] - size[1]) // 2
        return plane[..., top : top + size[0], left : left + size[1]]


def by_slot(shutter: Tensor, slots: int, buckets: int) -> Tensor:
    """(K, h, w) of one bucket, or of the first of two that share all light; else (R, K, h, w) of every bucket. Of a
    shutter as a camera's codes give it, (K, h, w) or (R·K, h, w); SettingError for other patterns."""
    check_patterns(len(shutter), buckets, slots)
    if buckets == 1:
        return shutter
    shutters = bucket_shutters(shutter, slots, buckets)
    return shutters[0] if buckets == 2 and bool((shutters.sum(0) == 1).all()) else shutters


def read_planes(source: str | Path, size: Size | None = None) -> Planes:
    """Codes of a file of `tmca design` or the folder that it wrote, a run or weights of `tmca train`, or a snapshot;
    those that come with the package are ``"default"`` (spectral, K = 8), ``"default-light-field"`` and
    ``"default-spectral-depth"``.

    Args:
        source: of the codes.
        size: (H, W) of the camera's code, over which the codes of a snapshot are repeated where they have a period.

    Raises:
        DataError: none of these.
    """
    path = Weights.file(source)
    if (path / "codes.nc").is_file() and not any(path.rglob("*.safetensors")):
        path = path / "codes.nc"
    if path.is_dir() or path.suffix == ".safetensors":
        return _of_weights(path)
    if path.suffix not in (".nc", ".h5", ".zarr"):
        raise DataError(path, f"the suffix {path.suffix!r}", "codes.nc, a run, weights, default, or a snapshot file")
    return _of_file(path, size)


def _of_weights(path: Path) -> Planes:
    weights = Weights.load(path)
    weights.check_codes()
    planes, camera = weights.codes, weights.camera
    tiled = tuple(name for name in planes if weights.period and name != "heights")
    if "heights" in planes:  # a mask lies in the pupil, whatever the size of the sensor; the shutter lies on it
        masks = planes_of(camera, str(path))
        shutter = by_slot(planes["shutter"], camera.slots, camera.buckets) if tiled else masks.planes["shutter"]
        return replace(masks, planes={**masks.planes, "shutter": shutter}, tiled=tiled)
    about = {"size": weights.size, "exposure": camera.exposure, SENSOR: camera.snapshot_shape[1:]}
    planes = {**planes, "shutter": by_slot(planes["shutter"], camera.slots, camera.buckets)}
    return Planes(str(path), weights.kind, planes, tiled, None, about, camera.buckets)


def _of_file(path: Path, size: Size | None = None) -> Planes:
    from tmca.data import read_dataset

    stored = read_dataset(path)
    if "snapshot" in stored:
        camera = Snapshot.from_dataset(stored, path).camera
        larger = size is not None and repeats(camera) and any(a > b for a, b in zip(size, camera.size, strict=True))
        return planes_of(camera.replace(size=size) if larger else camera, str(path))
    if "heights" in stored:
        return _of_masks(path)
    if "aperture" in stored:
        return _of_apertures(path, stored.attrs)
    raise DataError(path, f"variables {', '.join(map(str, stored))}", "codes, or a snapshot", "see docs/devices.md")


def _of_masks(path: Path) -> Planes:
    """Phase masks of a spectral-depth camera, and its shutter."""
    described = read_phase_codes(path)
    planes = {"heights": described["mask"]().detach(), "shutter": described["shutter"]}
    settings = {"material": described["bench"].material, "exposure": described["exposure"]}
    modes = family_parameters(described["mask"])
    return Planes(str(path), "spectral-depth", planes, ("shutter",), modes, settings)


def _of_apertures(path: Path, attributes: Mapping[str, Any]) -> Planes:
    """Codes of an aperture and a shutter, with the exposure that they were designed for."""
    codes = read_codes(path)
    shutter = by_slot(codes.shutter.flatten(0, -3), len(codes.aperture), codes.buckets)
    planes, kind = {"aperture": codes.aperture, "shutter": shutter}, str(attributes.get("camera", ""))
    sensor = attributes_of(_Designed, attributes, path).sensor
    return Planes(
        str(path), kind, planes, tuple(planes) if codes.period else (), buckets=codes.buckets,
        exposure=None if sensor is None else sensor.exposure,
    )  # fmt: skip


def repeats(camera: Any) -> bool:
    """Whether the codes of a camera are one tile again and again, so that they are known for any size of its frame."""
    return getattr(getattr(getattr(camera, "codes", None), "aperture", None), "period", None) is not None


@torch.no_grad()
def planes_of(camera: Any, source: str) -> Planes:
    """Codes of a camera of any kind, which came from a file or folder.

    Raises:
        SettingError: a camera without codes of an aperture or masks, or with a coloured aperture.
    """
    if not hasattr(camera, "codes"):
        raise SettingError(source, f"a {camera.kind} camera", "one with codes of planes", "write its patterns yourself")
    if getattr(camera, "coloured", None) is not None:
        raise SettingError(source, "a coloured aperture", "binary codes", "no device shows its filters")
    planes = dict(zip(camera.plane_names, camera.codes(), strict=True))
    planes["shutter"] = by_slot(planes["shutter"], camera.slots, camera.buckets)
    frame = {SENSOR: camera.snapshot_shape[1:]}
    if "heights" not in planes:
        settings = {"size": camera.size, "exposure": camera.exposure, **frame}
        return Planes(source, camera.kind, planes, (), None, settings, camera.buckets)
    modes, about = family_parameters(camera.point_spread.heights), {"material": camera.bench.material, **frame}
    return Planes(source, camera.kind, planes, (), modes, about, camera.buckets)


def check_buckets(codes: Planes, device: DeviceDescription) -> None:
    """Raises SettingError for codes of other buckets than a sensor's, light that goes nowhere without a drain, and a
    slot in two buckets."""
    if device.plane != "shutter":
        return
    if codes.buckets != device.buckets:
        drained = " bucket, the light of closed slots to a drain" if codes.buckets == 1 else " buckets"
        found = f"codes of {codes.buckets}{drained}"
        own = {1: ", as coded-exposure", 2: ", as coded-exposure-two-bucket"}.get(codes.buckets, "")
        remedy = f"take a camera with buckets={device.buckets}, or another device{own}"
        raise SettingError(device.name, found, f"{device.buckets}, those of its pixels", remedy)
    shutter = codes.planes["shutter"]
    if codes.buckets == 1 or shutter.ndim == 3:
        return
    check_once(shutter, codes.source)
    lost = int((shutter.sum(0) < 1).sum())
    if lost and None not in device.places:
        found, expected = f"{lost} slots of pixels in no bucket", f"each in one: {device.name} has no drain"
        raise SettingError(codes.source, found, expected, "take a device with a drain, or other codes")


def numbers_of(shutter: NDArray[np.float32], device: DeviceDescription) -> NDArray[np.float32]:
    """(K, H, W) numbers in the frames of a sensor with several buckets, see ``DeviceDescription.places``: of a shutter
    (R, K, H, W) of every bucket, or (K, H, W) of the first of two that share all light."""
    shutters = shutter if shutter.ndim == 4 else np.stack((shutter, 1 - shutter))
    return np.asarray(sum(n * shutters[b] for n, b in enumerate(device.places) if b is not None))


def shutter_of(numbers: NDArray[np.generic], device: DeviceDescription) -> NDArray[np.float32]:
    """What ``numbers_of`` was given."""
    shutters = np.stack([numbers == device.places.index(bucket) for bucket in range(device.buckets)])
    patterns = torch.from_numpy(shutters.astype(np.float32)).flatten(0, 1)
    return np.asarray(by_slot(patterns, numbers.shape[0], device.buckets).numpy())


COLUMNS = ("slot", "noll", "n", "m", "rms_um", "peak_um")
_DIGITS = 9
_PUPIL = (129, 129)
"""Pixels over which a surface is looked at."""


@dataclass(frozen=True)
class Terms:
    """Zernike terms of K mirror shapes.

    Args:
        noll: index of every term.
        rms: (K, M) metres of surface, root mean square over the pupil.
        residual: (K,) metres rms of what the terms leave of the heights.
    """

    noll: tuple[int, ...]
    rms: NDArray[np.float64]
    residual: NDArray[np.float64]

    def peak_to_valley(self) -> NDArray[np.float64]:
        """(K,) metres between the highest and the lowest place of every surface over the pupil."""
        disk = zernike_modes([(0, 0)], _PUPIL)[0].numpy() != 0
        surfaces = np.tensordot(self.rms, zernike_modes([noll(index) for index in self.noll], _PUPIL).numpy(), 1)
        return np.asarray(np.ptp(surfaces[:, disk], axis=1))


def terms_of(codes: Planes, device: DeviceDescription) -> Terms:
    """Terms of a deformable mirror that shows height maps.

    Raises:
        SettingError: heights of a mask that is no mirror, or terms beyond the stroke.
    """
    material = (codes.settings or {}).get("material", "mirror")
    if material != "mirror":
        raise SettingError(codes.source, f"a mask of {material}", "one of mirror heights", "design it on a mirror")
    heights = codes.full("heights").double()
    modes = [noll(index) for index in device.noll]
    rms, left = zip(*(fit_zernike(one - one.mean(), modes) for one in heights), strict=True)
    terms = Terms(device.noll, np.stack([one.numpy() for one in rms]), np.array([_rms(one) for one in left]))
    _check_stroke(terms, device, codes.source)
    return terms


def _rms(left: torch.Tensor) -> float:
    inside = left != 0
    values = left[inside]
    return float((values - values.mean()).square().mean().sqrt()) if int(inside.sum()) else 0.0


def peak(index: int) -> float:
    """Largest magnitude of a Noll mode over the pupil, of one of unit root mean square."""
    n, m = noll(index)
    return float((n + 1) ** 0.5 * (1 if m == 0 else 2**0.5))


def _check_stroke(terms: Terms, device: DeviceDescription, source: str) -> None:
    assert device.stroke_um is not None
    peaks = np.abs(terms.rms) * [peak(index) for index in terms.noll] * 1e6
    slot, term = np.unravel_index(int(peaks.argmax()), peaks.shape)
    if peaks[slot, term] > device.stroke_um:
        found = f"{peaks[slot, term]:.3g} µm of term {terms.noll[term]} in slot {slot}"
        wanted = f"{device.stroke_um:g} µm at most, the stroke of {device.name}"
        raise SettingError(source, found, wanted, "design masks within the stroke (--stroke)")
    spans = terms.peak_to_valley() * 1e6
    if device.total_stroke_um is not None and spans.max() > device.total_stroke_um:
        found = f"{spans.max():.3g} µm between peak and valley in slot {int(spans.argmax())}"
        wanted = f"{device.total_stroke_um:g} µm at most, the total stroke of {device.name}"
        raise SettingError(source, found, wanted, "design masks within the stroke (--stroke)")


def table(terms: Terms) -> str:
    """CSV with a line for every slot and term."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(COLUMNS)
    for slot, values in enumerate(terms.rms * 1e6):
        for index, value in zip(terms.noll, values, strict=True):
            rows.writerow((slot, index, *noll(index), round(value, _DIGITS), round(value * peak(index), _DIGITS)))
    return text.getvalue()


def read_table(file: Path) -> Terms:
    """What ``table`` wrote.

    Raises:
        DataError: no such table, or a term that is missing in a slot.
    """
    text = read_text(file, "a table of Zernike terms", "export again")
    try:
        rows = list(csv.DictReader(text.splitlines()))
        values = {(int(row["slot"]), int(row["noll"])): float(row["rms_um"]) for row in rows}
    except (KeyError, TypeError, ValueError, csv.Error):
        raise DataError(file, "no table of Zernike terms", f"columns {', '.join(COLUMNS)}", "export again") from None
    slots, indices = sorted({slot for slot, _ in values}), list(dict.fromkeys(int(row["noll"]) for row in rows))
    if not values or slots != list(range(len(slots))) or len(values) != len(slots) * len(indices):
        raise DataError(file, f"{len(values)} terms of {len(slots)} slots", "every term in every slot", "export again")
    rms = np.array([[values[slot, index] for index in indices] for slot in slots]) * 1e-6
    check_finite(rms, file, "rms_um", "export again")
    return Terms(tuple(indices), rms, np.full(len(slots), np.nan))
