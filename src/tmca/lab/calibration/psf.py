"""Point spread functions from captures of a point, and the wavefront behind them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from tmca.errors import DataError, SettingError, ShapeError
from tmca.lab.calibration.fitting import fit_std, robust_std
from tmca.lab.frames import Array
from tmca.optics import PhaseMaskBench
from tmca.optics.phase import circular_aperture, radians_per_metre, spherical_wave
from tmca.optics.zernike import Mode, noll, zernike_modes

_LEAST = 10.0
"""Brightest pixel over the noise, below which no point is seen."""
_BRIGHT = 0.2


@dataclass(frozen=True)
class PsfStack:
    """Cut-outs around a point, background taken off, of unit energy.

    Args:
        values: (D, L, h, w).
        depths: (D,) metres.
        wavelengths: (L,) metres.
        centres: (D, 2) row and column of the middle of each cut-out on the sensor.
        noise: (D, L) standard deviation of a pixel, units of ``values``.
    """

    values: Array
    depths: Array
    wavelengths: Array
    centres: Array
    noise: Array

    @property
    def snr_db(self) -> float:
        """Root mean square of the cut-outs over the noise."""
        return float(20 * np.log10(np.sqrt((self.values**2).mean()) / max(np.sqrt((self.noise**2).mean()), 1e-30)))


def measure_psf(
    frames: ArrayLike,
    depths: ArrayLike,
    wavelengths: ArrayLike,
    window: tuple[int, int] = (31, 31),
    *,
    source: object = "psf",
) -> PsfStack:
    """Cut the point out of every frame: around one middle per depth, the centroid over its wavelengths.

    Args:
        frames: (D, L, H, W) linear digital numbers, dark taken off.
        depths: (D,) of the source, metres.
        wavelengths: (L,) metres.
        window: (h, w) odd, pixels.
        source: named in errors.

    Raises:
        SettingError: an even window, or one as large as the frames.
        DataError: a frame without a point, or a point too near the frame's border.
    """
    values = np.asarray(frames, dtype=np.float64)
    metres, waves = np.asarray(depths, dtype=np.float64), np.asarray(wavelengths, dtype=np.float64)
    if values.shape[:2] != (len(metres), len(waves)) or values.ndim != 4:
        raise SettingError("psf", f"frames of shape {values.shape}", f"({len(metres)}, {len(waves)}, H, W)")
    if any(side % 2 == 0 or not 3 <= side <= n - 4 for side, n in zip(window, values.shape[2:], strict=True)):
        found = f"{window[0]}×{window[1]} in frames of {values.shape[2]}×{values.shape[3]}"
        raise SettingError("window", found, "odd sides, smaller than the frames by 4 pixels or more")
    cut, centres = np.empty((*values.shape[:2], *window)), np.empty((len(metres), 2))
    noise = np.empty(values.shape[:2])
    for depth, stack in enumerate(values):
        place = _middle(stack, f"{source} ({metres[depth]:g} m)")
        centres[depth] = place
        for wave, frame in enumerate(stack):
            where = f"{source} ({metres[depth]:g} m, {waves[wave] * 1e9:g} nm)"
            cut[depth, wave], noise[depth, wave] = _cut(frame, place, window, where)
    return PsfStack(cut, metres, waves, centres, noise)


def _middle(stack: Array, where: str) -> tuple[int, int]:
    """Centroid of what is brighter than a fifth of the peak, over all wavelengths, to whole pixels."""
    centroid = np.zeros(2)
    for frame in stack:
        above = frame - np.median(frame)
        noise = robust_std(above) + 1e-12
        if above.max() < _LEAST * noise:
            what = f"no point (the brightest pixel is {above.max() / noise:.1f} times the noise)"
            raise DataError(where, what, f"{_LEAST:g} times or more", "give more light, or expose for longer")
        weight = np.where(above > _BRIGHT * above.max(), above, 0.0)
        rows, columns = np.indices(frame.shape)
        centroid += np.array([(weight * rows).sum(), (weight * columns).sum()]) / weight.sum() / len(stack)
    return round(float(centroid[0])), round(float(centroid[1]))


def _cut(frame: Array, place: tuple[int, int], window: tuple[int, int], where: str) -> tuple[Array, float]:
    """The cut-out of unit energy, and the standard deviation of its noise."""
    spans = [slice(p - side // 2, p + side // 2 + 1) for p, side in zip(place, window, strict=True)]
    if any(s.start < 0 or s.stop > n for s, n in zip(spans, frame.shape, strict=True)):
        found = f"a point at row {place[0]}, column {place[1]}"
        raise DataError(where, found, f"half a window of {window[0]}×{window[1]} from the border", "move the source")
    outside = np.ones(frame.shape, bool)
    outside[spans[0], spans[1]] = False
    around = frame[outside]
    background = float(np.median(around))
    part = frame[spans[0], spans[1]] - background
    energy = float(part.sum())
    if not energy > 0:
        raise DataError(where, "a point without light", "light above the background", "expose for longer")
    return part / energy, robust_std(around - background) / energy


MODES: tuple[Mode, ...] = tuple(noll(index) for index in range(4, 16))
"""Without piston, which nothing shows, and tilts, which the place of the source makes."""
LARGEST_RESIDUAL = 0.2
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
        source: named in errors.

    Raises:
        SettingError: one depth only, or tilts among the modes.
        ShapeError: a stack or heights that are not the bench's.
        DataError: no start leads to a fit that explains the point spread functions.
    """
    _check(stack, bench, modes, nominal)
    model = _Model(stack, bench, tuple(modes), nominal)
    rng = np.random.default_rng(0)
    best: Any = None
    tried = 0
    for tried in range(1, _STARTS + 1):
        other = rng.standard_normal(len(modes)) * _START_RMS / _MICRO / np.sqrt(len(modes))
        fit = model.fitted(other * (tried > 1))
        best = fit if best is None or fit.cost < best.cost else best
        if model.residual(best) < max(_GOOD, 1.5 * 10 ** (-stack.snr_db / 20)):
            break
    residual = model.residual(best)
    if residual > LARGEST_RESIDUAL:
        what = f"point spread functions of which the best fit leaves {residual:.0%}"
        remedy = "check bench, depths and window, and the heights that were asked for"
        raise DataError(source, what, f"{LARGEST_RESIDUAL:.0%} at most", remedy)
    count, spread, values = len(modes), fit_std(best) * _MICRO, best.x * _MICRO
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


class _Model:
    """Point spread functions of coefficients (M) and tilts (D, 2), all in micrometres, and their derivatives."""

    def __init__(
        self, stack: PsfStack, bench: PhaseMaskBench, modes: tuple[Mode, ...], nominal: ArrayLike | None
    ) -> None:
        self.data, self.count, self.samples = stack.values, len(modes), bench.oversampling
        waves = stack.wavelengths.tolist()
        self.turns = radians_per_metre(waves, bench.phase_material()) * _MICRO
        heights = torch.zeros(bench.mask_size) if nominal is None else torch.as_tensor(np.asarray(nominal) / _MICRO)
        self.nominal = heights.double()
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

    def residual(self, fit: Any) -> float:
        """rms of what is left over the rms of the data."""
        return float(np.sqrt((fit.fun**2).sum() / (self.data**2).sum()))

    def residuals(self, values: Array) -> Array:
        fields = [self.propagator(self._before(values, depth)) for depth in range(len(self.data))]
        seen = [self._pixels(field.abs().square()) for field in fields]
        return np.concatenate([self._split(light, depth)[0].ravel() for depth, light in enumerate(seen)])

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

    def _pixels(self, light: Tensor) -> Array:
        """(..., L, h, w) mean of samples over pixels."""
        return np.asarray(torch.nn.functional.avg_pool2d(light, self.samples), dtype=np.float64)

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
