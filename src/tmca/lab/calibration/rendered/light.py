"""Light on the sensor of a rendered bench in a coded exposure: every ray of every pixel, band or view, and slot."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tmca.cameras import LightFieldCamera, SpectralCamera
from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.rendered.physics import (
    looked_up,
    on_pixels,
    overlap_in_time,
    rays_of,
    shown_by,
    through,
    time_beside,
)
from tmca.lab.calibration.rendered.truth import REFERENCE, BenchTruth

_RAYS = 6


def white_power(wavelengths: ArrayLike) -> Array:
    """(n,) of the tunable source, which has little blue light."""
    return np.asarray(0.3 + 0.7 * (np.asarray(wavelengths) - 400e-9) / 300e-9)


def _on_devices(camera: SpectralCamera | LightFieldCamera, truth: BenchTruth) -> tuple[Array, Array, Array]:
    """(K, h, w) what the mask passes, (K + 1, H, W') what the shutter records in its slots and in none of them, and
    (K, K + 1) the time in which a slot of the mask meets each."""
    aperture, shutter = (plane.double().numpy() for plane in camera.codes())
    overlap = overlap_in_time(camera.slots, truth.delay, truth.ratio)
    beside = time_beside(camera.slots, truth.delay, truth.ratio)
    recorded = np.concatenate([shutter, 0 * shutter[:1]])
    recorded += truth.leakage * (1 - recorded)
    return shown_by(aperture, truth.contrast_ratio), recorded, np.concatenate([overlap, beside[:, None]], axis=1)


def spectral_light(camera: SpectralCamera, truth: BenchTruth, scene: Array) -> Array:
    """(H, W') light of a scene (L, H, W), 1 for white with everything open."""
    aperture, shutter, together = _on_devices(camera, truth)
    waves, size = np.array(camera.wavelengths), (camera.snapshot_shape[1], camera.snapshot_shape[2])
    rays, response = rays_of(size, _RAYS), truth.response(waves)
    start = np.interp(REFERENCE, waves, camera.dispersion.displacement) - camera.dispersion.origin
    light = np.zeros((camera.slots + 1, size[0] * _RAYS, size[1] * _RAYS))
    for band, shift in enumerate(truth.shifts(waves)):
        undone = rays - shift[:, None, None]
        codes = looked_up(aperture, through(truth.matrix, undone))
        emitted = looked_up(scene[band : band + 1], undone - np.array([0.0, start])[:, None, None])
        light += response[band] * emitted * np.tensordot(together.T, codes, 1)
    seen = on_pixels(light, _RAYS, truth.blur)
    return np.asarray((shutter * seen).sum(axis=0) / camera.slots / response.sum())


def light_field_light(camera: LightFieldCamera, truth: BenchTruth, scene: Array) -> Array:
    """(H, W) light of a light field (V, U, H, W), 1 for white with everything open."""
    aperture, shutter, together = _on_devices(camera, truth)
    mixed = np.tensordot(together.T, aperture, 1)
    rays = rays_of(camera.size, _RAYS)
    places = [(v - camera.views[0] // 2, u - camera.views[1] // 2) for v, u in np.ndindex(*camera.views)]
    share, found = truth.view_light(np.array(places)), np.zeros(camera.size)
    for (v, u), weight in zip(places, share, strict=True):
        met = rays + (truth.step * (v, u))[:, None, None]
        codes = on_pixels(looked_up(mixed, through(truth.matrix, met)), _RAYS, truth.blur)
        view = scene[v + camera.views[0] // 2, u + camera.views[1] // 2]
        found += weight * view * (shutter * codes).sum(axis=0) / camera.slots
    return found / share.sum()
