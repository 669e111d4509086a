"""Judging codes that exist: light, levels, likeness of bands or views, conditioning, and the error to be expected."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.cameras import CodedCamera, Snapshot, SpectralCamera
from tmca.codes import read_codes
from tmca.design import CodeMeasures, SensorSheet, measures
from tmca.errors import DataError, SettingError
from tmca.plots.codes import measures_figure
from tmca.plots.style import save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FRAME = 128


def judge_codes(
    file: str | Path,
    *,
    bands: int = 12,
    prior: str | Path | None = None,
    sheet: SensorSheet | None = None,
    camera: dict[str, Any] | None = None,
    figure: Path | None = None,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Figures of the codes of a file, before any snapshot is taken.

    Args:
        file: codes of `tmca design` for a spectral camera, a snapshot, or weights of `tmca train`.
        bands: of the spectral camera whose codes are in a file of `tmca design`.
        prior: under which the expected error of a spectral camera is asked for; a Gaussian one.
        sheet: the sensor for the expected error; that of the snapshot, or an ideal one, without.
        camera: further arguments of ``SpectralCamera`` for a file of `tmca design`.
        figure: write levels, correlations and singular values as a picture (PNG).
        overwrite: replace the picture if it exists.

    Returns:
        JSON values: `CodeMeasures`, and ``expected_psnr`` in dB where a prior is given.

    Raises:
        DataError: no codes of a spectral or light-field camera in the file, or a prior of other bands.
        SettingError: relay blur, or a sensor that does not fit.
    """
    known = coded_camera(file, bands, camera or {})
    found = measures(known)
    told: dict[str, Any] = {
        "file": str(file), "camera": known.kind, "slots": known.slots, "channels": known.channels,
        "throughput": found.throughput, "contrast": found.contrast, "likeness": found.likeness,
        "coherence": found.coherence, "levels": {f"{level:g}": share for level, share in found.levels.items()},
        "correlation": found.band_correlation.tolist(), "singular_values": found.singular_values.tolist(),
    }  # fmt: skip
    if prior is not None:
        told["expected_psnr"] = _expected(known, prior, sheet)
    elif sheet is not None:
        raise SettingError("sensor", "given", "none without --prior, under which its error is expected")
    if figure is not None:
        save_figure(_measures(found, known), figure, overwrite=overwrite)
    return told


def coded_camera(file: str | Path, bands: int, settings: dict[str, Any]) -> CodedCamera:
    """The camera of a file of codes, of a snapshot, or of weights.

    Raises:
        DataError: none of these, or of a camera without binary aperture codes.
    """
    from tmca.data import read_dataset
    from tmca.decoders import Weights

    path = Path(file)
    if path.suffix == ".safetensors" or path.is_dir():
        return Weights.load(path).camera_for((_FRAME, _FRAME))
    if "snapshot" not in read_dataset(path, ()):
        return SpectralCamera(bands=bands, size=(_FRAME, _FRAME), **{**read_codes(path).settings(), **settings})
    taken = Snapshot.load(path).camera
    if isinstance(taken, CodedCamera):
        return taken
    wanted = "codes or a snapshot of a spectral or light-field camera"
    raise DataError(path, f"a {taken.kind} snapshot", wanted, "use `tmca design spectral-depth`")


def _expected(camera: CodedCamera, prior: str | Path, sheet: SensorSheet | None) -> float:
    from tmca.priors import GaussianPrior, expected_psnr

    known = GaussianPrior.load(prior)
    if known.block[0] != camera.channels:
        raise DataError(prior, f"{known.block[0]} bands or views", f"{camera.channels}, those of the codes")
    sensor = camera.sensor if sheet is None else sheet.sensor()
    return expected_psnr(known, camera.taps(), sensor.noise(camera.white, camera.exposures))


def _measures(found: CodeMeasures, camera: CodedCamera) -> Figure:
    titles = (
        f"levels, K = {camera.slots}, {found.throughput:.1%} of the light",
        f"correlation of {camera.channel}s",
        f"singular values of blocks, coherence {found.coherence:.2f}",
    )
    values = np.asarray(found.singular_values)
    return measures_figure(found.levels, found.band_correlation.numpy(), values, camera.slots, titles)
