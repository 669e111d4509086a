"""Captures of scenes on a rendered bench, each beside its truth: what a decoder is fine-tuned on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zlib import crc32

import numpy as np

from tmca.cameras import LightFieldCamera, Snapshot, SpectralCamera
from tmca.data import write_dataset
from tmca.errors import SettingError
from tmca.lab.calibration.rendered.cameras import raw_snapshot
from tmca.lab.calibration.rendered.light import light_field_light, spectral_light
from tmca.lab.calibration.rendered.truth import BenchTruth

if TYPE_CHECKING:
    import xarray as xr


def write_captures(folder: Path, camera: Any, truth: BenchTruth, scenes: Mapping[str, xr.DataArray], seed: int) -> None:
    """Write ``NAME.nc``, a raw snapshot, and ``NAME_truth.nc`` of every scene.

    Args:
        folder: to write into.
        camera: the nominal one.
        truth: of the bench.
        scenes: by name: cubes (wavelength, y, x) or light fields (view_v, view_u, y, x) at the camera's bands or views
            and size.
        seed: of the noise, together with the name.

    Raises:
        SettingError: a scene of another size.
    """
    if scenes:
        folder.mkdir()
    for name, scene in scenes.items():
        captured(camera, truth, scene, name, seed).save(folder / f"{name}.nc")
        write_dataset(scene.to_dataset(name="radiance" if "wavelength" in scene.dims else "light_field"),
                      folder / f"{name}_truth.nc")  # fmt: skip


def captured(camera: Any, truth: BenchTruth, scene: xr.DataArray, name: str, seed: int) -> Snapshot[Any]:
    """The raw snapshot of a scene; arguments as of ``write_captures``."""
    values = np.asarray(scene.values, dtype=np.float64)
    if values.shape != tuple(camera.scene_shape):
        found, wanted = ("×".join(map(str, n)) for n in (values.shape, camera.scene_shape))
        raise SettingError(name, f"a scene of {found}", f"{wanted} (bands or views, rows, columns)")
    if isinstance(camera, SpectralCamera):
        shares = spectral_light(camera, truth, values)
    elif isinstance(camera, LightFieldCamera):
        shares = light_field_light(camera, truth, values)
    else:
        raise SettingError("scenes", f"some for a {camera.kind} bench", "none", "leave them out")
    rng = np.random.default_rng((seed, crc32(name.encode())))
    return raw_snapshot(camera, truth, shares[None], rng, name)
