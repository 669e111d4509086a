"""What a simulated camera sees of a lamp."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.cameras import LightFieldCamera, SpectralCamera
from tmca.data import metres_to_nm
from tmca.errors import DeviceError
from tmca.lab.devices.light import Light

_BRIGHT = 0.8
"""Of the full scale, that the brightest single wavelength or view reaches."""
_NEAR = 1e-10
"""Metres between a wavelength and its band."""


def lit_scene(camera: Any, light: Light) -> Tensor:
    """(1, …) scene of a white surface under a light: one wavelength or view as bright as the sensor bears.

    Raises:
        DeviceError: a camera, wavelength or view that is not simulated.
    """
    shares = _shares(camera, light)
    shape = tuple(camera.scene_shape)
    share = torch.from_numpy(shares).float().reshape(1, *shares.shape, *(1 for _ in shape[shares.ndim :]))
    return share.expand(1, *shape) * light.reflectance * light.exposure


def _shares(camera: Any, light: Light) -> NDArray[np.floating[Any]]:
    """Brightness of every band, or view."""
    if isinstance(camera, SpectralCamera):
        _check(light.view is None, "one view", "none of a spectral camera")
        return _of_bands(camera, light.wavelength)
    if isinstance(camera, LightFieldCamera):
        _check(light.wavelength is None, "one wavelength", "none of a light-field camera, which sees white")
        return _of_views(camera, light.view)
    _check(False, f"a {camera.application} camera", "a spectral or light-field one")
    raise AssertionError


def _of_bands(camera: SpectralCamera, wavelength: float | None) -> NDArray[np.floating[Any]]:
    if wavelength is None:
        return np.ones(camera.bands)
    chosen = np.abs(np.array(camera.wavelengths) - wavelength) < _NEAR
    bands = ", ".join(f"{metres_to_nm(one):g}" for one in camera.wavelengths)
    _check(bool(chosen.any()), f"{metres_to_nm(wavelength):g} nm", f"a band of the camera: {bands} nm")
    return chosen * _BRIGHT * camera.white / float(camera.response.detach().max())


def _of_views(camera: LightFieldCamera, view: tuple[int, int] | None) -> NDArray[np.floating[Any]]:
    shares = np.ones(camera.views)
    if view is None:
        return shares
    row, column = (one + n // 2 for one, n in zip(view, camera.views, strict=True))
    inside = 0 <= row < camera.views[0] and 0 <= column < camera.views[1]
    _check(inside, f"view {view[0]}, {view[1]}", f"one of {camera.views[0]}×{camera.views[1]}, from the middle")
    shares[:] = 0
    shares[row, column] = _BRIGHT * camera.white / float(camera.response.detach().max())
    return shares


def _check(fine: bool, found: str, expected: str) -> None:
    if not fine:
        raise DeviceError("simulated bench", found, expected, "render such frames with `tmca calibrate render`")
