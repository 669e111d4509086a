"""The step that measures point spread functions, and the wavefront behind them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tmca.cameras import Snapshot, SpectralDepthCamera
from tmca.data import nm_to_metres
from tmca.errors import DataError, SettingError
from tmca.lab.calibration import captures
from tmca.lab.calibration.arrays import Array
from tmca.lab.calibration.calibration_file import Calibration
from tmca.lab.calibration.captures import averaged, corrected, named, read_captures
from tmca.lab.calibration.measurements.psf import measure_psf
from tmca.lab.calibration.measurements.zernike_fit import MODES, fit_zernike_psf, wavefront_rms
from tmca.lab.calibration.steps.building_on import needed, sensor_size
from tmca.optics import PhaseMaskBench
from tmca.optics.zernike import Mode


def phase_mask_camera(snapshot: str | Path, slot: int) -> SpectralDepthCamera:
    """The camera of a snapshot file, whose mask of a slot is measured.

    Raises:
        DataError: a camera without phase masks.
        SettingError: a slot that it does not have.
    """
    camera = Snapshot.load(snapshot).camera
    if not isinstance(camera, SpectralDepthCamera):
        remedy = "name a snapshot of the camera that the points are of"
        raise DataError(snapshot, f"a {camera.kind} camera", "a spectral-depth one, with phase masks", remedy)
    if not 0 <= slot < camera.slots:
        raise SettingError("--slot", f"{slot}", f"slots 0 to {camera.slots - 1} of a spectral-depth camera")
    return camera


def psf_step(
    calibration: Calibration,
    path: str | Path,
    bench: PhaseMaskBench,
    *,
    slot: int = 0,
    nominal: Array | None = None,
    modes: Sequence[Mode] = MODES,
    saturation: float | None = None,
    source: str | Path | None = None,
) -> Calibration:
    """Captures of a point source (``…0.6m_550nm…``) with the mask of one slot → PSF stack and wavefront.

    Args:
        calibration: with dark.
        path: captures at every pair of depth and wavelength.
        bench: the camera's optics.
        slot: whose mask was shown.
        nominal: (H, W) heights that were asked for, metres.
        modes: to fit.
        saturation: of the captures.
        source: file that bench and heights are from.

    Raises:
        DataError: missing, saturated or dark captures, or no wavefront that explains them.
    """
    needed(calibration, "dark", "psf")
    frames = read_captures(path, saturation=saturation, sensor=sensor_size(calibration))
    values, keys = averaged(frames.values.astype(np.float64), named(frames, captures.POINT, "point_0.6m_550nm"))
    depths, waves = (sorted({key[i] for key in keys}) for i in (0, 1))
    gone = [(z, w) for z in depths for w in waves if (z, w) not in keys]
    if gone:
        found = f"no capture at {gone[0][0]:g} m and {gone[0][1]:g} nm"
        raise DataError(path, found, f"all of {len(depths)} depths and {len(waves)} wavelengths", "capture it")
    cube = corrected(values, calibration).reshape(len(depths), len(waves), *values.shape[1:])
    stack = measure_psf(cube, depths, np.asarray(nm_to_metres(np.array(waves))), bench.window, source=path)
    fit = fit_zernike_psf(stack, bench, modes=modes, nominal=nominal, source=path)
    middle = float(stack.wavelengths[len(waves) // 2])
    residuals = {
        "residual": fit.residual,
        "snr_db": stack.snr_db,
        "rms_waves": wavefront_rms(fit.coefficients, bench, middle),
        "std_waves": wavefront_rms(fit.std, bench, middle),
        "starts": float(fit.starts),
    }
    size, sources = (int(values.shape[1]), int(values.shape[2])), [path, *([] if source is None else [source])]
    with_stack = calibration.with_part(f"psf{slot}", stack, {"snr_db": stack.snr_db}, sources, sensor=size)
    return with_stack.with_part(f"wavefront{slot}", fit, residuals, sources, settings={"wavelength_m": middle})
