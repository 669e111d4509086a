"""Snapshot files: a capture together with everything that is needed to reconstruct it, one layout per camera."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from torch import Tensor

from tmca.cameras.camera import Camera
from tmca.cameras.snapshots import light_field, spectral, spectral_depth
from tmca.errors import DataError

Kind = TypeVar("Kind", bound=Camera)
_LAYOUTS: dict[str, Any] = {"spectral": spectral, "light-field": light_field, "spectral-depth": spectral_depth}


@dataclass
class Snapshot(Generic[Kind]):
    """A capture and the camera that took it.

    Args:
        values: (1, 1, H, W') snapshot; (3, 1, H, W) for a light field in colour; (1, C, H, W) for spectrum and depth.
        camera: with the codes of the exposure, its optics and its sensor.
        notes: what else is known (scene, seed, …), kept as attributes of the file.
    """

    values: Tensor
    camera: Kind
    notes: dict[str, Any] = field(default_factory=dict)

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write a NetCDF file.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        from tmca.data import write_dataset

        layout = _LAYOUTS[self.camera.kind]
        return write_dataset(layout.to_dataset(self.values, self.camera, self.notes), path, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | Path) -> Snapshot[Any]:
        """Read a file written by ``save``, or laid out like it by other software.

        Raises:
            DataError: not such a file, or a part of it is missing; the message names the part.
        """
        from tmca.data import read_dataset

        dataset = read_dataset(path)
        kind = dataset.attrs.get("camera", "spectral")
        if kind not in _LAYOUTS:
            raise DataError(path, f"camera = {kind!r}", f"one of {', '.join(_LAYOUTS)}", "correct the attribute")
        values, camera, own = _LAYOUTS[kind].from_dataset(dataset, str(path))
        return cls(values, camera, {str(k): v for k, v in dataset.attrs.items() if k not in own})


def holds_snapshot(variables: set[str]) -> bool:
    """Whether these are the variables of a snapshot file, coordinates apart."""
    return any(set(layout.NEEDED) - {"wavelength"} <= variables for layout in _LAYOUTS.values())
