"""Snapshots and the codes that made them, slot by slot; patterns of an export in their full size."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from tmca.cameras import Camera, Snapshot
from tmca.codes import bucket_shutters
from tmca.data import read_array
from tmca.lab.display.manifest import read_manifest
from tmca.viewer.cubes import said
from tmca.viewer.items import Axis, Colours, Item, Layer, in_memory

_KEPT = 8
"""Patterns of an export that stay in memory."""


def snapshot_items(snapshot: Snapshot[Any], title: str, **about: Any) -> list[Item]:
    """What was recorded, and what aperture and shutter showed meanwhile; ``about`` of the items."""
    camera, values = snapshot.camera, snapshot.values.numpy(force=True)
    planes = values.reshape(-1, *values.shape[-2:])
    unit = f"1 = one {camera.channel} of a white scene"
    recorded = _layer("values", "snapshot", planes, "channel", _channels(snapshot), unit=unit, colours="level")
    facts = {
        "camera": f"{camera.kind}, K = {camera.slots}" + (f", {camera.buckets} buckets" if camera.buckets > 1 else ""),
        "size": f"{planes.shape[1]} × {planes.shape[2]} pixels, {len(planes)} channel{'s' * (len(planes) > 1)}",
        "full scale": f"{camera.full_scale:.4g} {camera.channel}s of a white scene",
        "at full scale": f"{float((planes >= 0.999 * camera.full_scale).mean()):.2%} of the pixels",
        "read noise": f"σ = {camera.noise.read:.3g} of one {camera.channel}",
        "shot noise": f"variance = {camera.noise.shot:.3g} × value" if camera.noise.shot else "none",
        "light throughput": f"{camera.throughput():.1%}",
    }
    shown = Item("snapshot", title, (recorded,), {**facts, **said(snapshot.notes)}, **about)
    return [shown, Item("codes", title, tuple(code_layers(camera)), facts, **about)]


def code_layers(camera: Any) -> list[Layer]:
    """What a camera's aperture and shutter show in every slot, and the code that stands for all of them."""
    with torch.no_grad():
        if not hasattr(camera, "bucket_codes"):
            return _phase_layers(camera)
        aperture, shutters = camera.bucket_codes()
        cube = camera.code_cube()
    layers = [_layer("aperture", "aperture T", _numbers(aperture), "slot", colours="binary")]
    layers += _shutter_layers(shutters, camera)
    channels = [f"{name}{_bucket(number, camera)}" for number in range(camera.buckets) for name in camera.channel_names]
    code = _numbers(cube).reshape(-1, *cube.shape[-2:])
    return [*layers, _layer("code", "effective code T̂", code, camera.channel, channels)]


def _phase_layers(camera: Any) -> list[Layer]:
    """Heights of the mask and shutters of a spectral-depth camera."""
    with torch.no_grad():
        shutters = bucket_shutters(camera.shutter(), camera.slots, camera.buckets)
        heights = _numbers(camera.codes.optics.heights()) * 1e6
    mask = _layer("heights", "height of the mask", heights, "slot", unit="µm", colours="depth")
    return [mask, *_shutter_layers(shutters, camera)]


def _shutter_layers(shutters: torch.Tensor, camera: Any) -> list[Layer]:
    """One for each bucket."""
    labels = [f"shutter S{_bucket(number, camera)}" for number in range(len(shutters))]
    return [
        _layer(f"shutter{number}", label, _numbers(shutter), "slot", colours="binary")
        for number, (label, shutter) in enumerate(zip(labels, shutters, strict=True), start=1)
    ]


def export_item(folder: Path, **about: Any) -> Item:
    """The patterns of a folder that `tmca export` wrote, in their full size.

    Raises:
        DataError: a damaged manifest, or a pattern that is not there.
    """
    manifest = read_manifest(folder)
    layers, facts = [], {"camera": str(manifest.get("camera", "")), "exposure": f"{manifest['exposure_s']:g} s"}
    for plane in manifest["planes"]:
        files = [folder / frame["file"] for frame in plane["frames"]]
        layers.append(_pattern_layer(str(plane["plane"]), files))
        device = plane["device"]
        facts[f"{plane['plane']} device"] = f"{device['name']}, {layers[-1].size[0]} × {layers[-1].size[1]} pixels"
    return Item("codes", folder.name, tuple(layers), facts, **about)


def _pattern_layer(name: str, files: Sequence[Path]) -> Layer:
    @lru_cache(_KEPT)
    def pattern(index: int) -> NDArray[Any]:
        values = read_array(files[index])
        return values if values.ndim == 2 else values[..., 0]

    def read(index: int, rows: slice, columns: slice) -> NDArray[Any]:
        return pattern(index)[rows, columns]

    first = pattern(0)
    top = float(np.iinfo(first.dtype).max) if first.dtype.kind == "u" else 1.0
    label = f"{name}, levels of the device"
    axis = Axis.counted("slot", len(files))
    size = first.shape[0], first.shape[1]
    return Layer(name, label, size, axis, read, colours="binary", span=(0.0, top), view={"steps": True})


def _layer(
    name: str,
    label: str,
    planes: NDArray[Any],
    over: str,
    names: Sequence[str] = (),
    unit: str = "",
    colours: Colours = "values",
) -> Layer:
    """A layer of planes in memory, counted from 1."""
    axis = Axis.counted(over, len(planes), names)
    size = planes.shape[1], planes.shape[2]
    span = (0.0, max(1.0, float(planes.max()))) if colours == "binary" else None
    view = {"steps": over == "slot"}

    def column(rows: slice, columns: slice) -> NDArray[Any]:
        return planes[:, rows, columns]

    return Layer(name, label, size, axis, in_memory(planes), unit, colours, span, column, view)


def _channels(snapshot: Snapshot[Any]) -> list[str]:
    """Names of what a snapshot's planes are: colours or channels, of every bucket."""
    batch, planes = snapshot.values.shape[:2]
    camera, channels = snapshot.camera, planes // snapshot.camera.buckets
    colours = ["red", "green", "blue"] if batch == 3 else [""]
    names = [f"channel {number + 1}" if channels > 1 else "" for number in range(channels)]
    found = [
        f"{colour} {name}{_bucket(b, camera)}" for colour in colours for b in range(camera.buckets) for name in names
    ]
    return [name.strip(" ,") or "all" for name in found]


def _bucket(number: int, camera: Camera) -> str:
    return f", bucket {number + 1}" if camera.buckets > 1 else ""


def _numbers(values: torch.Tensor) -> NDArray[np.float32]:
    found: NDArray[np.float32] = values.numpy(force=True).astype(np.float32)
    return found.reshape(-1, *found.shape[-2:])
