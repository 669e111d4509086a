"""Pictures of the measured parts of a calibration."""

from __future__ import annotations

from typing import Any

import numpy as np

from tmca.lab.calibration.dispersion import MeasuredDispersion
from tmca.lab.calibration.displacement import MeasuredShear
from tmca.lab.calibration.pattern_image import mapped
from tmca.lab.calibration.psf import PsfStack, ZernikeFit
from tmca.lab.calibration.registration import Registration, nominal_matrix
from tmca.lab.calibration.sensor import DarkField, FlatField, Linearity
from tmca.lab.calibration.timing import Timing
from tmca.plots import calibration


def dark(axes: Any, part: DarkField) -> None:
    calibration.draw_dark(axes, part.mean, part.read_noise, part.defects > 0)


def flat(axes: Any, part: FlatField) -> None:
    calibration.draw_flat(axes, part.gain, part.defects > 0, part.nonuniformity)


def linearity(axes: Any, part: Linearity) -> None:
    titles = (
        f"off a line by {part.largest_deviation:.2g} of it at most",
        f"{part.gain:.3g} ± {part.gain_std:.1g} electrons per digital number",
    )
    line, transfer = part.offset + part.slope * part.exposures, (part.read_noise / part.gain) ** 2
    predicted, used = transfer + part.levels / part.gain, np.isfinite(part.deviations)
    calibration.draw_linearity(axes, part.exposures, part.levels, line, part.variances, predicted, used, titles)


def registration(axes: Any, part: Registration) -> None:
    rows, columns = (np.linspace(0, n - 1, 9) for n in part.codes)
    mask = np.stack([one.ravel() for one in np.meshgrid(rows, columns, indexing="ij")])
    nominal = mapped(nominal_matrix(part.codes, part.sensor, part.scale), *mask)
    sensor = np.stack(mapped(part.matrix, *mask))
    calibration.draw_registration(axes, mask, sensor, np.stack(nominal), part.sensor, part.residual)


def dispersion(axes: Any, part: MeasuredDispersion) -> None:
    fine = np.linspace(part.wavelengths[0], part.wavelengths[-1], 200)
    fitted = np.isfinite(part.residual[1])
    title = f"{part.curve} curve {f'leaves {part.residual[1]:.3f} px rms' if fitted else 'through all of them'}"
    calibration.draw_dispersion(axes, part.wavelengths, part.shifts, (fine, part.at(fine)), part.response, title)


def shear(axes: Any, part: MeasuredShear) -> None:
    calibration.draw_shear(axes, part.places, part.shifts, part.step, part.light, part.residual)


def timing(axes: Any, part: Timing) -> None:
    title = f"delay {part.delay:+.4f} slots, ratio {part.ratio:.4f}, leakage {part.leakage:.2%}"
    calibration.draw_timing(axes, part.overlap(), part.delay, part.ratio, title)


def wavefront(axes: Any, part: ZernikeFit, stack: PsfStack) -> None:
    calibration.draw_psf(axes[0], stack.values, stack.wavelengths, stack.depths)
    calibration.draw_wavefront(axes[1], part.modes, part.coefficients, part.std, part.residual)
