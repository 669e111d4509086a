"""Pictures of what the bench measured and shows: depth, reflectance, spectra, calibrations, exports."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
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
from tmca.lab.devices.frames import read_frame
from tmca.lab.devices.mirror import read_table
from tmca.lab.spectral_scan.comparison import Comparison
from tmca.plots import calibration, lab
from tmca.plots.style import blank_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

_SLOTS = 4


def depth_figure(measured: xr.Dataset, title: str) -> Figure:
    """Depth, its standard deviation, and why pixels have none, of `measure_depth`'s result."""
    reasons = [part.split(" ", 1)[1] for part in str(measured["confidence"].attrs["reasons"]).split(", ")]
    depth, deviation, reason = (measured[name].values for name in ("depth", "depth_std", "confidence"))
    return lab.measured_depth_figure(depth, deviation, reason, reasons, title)


def reflectance_figure(measured: xr.Dataset, title: str) -> Figure:
    """Mean reflectance, spectra of three places with two standard deviations, and the share of bands left out."""
    left_out = (measured["quality"].values > 0).mean(axis=0)
    cube, deviation, nm = (measured[name].values for name in ("reflectance", "reflectance_std", "wavelength_nm"))
    return lab.reflectance_figure(cube, deviation, left_out, nm, title)


def comparison_figure(compared: Sequence[Comparison]) -> Figure:
    """A panel per point: measured with its spread over the box, reference, and their angle above."""
    titles = [f"{one.name} at {one.place[0]},{one.place[1]}: SAM {one.angle:.2f}°" for one in compared]
    arrays = [(one.nm, one.spectrum, one.spread, one.reference) for one in compared]
    return lab.compared_spectra_figure(dict(zip(titles, arrays, strict=True)))


def export_figure(manifest: dict[str, Any], folder: Path) -> Figure:
    """The first slots of every plane: frames as devices show them, Zernike terms as bars.

    Args:
        manifest: of the export.
        folder: of the export.
    """
    slots = range(min(_SLOTS, manifest["slots"]))
    return lab.shown_figure(
        {
            f"{plane['plane']}\n{plane['device']['name']}": [_shown(plane, slot, folder) for slot in slots]
            for plane in manifest["planes"]
        }
    )


def _shown(plane: dict[str, Any], slot: int, folder: Path) -> tuple[str, np.ndarray, Sequence[int] | None]:
    """Title of a slot, its frame or Zernike terms, and their Noll indices."""
    frame = plane["frames"][slot]
    title, file = f"slot {slot}, from {frame['start_s'] * 1e3:g} ms", folder / frame["file"]
    if "placement" in plane:
        return title, read_frame(file), None
    terms = read_table(file)
    return title, terms.rms[slot], terms.noll


def part_figure(part: Any, title: str, stack: PsfStack | None = None) -> Figure:
    """The picture of a measured part of a calibration; of a wavefront beside the point spread functions it was fitted
    to."""
    figure = blank_figure(9.2, 3.4)
    figure.suptitle(title, fontsize=10)
    axes = figure.subplots(1, 2)
    if isinstance(part, ZernikeFit):
        calibration.draw_wavefront(axes[1], part.modes, part.coefficients, part.std, part.residual)
        if stack is not None:
            calibration.draw_psf(axes[0], stack.values, stack.wavelengths, stack.depths)
    else:
        _DRAW[type(part)](axes, part)
    return figure


def _dark(axes: Any, part: DarkField) -> None:
    calibration.draw_dark(axes, part.mean, part.read_noise, part.defects > 0)


def _flat(axes: Any, part: FlatField) -> None:
    calibration.draw_flat(axes, part.gain, part.defects > 0, part.nonuniformity)


def _linearity(axes: Any, part: Linearity) -> None:
    titles = (
        f"off a line by {part.largest_deviation:.2g} of it at most",
        f"{part.gain:.3g} ± {part.gain_std:.1g} electrons per digital number",
    )
    line, transfer = part.offset + part.slope * part.exposures, (part.read_noise / part.gain) ** 2
    predicted, used = transfer + part.levels / part.gain, np.isfinite(part.deviations)
    calibration.draw_linearity(axes, part.exposures, part.levels, line, part.variances, predicted, used, titles)


def _registration(axes: Any, part: Registration) -> None:
    rows, columns = (np.linspace(0, n - 1, 9) for n in part.codes)
    mask = np.stack([one.ravel() for one in np.meshgrid(rows, columns, indexing="ij")])
    scale = float(np.sqrt(abs(np.linalg.det(part.matrix[:, :2]))))
    nominal = mapped(nominal_matrix(part.codes, part.sensor, scale), *mask)
    sensor = np.stack(mapped(part.matrix, *mask))
    calibration.draw_registration(axes, mask, sensor, np.stack(nominal), part.sensor, part.residual)


def _dispersion(axes: Any, part: MeasuredDispersion) -> None:
    fine = np.linspace(part.wavelengths[0], part.wavelengths[-1], 200)
    fitted = np.isfinite(part.residual[1])
    title = f"{part.curve} curve {f'leaves {part.residual[1]:.3f} px rms' if fitted else 'through all of them'}"
    calibration.draw_dispersion(axes, part.wavelengths, part.shifts, (fine, part.at(fine)), part.response, title)


def _shear(axes: Any, part: MeasuredShear) -> None:
    calibration.draw_shear(axes, part.places, part.shifts, part.step, part.light, part.residual)


def _timing(axes: Any, part: Timing) -> None:
    title = f"delay {part.delay:+.4f} slots, ratio {part.ratio:.4f}, leakage {part.leakage:.2%}"
    calibration.draw_timing(axes, part.overlap(), part.delay, part.ratio, title)


def _psf(axes: Any, part: PsfStack) -> None:
    calibration.draw_psf(axes[0], part.values, part.wavelengths, part.depths)
    axes[1].set_axis_off()


_DRAW: dict[type, Callable[[Any, Any], None]] = {
    DarkField: _dark, FlatField: _flat, Linearity: _linearity, Registration: _registration,
    MeasuredDispersion: _dispersion, MeasuredShear: _shear, Timing: _timing, PsfStack: _psf,
}  # fmt: skip
