"""Training a decoder for the camera of a snapshot file: its mask, its bands, its optics, its noise."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.cameras import Snapshot
from tmca.data.scenes import load_scene
from tmca.errors import DataError

if TYPE_CHECKING:
    import xarray as xr

_NEAR = 1e-12
"""Metres by which a camera's band may lie beyond a scene's last one."""


def training_of(path: str | Path) -> tuple[dict[str, Any], Callable[[str], xr.DataArray]]:
    """Settings of a run by dotted name, and the reader of its scenes.

    Args:
        path: of a spectral snapshot; only its camera is used, never its values.

    Raises:
        DataError: a snapshot of another camera.
    """
    camera = Snapshot.load(path).camera
    if camera.kind != "spectral":
        raise DataError(path, f"a snapshot of a {camera.kind} camera", "a spectral one")
    aperture = camera.codes.aperture
    changes = {
        "camera.size": list(camera.size), "camera.slots": camera.slots, "camera.exposure": camera.exposure,
        "camera.dispersion": list(camera.dispersion.displacement), "camera.disperser": camera.disperser,
        "camera.response": camera.response.tolist(), "camera.learn": "none",
        "camera.buckets": camera.buckets,
        "camera.period": list(aperture.period) if aperture.period else None, "codes.start": str(path),
        "noise": [{"read_noise": camera.sensor.read_noise, "full_well": camera.sensor.full_well,
                   "read_noise_electrons": camera.sensor.read_noise_electrons, "bits": camera.sensor.bits}],
    }  # fmt: skip
    return changes, lambda name: scene_at(name, camera.wavelengths)


def scene_at(name: str, wavelengths: tuple[float, ...]) -> xr.DataArray:
    """A scene at a camera's bands, interpolated along the spectrum.

    Raises:
        DataError: a scene that does not reach the camera's first or last band.
    """
    cube = load_scene(name, bands=None)
    low, high = float(cube["wavelength"].min()), float(cube["wavelength"].max())
    if low > min(wavelengths) + _NEAR or high < max(wavelengths) - _NEAR:
        found = f"bands from {low * 1e9:.0f} to {high * 1e9:.0f} nm"
        wanted = f"all of {min(wavelengths) * 1e9:.0f} to {max(wavelengths) * 1e9:.0f} nm"
        raise DataError(name, found, wanted, "leave it out")
    asked = np.array(wavelengths)
    # a band beyond the last by a rounding error would become NaN
    at_bands = cube.interp(wavelength=asked.clip(low, high)).assign_coords(wavelength=asked)
    return at_bands.astype("float32").assign_attrs(cube.attrs)
