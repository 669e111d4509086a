"""Pictures of what a calibration measured, each part on two axes of `tmca.plots.style.panels`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.lab.calibration.buckets import BucketMixing
from tmca.lab.calibration.displacement import MeasuredDispersion, MeasuredShear
from tmca.lab.calibration.pattern_image import mapped
from tmca.lab.calibration.psf import PsfStack, ZernikeFit
from tmca.lab.calibration.registration import Registration, nominal_matrix
from tmca.lab.calibration.sensor import DarkField, FlatField, Linearity
from tmca.lab.calibration.timing import Timing
from tmca.plots.style import BLUE, RED, SMALL, add_bar, blank_figure, plain_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def dark(axes: Any, part: DarkField) -> None:
    """Offset and noise of a frame; maps of buckets beside each other."""
    mean, noise, defects = (_beside(one) for one in (part.mean, part.read_noise, part.defects > 0))
    _map(axes[0], mean, "offset", "digital numbers", defects)
    _map(axes[1], noise, "noise of a frame", "digital numbers", defects)


def flat(axes: Any, part: FlatField) -> None:
    """Response of the pixels over their mean, as a map and a histogram."""
    gain, defects = _beside(part.gain), _beside(part.defects > 0)
    _map(axes[0], gain, "response", "light over the mean", defects)
    axes[1].hist(gain[~defects], bins=60, color=BLUE)
    plain_axes(axes[1], f"response of pixels varies by {part.nonuniformity:.2%}", "light over the mean", "pixels")


def linearity(axes: Any, part: Linearity) -> None:
    """Levels over exposure with a line, and variances over the levels with the photon transfer, of those fitted."""
    used, milliseconds = np.isfinite(part.deviations), part.exposures * 1e3
    axes[0].plot(milliseconds, part.levels, "o", color="0.6")
    axes[0].plot(milliseconds[used], part.levels[used], "o", color=BLUE)
    axes[0].plot(milliseconds, part.offset + part.slope * part.exposures, color=RED, linewidth=1)
    title = f"off a line by {part.largest_deviation:.2g} of it at most"
    plain_axes(axes[0], title, "exposure (ms)", "digital numbers")
    predicted = (part.read_noise / part.gain) ** 2 + part.levels / part.gain
    axes[1].plot(part.levels[used], part.variances[used], "o", color=BLUE)
    axes[1].plot(part.levels[used], predicted[used], color=RED, linewidth=1)
    known = part.gain_std < part.gain
    title = f"{part.gain:.3g} ± {part.gain_std:.1g} electrons per digital number" if known else "electrons not known"
    plain_axes(axes[1], title, "level (digital numbers)", "variance")


def registration(axes: Any, part: Registration) -> None:
    """Points of the mask on the sensor, and how they are displaced beside a shift and a scale."""
    rows, columns = (np.linspace(0, n - 1, 9) for n in part.codes)
    mask = np.stack([one.ravel() for one in np.meshgrid(rows, columns, indexing="ij")])
    sensor = np.stack(mapped(part.matrix, *mask))
    axes[0].plot(sensor[1], sensor[0], ".", color=BLUE, markersize=4)
    height, width = part.sensor
    corners = [0, width - 1, width - 1, 0, 0], [0, 0, height - 1, height - 1, 0]
    axes[0].plot(*corners, color="0.6", linewidth=1)
    middle = mapped(part.matrix, *(np.array((n - 1) / 2) for n in part.codes))
    row, column = (float(at - (n - 1) / 2) for at, n in zip(middle, part.sensor, strict=True))
    title = f"mask (dots) on the sensor (frame)\nmiddle {row:+z.2f} rows, {column:+z.2f} columns from the sensor's"
    plain_axes(axes[0], title, "sensor column", "sensor row")
    moved = sensor - np.stack(mapped(nominal_matrix(part.codes, part.sensor, part.scale), *mask))
    moved = moved - moved.mean(axis=1, keepdims=True)
    axes[1].quiver(mask[1], mask[0], moved[1], moved[0], angles="xy", color=RED)
    longest = float(np.hypot(*moved).max())
    title = f"turn and skew, up to {longest:.2f} px; fit leaves {part.residual:.1%} of the contrast"
    plain_axes(axes[1], title, "mask column", "mask row")
    for axis in axes:
        axis.set_aspect("equal")
        axis.invert_yaxis()


def dispersion(axes: Any, part: MeasuredDispersion) -> None:
    """Displacements with their fitted curve; response."""
    nm, fine = part.wavelengths * 1e9, np.linspace(part.wavelengths[0], part.wavelengths[-1], 200)
    axes[0].plot(nm, part.shifts[:, 1], "o", color=BLUE, label="along x")
    axes[0].plot(nm, part.shifts[:, 0], "s", color="0.5", markersize=4, label="along y")
    axes[0].plot(fine * 1e9, part.at(fine)[:, 1], color=RED, linewidth=1)
    axes[0].legend(fontsize=SMALL)
    fitted = np.isfinite(part.residual[1])
    title = f"{part.curve} curve {f'leaves {part.residual[1]:.3f} px rms' if fitted else 'through all of them'}"
    plain_axes(axes[0], title, "wavelength (nm)", "displacement (sensor pixels)")
    axes[1].plot(nm, part.response, "o-", color=BLUE)
    axes[1].set_ylim(0, 1.1 * float(part.response.max()))
    plain_axes(axes[1], "response κ (mean 1)", "wavelength (nm)", "light over the source's power")


def shear(axes: Any, part: MeasuredShear) -> None:
    """Shifts of the shadow at the places of the views, and the light of these."""
    for axis, (name, colour, mark) in enumerate((("y", RED, "s"), ("x", BLUE, "o"))):
        place, step = part.places[:, axis], part.step[axis]
        centred = part.shifts[:, axis] - part.shifts[:, axis].mean() - step * place.mean()
        axes[0].plot(place, centred, mark, color=colour, label=f"along {name}", markersize=4)
        ends = np.array([place.min(), place.max()])
        axes[0].plot(ends, -step * ends, color=colour, linewidth=1)
    axes[0].legend(fontsize=SMALL)
    title = f"{part.step[0]:.4f}, {part.step[1]:.4f} px per view; rms {part.residual:.3f} px"
    plain_axes(axes[0], title, "view", "shift of the shadow (sensor pixels)")
    shown = axes[1].scatter(part.places[:, 1], part.places[:, 0], c=part.light, s=220, marker="s", cmap="viridis")
    axes[1].invert_yaxis()
    axes[1].margins(0.2)
    axes[1].figure.colorbar(shown, ax=axes[1])
    plain_axes(axes[1], "light of the views", "view along x", "view along y")


def timing(axes: Any, part: Timing) -> None:
    """Slots of shutter and aperture in time, and the time in which both are on."""
    for slot in range(part.slots):
        axes[0].barh(0.45, 1, left=slot, height=0.35, color=BLUE, edgecolor="white")
        begin = part.delay + part.ratio * slot
        axes[0].barh(0, part.ratio, left=begin, height=0.35, color=RED, edgecolor="white")
    axes[0].set_yticks([0, 0.45], ["shutter", "aperture"])
    title = f"delay {part.delay:+z.4f} slots, ratio {part.ratio:.4f}, leakage {part.leakage:.2%}"
    plain_axes(axes[0], title, "slots of the aperture", "")
    shown = axes[1].imshow(part.overlap(), cmap="viridis", vmin=0)
    axes[1].set(xticks=range(part.slots), yticks=range(part.slots))
    axes[1].figure.colorbar(shown, ax=axes[1])
    plain_axes(axes[1], "time in which both are on (slots)", "slot of the shutter", "slot of the aperture")


def buckets(axes: Any, part: BucketMixing) -> None:
    """Light of every bucket with all slots in one of them, then in turn, beside that of the fit; what is in the wrong
    place."""
    shown, count = part.levels.shape
    names = [f"all in {r + 1}" for r in range(count)] + ["in turn"] * (shown - count)
    width = 0.8 / count
    for bucket, colour in zip(range(count), cycle((BLUE, "0.6", "0.8"))):
        places = np.arange(shown) + (bucket - (count - 1) / 2) * width
        axes[0].bar(places, part.levels[:, bucket], 0.9 * width, color=colour, label=f"bucket {bucket + 1}")
        label = "fit" if not bucket else None
        axes[0].plot(places, part.predicted[:, bucket], "_", color=RED, markersize=14, label=label)
    axes[0].set_xticks(range(shown), names)
    axes[0].legend(fontsize=SMALL, loc="upper center", ncols=count + 1)
    axes[0].set_ylim(0, 1.3 * float(part.levels.max()))
    plain_axes(axes[0], "light of the buckets", "slots", "share of all light")
    percent = 100 * np.array([part.leakage, part.transfer])
    names = ["in other buckets", "lost at a change (of a slot)"]
    axes[1].bar(names, percent, 0.5, yerr=np.nan_to_num(100 * part.std), color=BLUE, ecolor=RED)
    for place, value in enumerate(percent):
        axes[1].annotate(
            f"{value:.2f} %", (place, value), (0, 4), textcoords="offset points", ha="center", fontsize=SMALL
        )
    axes[1].set_ylim(0, 1.2 * max(float(percent.max()), 0.1))
    plain_axes(axes[1], "light in the wrong place", "", "%")


def wavefront(axes: Any, part: ZernikeFit, stack: PsfStack) -> None:
    """Point spread functions, depths downwards and wavelengths to the right, each scaled to its own peak; Zernike terms
    of the heights beside those asked for."""
    scaled = stack.values / stack.values.max(axis=(2, 3), keepdims=True)
    rows = [np.concatenate(list(row), axis=1) for row in scaled]
    axes[0].imshow(np.sqrt(np.maximum(np.concatenate(rows), 0)), cmap="magma")
    height, width = stack.values.shape[2:]
    waves = [f"{w * 1e9:.0f}" for w in stack.wavelengths]
    axes[0].set_xticks(width * (np.arange(len(waves)) + 0.5), waves)
    axes[0].set_yticks(height * (np.arange(len(stack.depths)) + 0.5), [f"{z:g}" for z in stack.depths])
    plain_axes(axes[0], "point spread functions (square root)", "wavelength (nm)", "depth (m)")
    names = [f"{n},{m}" for n, m in part.modes]
    axes[1].bar(names, part.coefficients * 1e9, yerr=part.std * 1e9, color=BLUE, ecolor=RED)
    axes[1].tick_params(axis="x", rotation=60)
    title = f"heights beside those asked for; fit leaves {part.residual:.1%}"
    plain_axes(axes[1], title, "Zernike mode n,m", "nm rms")


def _beside(values: np.ndarray) -> np.ndarray:
    """(H, R·W) maps of buckets beside each other; (H, W) of one."""
    return np.hstack(list(values)) if values.ndim == 3 else values


def _map(axis: Any, values: np.ndarray, title: str, bar: str, bad: np.ndarray) -> None:
    low, high = np.percentile(values[~bad], [0.5, 99.5])
    places = np.argwhere(bad)
    shown = axis.imshow(values, cmap="gray", vmin=low, vmax=high, interpolation="nearest")
    axis.plot(places[:, 1], places[:, 0], "o", markerfacecolor="none", color=RED, markersize=8)
    plain_axes(axis, f"{title}; {len(places)} defects", "", "")
    add_bar(axis, shown, bar)


_OF_KIND: dict[str, Callable[..., None]] = {
    "dark": dark, "flat": flat, "linearity": linearity, "registration": registration, "buckets": buckets,
    "timing": timing, "dispersion": dispersion, "shear": shear, "wavefront": wavefront,
}  # fmt: skip
"""Draws a part of this kind onto two axes; a wavefront takes the point spread functions it was fitted to, too."""


def part_figure(parts: Mapping[str, Any], name: str, title: str) -> Figure:
    """The picture of a measured part; of point spread functions that of the wavefront that was fitted to them.

    Args:
        parts: of a calibration.
        name: of the part.
        title: above both axes.
    """
    name = name.replace("psf", "wavefront")
    figure, kind = blank_figure(9.2, 3.4), name.rstrip("0123456789")
    figure.suptitle(title, fontsize=10)
    drawn = [parts[name], *([parts[name.replace("wavefront", "psf")]] if kind == "wavefront" else [])]
    _OF_KIND[kind](figure.subplots(1, 2), *drawn)
    return figure
