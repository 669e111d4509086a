"""What a calibration measured: sensor, registration, dispersion, shear, timing, point spread functions, wavefront.

Every function draws on the two axes of `tmca.plots.style.panels`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.plots.style import BLUE, RED, SMALL, add_bar, plain_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_dark(axes: Any, mean: np.ndarray, read_noise: np.ndarray, defects: np.ndarray) -> None:
    """Offset and noise of a frame, ``(H, W)`` digital numbers; ``defects`` is true at bad pixels."""
    _map(axes[0], mean, "offset", "digital numbers", defects)
    _map(axes[1], read_noise, "noise of a frame", "digital numbers", defects)


def draw_flat(axes: Any, gain: np.ndarray, defects: np.ndarray, nonuniformity: float) -> None:
    """Response of the pixels ``(H, W)`` over their mean; ``defects`` is true at bad pixels."""
    _map(axes[0], gain, "response", "light over the mean", defects)
    axes[1].hist(gain[~defects], bins=60, color=BLUE)
    plain_axes(axes[1], f"response of pixels varies by {nonuniformity:.2%}", "light over the mean", "pixels")


def draw_linearity(
    axes: Any,
    exposures: np.ndarray,
    levels: np.ndarray,
    fitted: np.ndarray,
    variances: np.ndarray,
    predicted: np.ndarray,
    used: np.ndarray,
    titles: tuple[str, str],
) -> None:
    """Levels over exposure (seconds) with a line, and their variances over the levels with the photon transfer.

    ``used`` says which were fitted; the variances and ``predicted`` are shown of these.
    """
    axes[0].plot(exposures * 1e3, levels, "o", color="0.6")
    axes[0].plot(exposures[used] * 1e3, levels[used], "o", color=BLUE)
    axes[0].plot(exposures * 1e3, fitted, color=RED, linewidth=1)
    plain_axes(axes[0], titles[0], "exposure (ms)", "digital numbers")
    axes[1].plot(levels[used], variances[used], "o", color=BLUE)
    axes[1].plot(levels[used], predicted[used], color=RED, linewidth=1)
    plain_axes(axes[1], titles[1], "level (digital numbers)", "variance")


def draw_registration(
    axes: Any, mask: np.ndarray, sensor: np.ndarray, nominal: np.ndarray, size: tuple[int, int], residual: float
) -> None:
    """Points of the mask on the sensor, and how they are displaced beside a shift and a scale.

    Args:
        axes: two.
        mask: ``(2, N)`` rows and columns on the mask.
        sensor: ``(2, N)`` where they lie on the sensor, pixels.
        nominal: ``(2, N)`` where an upright mask of the same scale would lie.
        size: (H, W) of the sensor.
        residual: of the fit, share of the contrast.
    """
    axes[0].plot(sensor[1], sensor[0], ".", color=BLUE, markersize=4)
    corners = [0, size[1] - 1, size[1] - 1, 0, 0], [0, 0, size[0] - 1, size[0] - 1, 0]
    axes[0].plot(*corners, color="0.6", linewidth=1)
    plain_axes(axes[0], "mask (dots) on the sensor (frame)", "sensor column", "sensor row")
    moved = sensor - nominal
    moved = moved - moved.mean(axis=1, keepdims=True)
    axes[1].quiver(mask[1], mask[0], moved[1], moved[0], angles="xy", color=RED)
    longest = float(np.hypot(*moved).max())
    title = f"turn and skew, up to {longest:.2f} px; fit leaves {residual:.1%} of the contrast"
    plain_axes(axes[1], title, "mask column", "mask row")
    for axis in axes:
        axis.set_aspect("equal")
        axis.invert_yaxis()


def draw_dispersion(
    axes: Any,
    wavelengths: np.ndarray,
    shifts: np.ndarray,
    curve: tuple[np.ndarray, np.ndarray],
    response: np.ndarray,
    title: str,
) -> None:
    """Displacement ``(L, 2)`` in pixels with its fitted curve (wavelengths in metres, pixels along x); response."""
    nm = wavelengths * 1e9
    axes[0].plot(nm, shifts[:, 1], "o", color=BLUE, label="along x")
    axes[0].plot(nm, shifts[:, 0], "s", color="0.5", markersize=4, label="along y")
    axes[0].plot(curve[0] * 1e9, curve[1], color=RED, linewidth=1)
    axes[0].legend(fontsize=SMALL)
    plain_axes(axes[0], title, "wavelength (nm)", "displacement (sensor pixels)")
    axes[1].plot(nm, response, "o-", color=BLUE)
    axes[1].set_ylim(0)
    plain_axes(axes[1], "response κ (mean 1)", "wavelength (nm)", "light over the source's power")


def draw_shear(
    axes: Any, places: np.ndarray, shifts: np.ndarray, step: np.ndarray, light: np.ndarray, residual: float
) -> None:
    """Shifts of the shadow ``(N, 2)``, pixels, at the places of the views ``(N, 2)``, and their light ``(N,)``."""
    for axis, (name, colour, mark) in enumerate((("y", RED, "s"), ("x", BLUE, "o"))):
        place = places[:, axis]
        centred = shifts[:, axis] - shifts[:, axis].mean() - step[axis] * place.mean()
        axes[0].plot(place, centred, mark, color=colour, label=f"along {name}", markersize=4)
        ends = np.array([place.min(), place.max()])
        axes[0].plot(ends, -step[axis] * ends, color=colour, linewidth=1)
    axes[0].legend(fontsize=SMALL)
    title = f"{step[0]:.4f}, {step[1]:.4f} px per view; rms {residual:.3f} px"
    plain_axes(axes[0], title, "view", "shift of the shadow (sensor pixels)")
    shown = axes[1].scatter(places[:, 1], places[:, 0], c=light, s=220, marker="s", cmap="viridis")
    axes[1].invert_yaxis()
    axes[1].margins(0.2)
    axes[1].figure.colorbar(shown, ax=axes[1])
    plain_axes(axes[1], "light of the views", "view along x", "view along y")


def draw_timing(axes: Any, overlap: np.ndarray, delay: float, ratio: float, title: str) -> None:
    """Slots of shutter and aperture in time, and the ``(K, K)`` time in which both are on, slots of the aperture."""
    slots = len(overlap)
    for slot in range(slots):
        axes[0].barh(0.45, 1, left=slot, height=0.35, color=BLUE, edgecolor="white")
        axes[0].barh(0, ratio, left=delay + ratio * slot, height=0.35, color=RED, edgecolor="white")
    axes[0].set_yticks([0, 0.45], ["shutter", "aperture"])
    plain_axes(axes[0], title, "slots of the aperture", "")
    shown = axes[1].imshow(overlap, cmap="viridis", vmin=0)
    axes[1].set(xticks=range(slots), yticks=range(slots))
    axes[1].figure.colorbar(shown, ax=axes[1])
    plain_axes(axes[1], "time in which both are on (slots)", "slot of the shutter", "slot of the aperture")


def draw_buckets(
    axes: Any, levels: np.ndarray, predicted: np.ndarray, measured: Mapping[str, tuple[float, float]]
) -> None:
    """Light of every bucket ``(S, R)`` with all slots in one of them, then in turn, beside that of the fit; shares that
    were measured with their standard deviations."""
    shown, buckets = levels.shape
    names = [f"all in {r + 1}" for r in range(buckets)] + ["in turn"] * (shown - buckets)
    width = 0.8 / buckets
    for bucket, colour in zip(range(buckets), cycle((BLUE, "0.6", "0.8"))):
        places = np.arange(shown) + (bucket - (buckets - 1) / 2) * width
        axes[0].bar(places, levels[:, bucket], 0.9 * width, color=colour, label=f"bucket {bucket + 1}")
        axes[0].plot(places, predicted[:, bucket], "_", color=RED, markersize=14, label="fit" if not bucket else None)
    axes[0].set_xticks(range(shown), names)
    axes[0].legend(fontsize=SMALL, loc="upper center", ncols=buckets + 1)
    axes[0].set_ylim(0, 1.3 * float(levels.max()))
    plain_axes(axes[0], "light of the buckets", "slots", "share of all light")
    values, stds = (100 * np.array([one[k] for one in measured.values()]) for k in (0, 1))
    axes[1].bar(list(measured), values, 0.5, yerr=np.nan_to_num(stds), color=BLUE, ecolor=RED)
    for place, value in enumerate(values):
        axes[1].annotate(
            f"{value:.2f} %", (place, value), (0, 4), textcoords="offset points", ha="center", fontsize=SMALL
        )
    axes[1].set_ylim(0, 1.2 * max(float(values.max()), 0.1))
    plain_axes(axes[1], "light in the wrong place", "", "%")


def draw_psf(axis: Axes, psf: np.ndarray, wavelengths: np.ndarray, depths: np.ndarray) -> None:
    """Point spread functions ``(D, L, h, w)``: depths downwards, wavelengths to the right, both in metres, each scaled
    to its own peak."""
    scaled = psf / psf.max(axis=(2, 3), keepdims=True)
    rows = [np.concatenate(list(row), axis=1) for row in scaled]
    axis.imshow(np.sqrt(np.maximum(np.concatenate(rows), 0)), cmap="magma")
    height, width = psf.shape[2:]
    waves = [f"{w * 1e9:.0f}" for w in wavelengths]
    axis.set_xticks(width * (np.arange(len(waves)) + 0.5), waves)
    axis.set_yticks(height * (np.arange(len(depths)) + 0.5), [f"{z:g}" for z in depths])
    plain_axes(axis, "point spread functions (square root)", "wavelength (nm)", "depth (m)")


def draw_wavefront(
    axis: Axes, modes: Sequence[tuple[int, int]], coefficients: np.ndarray, std: np.ndarray, residual: float
) -> None:
    """Zernike terms (n, m) of the heights beside those asked for, metres rms, with standard deviations."""
    axis.bar([f"{n},{m}" for n, m in modes], coefficients * 1e9, yerr=std * 1e9, color=BLUE, ecolor=RED)
    axis.tick_params(axis="x", rotation=60)
    plain_axes(axis, f"heights beside those asked for; fit leaves {residual:.1%}", "Zernike mode n,m", "nm rms")


def _map(axis: Axes, values: np.ndarray, title: str, bar: str, bad: np.ndarray) -> None:
    low, high = np.percentile(values[~bad], [0.5, 99.5])
    places = np.argwhere(bad)
    shown = axis.imshow(values, cmap="gray", vmin=low, vmax=high, interpolation="nearest")
    axis.plot(places[:, 1], places[:, 0], "o", markerfacecolor="none", color=RED, markersize=8)
    plain_axes(axis, f"{title}; {len(places)} defects", "", "")
    add_bar(axis, shown, bar)
