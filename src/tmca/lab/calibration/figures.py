"""A picture of what a step of a calibration measured."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.lab.calibration.measurements.dark_flat import DarkField, FlatField
from tmca.lab.calibration.measurements.dispersion import MeasuredDispersion
from tmca.lab.calibration.measurements.linearity import Linearity
from tmca.lab.calibration.measurements.pattern_image import mapped
from tmca.lab.calibration.measurements.psf import PsfStack
from tmca.lab.calibration.measurements.registration import Registration, nominal_matrix
from tmca.lab.calibration.measurements.shear import MeasuredShear
from tmca.lab.calibration.measurements.timing import Timing
from tmca.lab.calibration.measurements.zernike_fit import ZernikeFit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BLUE, _RED, _SMALL = "#00798c", "#d1495b", 8


def part_figure(part: Any, title: str, stack: PsfStack | None = None) -> Figure:
    """The picture of a measured part; of a wavefront beside the point spread functions it was fitted to."""
    from matplotlib.figure import Figure

    draw: dict[type, Any] = {
        DarkField: _dark, FlatField: _flat, Linearity: _linearity, Registration: _registration,
        MeasuredDispersion: _dispersion, MeasuredShear: _shear, Timing: _timing, PsfStack: _psf,
    }  # fmt: skip
    figure = Figure(figsize=(9.2, 3.4), layout="constrained")
    figure.suptitle(title, fontsize=10)
    axes = figure.subplots(1, 2)
    if isinstance(part, ZernikeFit):
        _wavefront(axes[1], part)
        if stack is not None:
            _montage(axes[0], stack)
    else:
        draw[type(part)](axes, part)
    return figure


def _dark(axes: Any, part: DarkField) -> None:
    _map(axes[0], part.mean, "offset", "digital numbers", part.defects > 0)
    _map(axes[1], part.read_noise, "noise of a frame", "digital numbers", part.defects > 0)


def _flat(axes: Any, part: FlatField) -> None:
    _map(axes[0], part.gain, "light over the mean", "", part.defects > 0)
    good = part.gain[part.defects == 0]
    axes[1].hist(good, bins=60, color=_BLUE)
    _named(axes[1], f"response of pixels varies by {part.nonuniformity:.2%}", "light over the mean", "pixels")


def _linearity(axes: Any, part: Linearity) -> None:
    used = np.isfinite(part.deviations)
    axes[0].plot(part.exposures * 1e3, part.levels, "o", color="0.6")
    axes[0].plot(part.exposures[used] * 1e3, part.levels[used], "o", color=_BLUE)
    axes[0].plot(part.exposures * 1e3, part.offset + part.slope * part.exposures, color=_RED, linewidth=1)
    _named(axes[0], f"off a line by {part.largest_deviation:.2g} of it at most", "exposure (ms)", "digital numbers")
    axes[1].plot(part.levels[used], part.variances[used], "o", color=_BLUE)
    line = (part.read_noise / part.gain) ** 2 + part.levels[used] / part.gain
    axes[1].plot(part.levels[used], line, color=_RED, linewidth=1)
    text = f"{part.gain:.3g} ± {part.gain_std:.1g} electrons per digital number"
    _named(axes[1], text, "level (digital numbers)", "variance")


def _registration(axes: Any, part: Registration) -> None:
    rows, columns = (np.linspace(0, n - 1, 9) for n in part.codes)
    grid = np.meshgrid(rows, columns, indexing="ij")
    there = mapped(part.matrix, *grid)
    scale = float(np.sqrt(abs(np.linalg.det(part.matrix[:, :2]))))
    plain = mapped(nominal_matrix(part.codes, part.sensor, scale), *grid)
    axes[0].plot(there[1], there[0], ".", color=_BLUE, markersize=4)
    corners = [0, part.sensor[1] - 1, part.sensor[1] - 1, 0, 0], [0, 0, part.sensor[0] - 1, part.sensor[0] - 1, 0]
    axes[0].plot(*corners, color="0.6", linewidth=1)
    axes[0].set_aspect("equal")
    axes[0].invert_yaxis()
    _named(axes[0], "mask (dots) on the sensor (frame)", "sensor column", "sensor row")
    moved = [own - other for own, other in zip(there, plain, strict=True)]
    moved = [one - one.mean() for one in moved]
    axes[1].quiver(grid[1], grid[0], moved[1], moved[0], angles="xy", color=_RED)
    axes[1].set_aspect("equal")
    axes[1].invert_yaxis()
    longest = float(np.hypot(*moved).max())
    title = f"turn and skew, up to {longest:.2f} px; fit leaves {part.residual:.1%} of the contrast"
    _named(axes[1], title, "mask column", "mask row")


def _dispersion(axes: Any, part: MeasuredDispersion) -> None:
    nm, fine = part.wavelengths * 1e9, np.linspace(part.wavelengths[0], part.wavelengths[-1], 200)
    axes[0].plot(nm, part.shifts[:, 1], "o", color=_BLUE, label="along x")
    axes[0].plot(nm, part.shifts[:, 0], "s", color="0.5", markersize=4, label="along y")
    axes[0].plot(fine * 1e9, part.at(fine), color=_RED, linewidth=1)
    axes[0].legend(fontsize=_SMALL)
    known = np.isfinite(part.residual[1])
    title = f"{part.curve} curve {f'leaves {part.residual[1]:.3f} px rms' if known else 'through all of them'}"
    _named(axes[0], title, "wavelength (nm)", "displacement (sensor pixels)")
    axes[1].plot(nm, part.response, "o-", color=_BLUE)
    axes[1].set_ylim(0)
    _named(axes[1], "response κ (mean 1)", "wavelength (nm)", "light over the source's power")


def _shear(axes: Any, part: MeasuredShear) -> None:
    for axis, (name, colour, mark) in enumerate((("y", _RED, "s"), ("x", _BLUE, "o"))):
        place = part.places[:, axis]
        centred = part.shifts[:, axis] - part.shifts[:, axis].mean() + part.step[axis] * place.mean() * -1
        axes[0].plot(place, centred, mark, color=colour, label=f"along {name}", markersize=4)
        ends = np.array([place.min(), place.max()])
        axes[0].plot(ends, -part.step[axis] * ends, color=colour, linewidth=1)
    axes[0].legend(fontsize=_SMALL)
    title = f"{part.step[0]:.4f}, {part.step[1]:.4f} px per view; rms {part.residual:.3f} px"
    _named(axes[0], title, "view", "shift of the shadow (sensor pixels)")
    shown = axes[1].scatter(part.places[:, 1], part.places[:, 0], c=part.light, s=220, marker="s", cmap="viridis")
    axes[1].invert_yaxis()
    axes[1].margins(0.2)
    axes[1].figure.colorbar(shown, ax=axes[1])
    _named(axes[1], "light of the views", "view along x", "view along y")


def _timing(axes: Any, part: Timing) -> None:
    for slot in range(part.slots):
        axes[0].barh(0.45, 1, left=slot, height=0.35, color=_BLUE, edgecolor="white")
        axes[0].barh(0, part.ratio, left=part.delay + part.ratio * slot, height=0.35, color=_RED, edgecolor="white")
    axes[0].set_yticks([0, 0.45], ["shutter", "aperture"])
    title = f"delay {part.delay:+.4f} slots, ratio {part.ratio:.4f}, leakage {part.leakage:.2%}"
    _named(axes[0], title, "slots of the aperture", "")
    shown = axes[1].imshow(part.overlap(), cmap="viridis", vmin=0)
    axes[1].set(xticks=range(part.slots), yticks=range(part.slots))
    axes[1].figure.colorbar(shown, ax=axes[1])
    _named(axes[1], "time in which both are on (slots)", "slot of the shutter", "slot of the aperture")


def _psf(axes: Any, part: PsfStack) -> None:
    _montage(axes[0], part)
    axes[1].set_axis_off()


def _montage(axis: Axes, part: PsfStack) -> None:
    """Depths downwards, wavelengths to the right, each scaled to its own peak."""
    scaled = part.values / part.values.max(axis=(2, 3), keepdims=True)
    rows = [np.concatenate(list(row), axis=1) for row in scaled]
    axis.imshow(np.sqrt(np.maximum(np.concatenate(rows), 0)), cmap="magma")
    height, width = part.values.shape[2:]
    waves = [f"{w * 1e9:.0f}" for w in part.wavelengths]
    axis.set_xticks(width * (np.arange(len(waves)) + 0.5), waves)
    axis.set_yticks(height * (np.arange(len(part.depths)) + 0.5), [f"{z:g}" for z in part.depths])
    _named(axis, "point spread functions (square root)", "wavelength (nm)", "depth (m)")


def _wavefront(axis: Axes, part: ZernikeFit) -> None:
    names = [f"{n},{m}" for n, m in part.modes]
    axis.bar(names, part.coefficients * 1e9, yerr=part.std * 1e9, color=_BLUE, ecolor=_RED)
    axis.tick_params(axis="x", rotation=60)
    _named(axis, f"heights beside those asked for; fit leaves {part.residual:.1%}", "Zernike mode n,m", "nm rms")


def _map(axis: Axes, values: np.ndarray, title: str, bar: str, bad: np.ndarray) -> None:
    low, high = np.percentile(values[~bad], [0.5, 99.5])
    shown = axis.imshow(values, cmap="gray", vmin=low, vmax=high, interpolation="nearest")
    places = np.argwhere(bad)
    axis.plot(places[:, 1], places[:, 0], "o", markerfacecolor="none", color=_RED, markersize=8)
    axis.figure.colorbar(shown, ax=axis).set_label(bar, fontsize=_SMALL)
    _named(axis, f"{title}; {len(places)} defects", "", "")


def _named(axis: Axes, title: str, x: str, y: str) -> None:
    axis.set_title(title, fontsize=9)
    axis.set_xlabel(x, fontsize=_SMALL)
    axis.set_ylabel(y, fontsize=_SMALL)
    axis.tick_params(labelsize=_SMALL)
