"""The hidden numbers of a rendered bench, drawn by a seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.measurements.zernike_fit import MODES
from tmca.lab.calibration.rendered.physics import BenchSensor, glass_shift

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
        delay, ratio: of the shutter, see `tmca.lab.calibration.measurements.timing.Timing`.
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
