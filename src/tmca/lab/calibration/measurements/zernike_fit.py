"""The wavefront behind measured point spread functions: Zernike coefficients of the mask, by least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from tmca.data import metres_to_nm
from tmca.errors import DataError, SettingError, ShapeError
from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.measurements.psf import PsfStack
from tmca.optics import PhaseMaskBench
from tmca.optics.phase import circular_aperture, radians_per_metre, spherical_wave
from tmca.optics.zernike import Mode, noll, zernike_modes

MODES: tuple[Mode, ...] = tuple(noll(index) for index in range(4, 16))
"""Without piston, which nothing shows, and tilts, which the place of the source makes."""
LARGEST_RESIDUAL = 0.2
_ALONE, _BESIDE = 0.1, 4.0
"""Share of a capture beyond its noise that the fit may leave, where that is four times what it leaves of most: two that
were named after each other keep a half."""
_GOOD = 0.06
_STARTS = 6
_START_RMS = 0.08e-6
_MICRO = 1e-6


@dataclass(frozen=True)
class ZernikeFit:
    """Heights of the mask are ``nominal + Σ_m coefficients_m Z_m``.

    Args:
        modes: (n, m) of each.
        coefficients: (M,) metres rms of height.
        std: (M,) from the fit.
        tilts: (D, 2) metres rms of height of modes (1, -1), (1, 1): where the source was, depth by depth.
        residual: rms of what the fit leaves, over the rms of the point spread functions.
        starts: that were tried.
    """

    modes: tuple[Mode, ...]
    coefficients: Array
    std: Array
    tilts: Array
    residual: float
    starts: int


def fit_zernike_psf(
    stack: PsfStack,
    bench: PhaseMaskBench,
    *,
    modes: Sequence[Mode] = MODES,
    nominal: ArrayLike | None = None,
    start: ArrayLike | None = None,
    seed: int = 0,
    source: object = "psf",
) -> ZernikeFit:
    """Nonlinear least squares of all point spread functions together, through the package's own propagation.

    One plane alone has a twin: the wavefront turned by half a turn with its sign changed. Planes before and behind the
    focus tell them apart. Light and background of every frame, and tilts of every depth, are fitted beside the modes.

    Args:
        stack: of one slot, two depths or more.
        bench: its optics; ``bench.window`` is that of the stack.
        modes: (n, m) to fit.
        nominal: (H, W) heights that were asked for, metres, to which the modes are added; flat without it.
        start: (M,) coefficients to begin at, metres; other starts are tried where it does not lead to a good fit.
        seed: of the other starts.
        source: named in errors.

    Raises:
        SettingError: one depth only, or tilts among the modes.
        ShapeError: a stack or heights that are not the bench's.
        DataError: no start leads to a fit that explains the point spread functions, or all but one or a few of them.
    """
    _check(stack, bench, modes, nominal)
    model = _Model(stack, bench, tuple(modes), nominal)
    rng, first = np.random.default_rng(seed), np.zeros(len(modes)) if start is None else np.asarray(start) / _MICRO
    best: Any = None
    tried = 0
    for tried in range(1, _STARTS + 1):
        other = rng.standard_normal(len(modes)) * _START_RMS / _MICRO / np.sqrt(len(modes))
        found = model.fitted(first if tried == 1 else first + other)
        best = found if best is None or found.cost < best.cost else best
        if model.residual(best) < max(_GOOD, 1.5 * 10 ** (-stack.snr_db / 20)):
            break
    residual = model.residual(best)
    if residual > LARGEST_RESIDUAL:
        what = f"point spread functions of which the best fit leaves {residual:.0%}"
        remedy = "check bench, depths and window, and the heights that were asked for"
        raise DataError(source, what, f"{LARGEST_RESIDUAL:.0%} at most", remedy)
    _check_each(best.fun.reshape(stack.values.shape), stack, source)
    count, spread = len(modes), _std(best)
    values = best.x * _MICRO
    return ZernikeFit(tuple(modes), values[:count], spread[:count], values[count:].reshape(-1, 2), residual, tried)


def wavefront_rms(coefficients: ArrayLike, bench: PhaseMaskBench, wavelength: float) -> float:
    """Root mean square of the wavefront of height coefficients (metres rms), in waves."""
    turns = float(radians_per_metre([wavelength], bench.phase_material())[0]) / (2 * np.pi)
    return float(np.linalg.norm(np.asarray(coefficients))) * turns


def _check(stack: PsfStack, bench: PhaseMaskBench, modes: Sequence[Mode], nominal: ArrayLike | None) -> None:
    if len(stack.depths) < 2:
        raise SettingError("depths", "one", "two or more: one plane does not tell a wavefront from its twin")
    if not modes or any(mode in ((0, 0), (1, -1), (1, 1)) for mode in modes):
        raise SettingError("modes", str(list(modes)), "modes of order 2 or more")
    if stack.values.shape[2:] != tuple(bench.window):
        raise ShapeError("psf", f"a window of {stack.values.shape[2:]}", f"{bench.window}, the bench's")
    if nominal is not None and np.shape(nominal) != bench.mask_size:
        raise ShapeError("heights", str(np.shape(nominal)), f"{bench.mask_size}, the bench's mask")


def _check_each(left: Array, stack: PsfStack, source: object) -> None:
    """Raises DataError for a capture that the fit, left (D, L, h, w), explains far worse than the others."""
    power = (stack.values**2).sum(axis=(2, 3))
    noise = stack.noise**2 * left[0, 0].size
    shares = np.sqrt(np.maximum((left**2).sum(axis=(2, 3)) - noise, 0.0) / power)
    depth, wave = np.unravel_index(int(shares.argmax()), shares.shape)
    worst, usual = float(shares.max()), float(np.median(shares))
    if worst > max(_ALONE, _BESIDE * usual):
        name = f"{stack.depths[depth]:g} m, {metres_to_nm(stack.wavelengths[wave]):g} nm"
        what = f"a point ({name}) of which the fit leaves {worst:.0%} where it leaves {usual:.0%} of most"
        raise DataError(source, what, f"{_ALONE:.0%} at most", "check the depths and wavelengths in the names")


class _Model:
    """Point spread functions of coefficients (M) and tilts (D, 2), all in micrometres, and their derivatives."""

    def __init__(
        self, stack: PsfStack, bench: PhaseMaskBench, modes: tuple[Mode, ...], nominal: ArrayLike | None
    ) -> None:
        self.data, self.count, self.samples = stack.values, len(modes), bench.oversampling
        waves = stack.wavelengths.tolist()
        self.turns = radians_per_metre(waves, bench.phase_material()) * _MICRO
        own = torch.zeros(bench.mask_size) if nominal is None else torch.as_tensor(np.asarray(nominal) / _MICRO)
        self.nominal = own.double()
        self.basis, self.tilts = (zernike_modes(m, bench.mask_size) for m in (modes, ((1, -1), (1, 1))))
        aperture = circular_aperture(bench.mask_size)
        self.points = torch.stack(
            [aperture * spherical_wave(bench.mask_size, bench.mask_pitch, waves, z, bench.focus) for z in stack.depths]
        )
        self.propagator = bench.propagator(waves)

    def fitted(self, start: Array) -> Any:
        from scipy.optimize import least_squares

        values = np.concatenate([start, np.zeros(2 * len(self.data))])
        return least_squares(self.residuals, values, jac=self.jacobian, x_scale=0.05, xtol=1e-6, ftol=1e-8, max_nfev=60)

    def residual(self, found: Any) -> float:
        """rms of what is left over the rms of the data."""
        return float(np.sqrt((found.fun**2).sum() / (self.data**2).sum()))

    def residuals(self, values: Array) -> Array:
        left = [
            self._split(self._pixels(self._field(values, d).abs().square()), d)[0].ravel()
            for d in range(len(self.data))
        ]
        return np.concatenate(left)

    def jacobian(self, values: Array) -> Array:
        """Derivatives with light and background of every frame eliminated (Kaufman, BIT 15, 49, 1975)."""
        rows = []
        for d in range(len(self.data)):
            before = self._before(values, d)
            moved = torch.cat([self.basis, self.tilts])[:, None] * (1j * self.turns[:, None, None] * before)
            field, change = self.propagator(before), self.propagator(moved)
            slope = self._pixels(2 * (field.conj() * change).real)
            _, light, free = self._split(self._pixels(field.abs().square()), d)
            part = -light[None, :, None, None] * free(slope)
            wide = np.zeros((len(values), part[0].size))
            wide[: self.count] = part[: self.count].reshape(self.count, -1)
            at = self.count + 2 * d
            wide[at : at + 2] = part[self.count :].reshape(2, -1)
            rows.append(wide)
        return np.concatenate(rows, axis=1).T

    def _before(self, values: Array, depth: int) -> Tensor:
        """(L, H, W) field just behind the mask."""
        at = self.count + 2 * depth
        heights = self.nominal + torch.tensordot(torch.from_numpy(values[: self.count]), self.basis, 1)
        heights = heights + torch.tensordot(torch.from_numpy(values[at : at + 2]), self.tilts, 1)
        phase = self.turns[:, None, None] * heights
        return self.points[depth] * torch.polar(torch.ones_like(phase), phase)

    def _field(self, values: Array, depth: int) -> Tensor:
        found: Tensor = self.propagator(self._before(values, depth))
        return found

    def _pixels(self, light: Tensor) -> Array:
        """(..., L, h, w) sum of samples over pixels."""
        if self.samples > 1:
            flat = light.reshape(-1, 1, *light.shape[-2:])
            light = torch.nn.functional.avg_pool2d(flat, self.samples).reshape(
                *light.shape[:-2], light.shape[-2] // self.samples, light.shape[-1] // self.samples
            )
        return np.asarray(light.numpy(), dtype=np.float64)

    def _split(self, shape: Array, depth: int) -> tuple[Array, Array, Any]:
        """What the best light and background leave of each frame, the light (L,), and the projection that frees of
        both."""
        centred = shape - shape.mean(axis=(-2, -1), keepdims=True)
        power = np.maximum((centred**2).sum(axis=(-2, -1), keepdims=True), 1e-300)

        def free(values: Array) -> Array:
            plain = values - values.mean(axis=(-2, -1), keepdims=True)
            return np.asarray(plain - (plain * centred).sum(axis=(-2, -1), keepdims=True) / power * centred)

        light = (self.data[depth] * centred).sum(axis=(-2, -1)) / power[..., 0, 0]
        return free(self.data[depth]), light, free


def _std(found: Any) -> Array:
    freedom = max(1, found.fun.size - found.x.size)
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * float((found.fun**2).sum()) / freedom
    return np.asarray(np.sqrt(np.diag(covariance)) * _MICRO)
