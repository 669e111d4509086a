"""Judging codes that exist: light, levels, likeness of bands or views, conditioning, and the error to be expected."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tmca.cameras import CodedCamera, Snapshot, SpectralCamera
from tmca.codes import read_codes
from tmca.data import read_dataset
from tmca.decoders import Weights
from tmca.design import CodeMeasures, SensorSheet, measures
from tmca.errors import DataError, SettingError
from tmca.plots.codes import measures_figure
from tmca.plots.style import save_figure
from tmca.priors import GaussianPrior, expected_psnr

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
    coded = coded_camera(file, bands, camera or {})
    figures = measures(coded)
    report: dict[str, Any] = {
        "file": str(file), "camera": coded.kind, "slots": coded.slots, "channels": coded.channels,
        "buckets": coded.buckets,
        "throughput": figures.throughput, "contrast": figures.contrast, "likeness": figures.likeness,
        "coherence": figures.coherence, "levels": {f"{level:g}": share for level, share in figures.levels.items()},
        "correlation": figures.band_correlation.tolist(), "singular_values": figures.singular_values.tolist(),
    }  # fmt: skip
    if prior is not None:
        report["expected_psnr"] = _expected(coded, prior, sheet)
    elif sheet is not None:
        raise SettingError("sensor", "given", "none without --prior, under which its error is expected")
    if figure is not None:
        save_figure(_measures(figures, coded), figure, overwrite=overwrite)
    return report


def coded_camera(file: str | Path, bands: int, settings: dict[str, Any]) -> CodedCamera:
    """The camera of a file of codes, of a snapshot, or of weights.

    Raises:
        DataError: none of these, or of a camera without binary aperture codes.
    """
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
    known = GaussianPrior.load(prior)
    if known.block[0] != camera.channels:
        raise DataError(prior, f"{known.block[0]} bands or views", f"{camera.channels}, those of the codes")
    sensor = camera.sensor if sheet is None else sheet.sensor()
    return expected_psnr(known, camera.taps(), sensor.noise(camera.white, camera.exposures))


def _measures(figures: CodeMeasures, camera: CodedCamera) -> Figure:
    titles = (
        f"levels, K = {camera.slots}, {figures.throughput:.1%} of the light",
        f"correlation of {camera.channel}s",
        f"singular values of blocks, coherence {figures.coherence:.2f}",
    )
    values = np.asarray(figures.singular_values)
    return measures_figure(figures.levels, figures.band_correlation.numpy(), values, camera.slots, titles)
