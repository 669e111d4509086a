"""The codes that are exported, wherever they are kept: designs, runs, snapshots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from tmca.cameras import Camera, Snapshot, SpectralDepthCamera
from tmca.cameras.phase_codes import read_phase_codes
from tmca.codes import CodePlane, read_codes
from tmca.decoders import Weights
from tmca.decoders.nets.weights import shipped_file
from tmca.errors import DataError, SettingError, ShapeError
from tmca.optics import family_parameters

Size = tuple[int, int]


@dataclass(frozen=True)
class Planes:
    """Codes of one exposure.

    Args:
        source: file or folder they came from.
        application: name of the camera; empty where the codes do not say.
        planes: ``aperture`` (K, h, w) and ``shutter`` (K, h, w'), or ``heights`` (K, h, w) in metres and ``shutter``:
            full frames, or one tile.
        tiled: names of planes that are one tile.
        modes: of Zernike masks ``coefficients`` (K, M) in metres rms and ``noll`` (M,).
        settings: of the camera, as far as they are known.
    """

    source: str
    application: str
    planes: Mapping[str, Tensor]
    tiled: tuple[str, ...] = ()
    modes: Mapping[str, Tensor] | None = None
    settings: Mapping[str, Any] | None = None

    @property
    def slots(self) -> int:
        """K."""
        return len(next(iter(self.planes.values())))

    def full(self, name: str, size: Size | None = None) -> Tensor:
        """(K, H, W) a plane over a whole device.

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
        own = (int(plane.shape[1]), int(plane.shape[2]))
        if size is None or size == own:
            return plane
        if name in self.tiled:
            return CodePlane(plane, len(plane), size, period=own, name=name)()
        if own[0] < size[0] or own[1] < size[1]:
            raise ShapeError(self.source, f"{name} of {own[0]}×{own[1]} pixels", f"{size[0]}×{size[1]} or more")
        top, left = (own[0] - size[0]) // 2, (own[1] - size[1]) // 2
        return plane[:, top : top + size[0], left : left + size[1]]


def read_planes(source: str | Path) -> Planes:
    """Codes of a file of `tmca design` or the folder that it wrote, a run or weights of `tmca train`, or a snapshot;
    ``"default"`` are those of eight slots that come with the package.

    Raises:
        DataError: none of these.
    """
    path = shipped_file(8) if str(source) == "default" else Path(source)
    if (path / "codes.nc").is_file() and not any(path.rglob("*.safetensors")):
        path = path / "codes.nc"
    if path.is_dir() or path.suffix == ".safetensors":
        return _of_weights(path)
    if path.suffix not in (".nc", ".h5", ".zarr"):
        raise DataError(path, f"the suffix {path.suffix!r}", "codes.nc, a run, weights, default, or a snapshot file")
    return _of_file(path)


def _of_weights(path: Path) -> Planes:
    weights = Weights.load(path)
    if weights.kind == SpectralDepthCamera.kind:
        return planes_of(weights.camera, str(path))
    planes, about = weights.codes, {"size": weights.size, "exposure": weights.variables.attrs["exposure"]}
    return Planes(str(path), weights.kind, planes, tuple(planes) if weights.period else (), None, about)


def _of_file(path: Path) -> Planes:
    from tmca.data import read_dataset

    stored = read_dataset(path)
    if "snapshot" in stored:
        return planes_of(Snapshot.load(path).camera, str(path))
    if "heights" in stored:
        known = read_phase_codes(path)
        planes = {"heights": known["mask"]().detach(), "shutter": known["shutter"]}
        settings = {"material": known["bench"].material, "exposure": known["exposure"]}
        modes = family_parameters(known["mask"])
        return Planes(str(path), "spectral-depth", planes, ("shutter",), modes, settings)
    if "aperture" in stored:
        codes = read_codes(path)
        planes = {"aperture": codes.aperture, "shutter": codes.shutter}
        return Planes(str(path), str(stored.attrs.get("camera", "")), planes, tuple(planes) if codes.period else ())
    raise DataError(path, f"variables {', '.join(map(str, stored))}", "codes, or a snapshot", "see docs/devices.md")


@torch.no_grad()
def planes_of(camera: Camera, source: str) -> Planes:
    """Codes of a camera.

    Args:
        camera: of any of the three kinds.
        source: file or folder that it came from.

    Raises:
        SettingError: a coloured aperture.
    """
    if isinstance(camera, SpectralDepthCamera):
        heights, shutter = camera.codes()
        modes, settings = family_parameters(camera.point_spread.heights), {"material": camera.bench.material}
        return Planes(source, camera.kind, {"heights": heights, "shutter": shutter}, (), modes, settings)
    if getattr(camera, "coloured", None) is not None:
        raise SettingError(source, "a coloured aperture", "binary codes", "no device shows its filters")
    aperture, shutter = camera.codes()  # type: ignore[operator]
    planes = {"aperture": aperture, "shutter": shutter}
    return Planes(source, camera.kind, planes, (), None, {"size": camera.size, "exposure": camera.exposure})
