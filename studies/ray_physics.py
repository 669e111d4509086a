"""Plain physics of a rendered bench: rays, finely cut time, sums of waves; estimators share none of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from studies.bench import MODES
from tmca.cameras import LightFieldCamera, SpectralCamera
from tmca.optics import PhaseMaskBench

Array = NDArray[np.float64]
_INSTANTS = 4000


def rays_of(size: tuple[int, int], rays: int) -> Array:
    """(2, H·r, W·r) rows and columns of rays over sensor pixels."""
    y, x = ((np.arange(n * rays) + 0.5) / rays - 0.5 for n in size)
    return np.stack(np.broadcast_arrays(y[:, None], x))


def looked_up(planes: Array, places: Array) -> Array:
    """(P, …) value of the pixel of (P, h, w) that every place (2, …) lies in, 0 outside."""
    row, column = np.floor(places + 0.5).astype(int)
    inside = (row >= 0) & (column >= 0) & (row < planes.shape[1]) & (column < planes.shape[2])
    return np.where(inside, planes[:, row * inside, column * inside], 0.0)


def through(matrix: Array, places: Array) -> Array:
    """Code pixels that rays to sensor places (2, …) come through."""
    linear, shift = np.linalg.inv(matrix[:, :2]), matrix[:, 2]
    return np.tensordot(linear, places - shift[:, None, None], 1)


def on_pixels(fine: Array, rays: int, blur: float) -> Array:
    """(P, H, W) mean of the rays of every pixel of (P, H·r, W·r), blurred by ``blur`` pixels."""
    from scipy.ndimage import gaussian_filter

    seen = gaussian_filter(fine, (0, blur * rays, blur * rays), mode="nearest") if blur else fine
    height, width = seen.shape[1] // rays, seen.shape[2] // rays
    return np.asarray(seen.reshape(len(seen), height, rays, width, rays).mean(axis=(2, 4)))


def seen_by_rays(patterns: Array, matrix: Array, size: tuple[int, int], rays: int = 8, blur: float = 0.0) -> Array:
    """(P, H, W) patterns (P, h, w) on a sensor, code pixels on sensor pixels by ``matrix`` (2, 3)."""
    return on_pixels(looked_up(patterns, through(matrix, rays_of(size, rays))), rays, blur)


def shown_by(mask: Array, contrast_ratio: float) -> Array:
    """Light that a mask of zeros, ones or greys passes: a ray in ``contrast_ratio`` where it is closed."""
    return mask + (1 - mask) / contrast_ratio


def _slots_in_time(slots: int, delay: float, ratio: float) -> tuple[Array, Array]:
    """Numbers of the slots of aperture and shutter that are on at every instant of the aperture's."""
    time = (np.arange(slots * _INSTANTS) + 0.5) / _INSTANTS
    return np.floor(time), np.floor((time - delay) / ratio)


def overlap_in_time(slots: int, delay: float, ratio: float) -> Array:
    """(K, K) share of an aperture slot in which it and a slot of the shutter are on, counted instant by instant."""
    aperture, shutter = _slots_in_time(slots, delay, ratio)
    shares = [[((aperture == i) & (shutter == j)).mean() * slots for j in range(slots)] for i in range(slots)]
    return np.array(shares)


def time_beside(slots: int, delay: float, ratio: float) -> Array:
    """(K,) share of an aperture slot in which no slot of the shutter is on, counted instant by instant."""
    aperture, shutter = _slots_in_time(slots, delay, ratio)
    beside = (shutter < 0) | (shutter >= slots)
    return np.array([((aperture == i) & beside).mean() * slots for i in range(slots)])


def pairs_in_time(slots: int, delay: float, ratio: float, contrast_ratio: float, leakage: float) -> Array:
    """(K, K) light, in whole slots, with slot i of a mask and slot j of a shutter alone open, instant by instant."""
    aperture, shutter = _slots_in_time(slots, delay, ratio)
    passed = [np.where(aperture == i, 1.0, 1 / contrast_ratio) for i in range(slots)]
    caught = [np.where(shutter == j, 1.0, leakage) for j in range(slots)]
    return np.array([[(one * other).mean() * slots for other in caught] for one in passed])


def glass_shift(wavelengths: Sequence[float], reference: float, span: float) -> Array:
    """(n,) displacement by a prism of BK7-like glass: pixels, 0 at the reference, ``span`` from 400 to 700 nm.

    Source of the index: Sellmeier terms of N-BK7 (Schott).
    """

    def index(metres: Array) -> Array:
        square = (np.asarray(metres) * 1e6) ** 2
        terms = [(1.03961212, 0.00600069867), (0.231792344, 0.0200179144), (1.01046945, 103.560653)]
        return np.asarray(np.sqrt(1 + sum(b * square / (square - c) for b, c in terms)))

    ends = index(np.array([400e-9, 700e-9]))
    return np.asarray(span * (index(np.array([reference])) - index(np.array(wavelengths))) / (ends[0] - ends[1]))


def point_of(
    bench: PhaseMaskBench,
    heights: Array,
    depth: float,
    wavelength: float,
    size: tuple[int, int],
    shift: Sequence[float] = (0.0, 0.0),
    samples: int = 5,
) -> Array:
    """(H, W) light of a point through a mirror in a lens' pupil, by a plain Fourier sum.

    Args:
        bench: of the camera; a mirror, with a focus.
        heights: (n, n) metres over the aperture, of any sampling.
        depth: of the point, metres.
        wavelength: metres.
        size: (H, W) of the frame.
        shift: of the point, pixels.
        samples: per side of a pixel.
    """
    place = ((np.arange(len(heights)) + 0.5) / len(heights) - 0.5) * bench.diameter
    square, focus = place[:, None] ** 2 + place**2, np.inf if bench.focus is None else bench.focus
    near, sharp = (square / (np.sqrt(square + z**2) + z) for z in (depth, focus))
    path = near - sharp
    wave = (square <= (bench.diameter / 2) ** 2) * np.exp(2j * np.pi / wavelength * (path + 2 * heights))
    turned = []
    for extent, away in zip(size, shift, strict=True):
        seen = ((np.arange(extent * samples) + 0.5) / samples - 0.5 - (extent - 1) / 2 - away) * bench.pitch
        turned.append(np.exp(-2j * np.pi * seen[:, None] * place / (wavelength * bench.distance)))
    light = np.abs(turned[0] @ wave @ turned[1].T) ** 2
    return np.asarray(light.reshape(size[0], samples, size[1], samples).mean(axis=(1, 3)))


@dataclass(frozen=True)
class BenchSensor:
    """A 16-bit sensor with faults.

    Args:
        offset: (H, W) digital numbers.
        response: (H, W) of pixels, near 1.
        hot, dead: (H, W) pixels.
        gain: electrons per digital number.
        read_noise: digital numbers.
        bright: digital numbers of a white scene above the dark.
    """

    offset: Array
    response: Array
    hot: NDArray[np.bool_]
    dead: NDArray[np.bool_]
    gain: float = 4.0
    read_noise: float = 12.0
    bright: float = 40000.0

    @classmethod
    def drawn(cls, size: tuple[int, int], rng: np.random.Generator) -> BenchSensor:
        """Offsets and responses of pixels, three hot and two dead ones."""
        offset = 1000 + 20 * rng.standard_normal(size)
        faults = np.zeros((2, *size), bool)
        for plane, count in zip(faults, (3, 2), strict=True):
            plane.flat[rng.choice(size[0] * size[1], count, replace=False)] = True
        return cls(offset, 1 + 0.01 * rng.standard_normal(size), faults[0], faults[1] & ~faults[0])

    def light(self, shares: Array) -> Array:
        """Digital numbers above the dark of light (…, H, W) in shares of white, without noise."""
        return np.asarray(np.where(self.dead, 0.05, self.response) * self.bright * shares)

    def recorded(self, shares: Array, rng: np.random.Generator, snr_db: float | None = None) -> NDArray[np.uint16]:
        """Frames (…, H, W) with noise of this signal-to-noise ratio (root mean square over noise), or with its own read
        and shot noise."""
        light = self.light(shares)
        if snr_db is None:
            noisy = rng.poisson(np.maximum(light, 0) * self.gain) / self.gain
            noisy = noisy + self.read_noise * rng.standard_normal(light.shape)
        else:
            spread = np.sqrt((light**2).mean()) / 10 ** (snr_db / 20)
            noisy = light + spread * rng.standard_normal(light.shape)
        whole = np.round(self.offset + np.where(self.hot, 8000.0, 0.0) + noisy)
        return np.asarray(np.clip(whole, 0, 65535).astype(np.uint16))


REFERENCE = 550e-9
"""Wavelength of the registration."""


@dataclass(frozen=True)
class BenchTruth:
    """What the estimators have to find.

    Args:
        matrix: (2, 3) code pixels to sensor pixels at ``REFERENCE``.
        blur: of the relay, sensor pixels.
        span: displacement from 400 to 700 nm, sensor pixels.
        tilt: displacement along y from 400 to 700 nm.
        delay, ratio: of the shutter, see `tmca.lab.calibration.timing.Timing`.
        step: (2,) sensor pixels per view.
        fall_off: of the light of a view, per squared view step.
        coefficients: (K, M) heights of the mask beside those asked for, metres rms.
        sensor: with its faults.
        contrast_ratio: light that open mask pixels pass over that of closed ones.
        leakage: share of the light that a closed shutter records; the spectral-depth bench has neither leaks nor delay.
    """

    matrix: Array
    blur: float
    span: float
    tilt: float
    delay: float
    ratio: float
    step: Array
    fall_off: float
    coefficients: Array
    sensor: BenchSensor
    contrast_ratio: float
    leakage: float

    @classmethod
    def drawn(
        cls, codes: tuple[int, int], sensor: tuple[int, int], place: Array, span: float, slots: int, seed: int
    ) -> BenchTruth:
        """Up to a degree of turn, 1 % of scale, and 1.5 pixels of shift beside the nominal ``place`` (2, 3); dispersion
        off by up to 6 %, shear 15 %, timing a quarter of a slot; mirrors off by about a seventh of a wave; contrast
        ratios of 50 to 400, and up to 2 % of the light in closed slots."""
        # leaks have a generator of their own: the other numbers of a seed stay what they were
        rng, leaks = np.random.default_rng(seed), np.random.default_rng((seed, 1))
        angle, scale, skew = np.deg2rad(rng.uniform(-1, 1)), 1 + rng.uniform(-0.01, 0.01), rng.uniform(-0.005, 0.005)
        turn = scale * np.array([[np.cos(angle), -np.sin(angle) + skew], [np.sin(angle), np.cos(angle)]])
        middle = np.array([(n - 1) / 2 for n in codes])
        centre = place[:, :2] @ middle + place[:, 2] + rng.uniform(-1.5, 1.5, 2)
        linear = turn @ place[:, :2]
        heights = rng.standard_normal((slots, len(MODES)))
        heights *= 40e-9 / np.linalg.norm(heights, axis=1, keepdims=True)
        return cls(
            matrix=np.hstack([linear, (centre - linear @ middle)[:, None]]),
            blur=float(rng.uniform(0.2, 0.4)),
            span=float(span * rng.uniform(0.94, 1.06)),
            tilt=float(rng.uniform(-0.06, 0.06)),
            delay=float(rng.uniform(0.08, 0.25) * rng.choice([-1, 1])),
            ratio=float(rng.uniform(0.97, 1.03)),
            step=rng.uniform(0.85, 1.15, 2),
            fall_off=float(rng.uniform(0.01, 0.03)),
            coefficients=heights,
            sensor=BenchSensor.drawn(sensor, rng),
            contrast_ratio=float(leaks.uniform(50, 400)),
            leakage=float(leaks.uniform(0, 0.02)),
        )

    def shifts(self, wavelengths: Array) -> Array:
        """(n, 2) displacement against ``REFERENCE`` along y and x, sensor pixels."""
        across = self.tilt * (np.asarray(wavelengths) - REFERENCE) / 300e-9
        return np.stack([across, glass_shift(wavelengths.tolist(), REFERENCE, self.span)], axis=1)

    def response(self, wavelengths: Array) -> Array:
        """(n,) κ: rises to the green and falls to the red, as silicon behind a lens does."""
        return np.asarray(0.35 + 0.65 * np.exp(-(((np.asarray(wavelengths) - 560e-9) / 110e-9) ** 2)))

    def view_light(self, places: Array) -> Array:
        """(n,) of views (n, 2)."""
        return np.asarray(1 - self.fall_off * (np.asarray(places) ** 2).sum(axis=1))


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
    share, light = truth.view_light(np.array(places)), np.zeros(camera.size)
    for (v, u), weight in zip(places, share, strict=True):
        met = rays + (truth.step * (v, u))[:, None, None]
        codes = on_pixels(looked_up(mixed, through(truth.matrix, met)), _RAYS, truth.blur)
        view = scene[v + camera.views[0] // 2, u + camera.views[1] // 2]
        light += weight * view * (shutter * codes).sum(axis=0) / camera.slots
    return light / share.sum()
