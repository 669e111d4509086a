"""The camera of an export: that of the snapshot file that it was made from, at the size that devices show."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from tmca.cameras import Snapshot
from tmca.codes.files import codes_of_file
from tmca.data import read_dataset
from tmca.errors import SettingError
from tmca.lab.display.codes import planes_of, repeats
from tmca.lab.display.manifest import SOURCE_AT


def exported_snapshot(manifest: Mapping[str, Any], where: str = "snapshot") -> Snapshot[Any]:
    """The snapshot file that an export was made from, which says its camera; see also `camera_shown`.

    Args:
        manifest: of the export.
        where: what names another one.

    Raises:
        SettingError: the export was made from codes alone, or from a file that is gone.
    """
    source = Path(manifest.get(SOURCE_AT, manifest["source"]))
    stored = source.suffix in (".nc", ".h5") and source.is_file()
    if not stored or "snapshot" not in read_dataset(source):
        found = f"an export of {source}, which {'says codes alone' if source.exists() else 'is not found'}"
        remedy = f"write one: tmca simulate {_camera_options(manifest, source)} --out sim.nc"
        raise SettingError(where, found, "the snapshot file of its camera", remedy)
    return Snapshot.load(source)


def _camera_options(manifest: Mapping[str, Any], source: Path) -> str:
    """Options of `tmca simulate` for the camera of codes alone; those that do not repeat need a scene of their size."""
    kind = manifest["camera"] or "spectral"
    codes = codes_of_file(source) if kind != "spectral-depth" and source.is_file() else None
    planes = {plane["plane"]: plane["placement"]["code"] for plane in manifest["planes"] if "placement" in plane}
    whole = codes is not None and codes.period is None and "aperture" in planes
    crop = " --crop {}x{}".format(*planes["aperture"]) if whole else ""
    return f"{kind} SCENE --codes {source}{crop}"


def camera_shown(taken: Snapshot[Any], manifest: Mapping[str, Any]) -> Snapshot[Any]:
    """A snapshot whose camera has the size of an export; its own where the sizes are alike or the codes do not repeat.

    Codes that repeat are known for any size, so that a small simulation describes the camera of a whole device. A
    snapshot of another size has no values.
    """
    camera = taken.camera
    shown = {plane["plane"]: plane["placement"]["code"] for plane in manifest["planes"] if "placement" in plane}
    name = "aperture" if "aperture" in shown else "shutter"
    if not repeats(camera) or name not in shown:
        return taken
    own = planes_of(camera, "camera").planes[name].shape[-2:]
    size = tuple(side + there - here for side, there, here in zip(camera.size, shown[name], own, strict=True))
    if size == tuple(camera.size) or min(size) < 1:
        return taken
    larger = camera.replace(size=size)
    return Snapshot(torch.zeros(1, *larger.snapshot_shape), larger, taken.notes)
