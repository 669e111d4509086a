"""What a simulated camera sees of a lamp."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tmca.cameras import LightFieldCamera, SpectralCamera, SpectralDepthCamera
from tmca.data import metres_to_nm
from tmca.errors import DeviceError
from tmca.lab.devices.light import Light

_BRIGHT = 0.8
"""Of the full scale, that the brightest single wavelength or view reaches."""
_NEAR = 1e-10
"""Metres between a wavelength and its band."""


def lit_scene(camera: Any, light: Light) -> tuple[Tensor, ...]:
    """What a camera images: (1, …) of a white surface under a light, one wavelength or view as bright as the sensor
    bears; (1, L, H, W) of a point and its depth (1, 1, H, W).

    Raises:
        DeviceError: a camera, wavelength or view that is not simulated.
    """
    if light.kind == "point":
        return _point(camera, light)
    shares = _shares(camera, light)
    shape = tuple(camera.scene_shape)
    share = torch.from_numpy(shares).float().reshape(1, *shares.shape, *(1 for _ in shape[shares.ndim :]))
    return (share.expand(1, *shape) * light.reflectance * light.exposure,)


def _point(camera: Any, light: Light) -> tuple[Tensor, Tensor]:
    """A point in the middle, in the plane of a depth; its image reaches the same peak in every frame."""
    _check(isinstance(camera, SpectralDepthCamera), f"a point before a {camera.kind} camera", "a white scene")
    _check(float(camera.filters.filters.min()) == 1, "a point behind colour filters", "clear ones (--filters clear)")
    planes = [float(one) for one in camera.planes.metres]
    nearest = min(planes, key=lambda one: abs(one - (light.depth or 0.0)))
    known = ", ".join(f"{one:.4g}" for one in planes)
    _check(abs(nearest - (light.depth or 0.0)) < 1e-4 * nearest, f"a point at {light.depth} m", f"a plane: {known} m")
    scene = torch.zeros(1, *camera.scene_shape)
    scene[..., camera.size[0] // 2, camera.size[1] // 2] = torch.from_numpy(_of_bands(camera, light.wavelength)).float()
    depth = torch.full((1, 1, *camera.size), nearest)
    return scene * _BRIGHT * camera.white / float(camera.exact(scene, depth).max()), depth


def _shares(camera: Any, light: Light) -> NDArray[np.floating[Any]]:
    """Brightness of every band, or view."""
    if isinstance(camera, SpectralCamera):
        _check(light.view is None, "one view", "none of a spectral camera")
        return _of_bands(camera, light.wavelength)
    if isinstance(camera, LightFieldCamera):
        _check(light.wavelength is None, "one wavelength", "none of a light-field camera, which sees white")
        return _of_views(camera, light.view)
    _check(False, f"a {camera.kind} camera", "a spectral or light-field one")
    raise AssertionError


def _of_bands(camera: SpectralCamera | SpectralDepthCamera, wavelength: float | None) -> NDArray[np.floating[Any]]:
    if wavelength is None:
        return np.ones(len(camera.wavelengths))
    chosen = np.abs(np.array(camera.wavelengths) - wavelength) < _NEAR
    bands = ", ".join(f"{metres_to_nm(one):g}" for one in camera.wavelengths)
    _check(bool(chosen.any()), f"{metres_to_nm(wavelength):g} nm", f"a band of the camera: {bands} nm")
    response = camera.response.detach()
    return chosen * _BRIGHT * camera.white / float(response.sum(0).max() if response.ndim == 2 else response.max())


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
