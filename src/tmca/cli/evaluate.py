"""``tmca evaluate``: an estimate beside the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import App

from tmca.cli.cameras import READING
from tmca.cli.options.output import Json, Overwrite, assumed, check_figure, meaning, say
from tmca.errors import SettingError
from tmca.specs import CAMERA_SPECS, TruthReading

app = App(name="evaluate", help="Compare an estimate with the truth, by every metric.")
_SCENE = TruthReading()


@app.default
def evaluate(
    estimate: Path,
    truth: str,
    /,
    *,
    reading: Annotated[TruthReading, READING] = _SCENE,
    frames: int | None = None,
    figure: Path | None = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """PSNR, SSIM, UIQI, SAM, ERGAS and DD of ESTIMATE against TRUTH; bands are matched by wavelength.

    Of a light field PSNR, SSIM and, where the true disparity is known, the error of the disparity that the views show.
    Of spectrum and depth also MAE, RMSE and share within a bin of the depth where it is known.

    Args:
        estimate: a cube, light-field or spectral-depth file, such as one written by `tmca reconstruct`.
        truth: a file, a folder of views, or the name of a rendered scene; a larger truth is cropped to its middle, a
            light field or scene with depth read as it was for the snapshot.
        frames: of equal length within the exposure, with each of which a still estimate of a scene that moved is
            compared; the middle of the exposure without it.
        figure: write a picture of both with error map and spectra (PNG).
    """
    from tmca.applications.imaging import application_for, evaluation_of
    from tmca.plots.style import save_figure

    check_figure(figure, overwrite, estimate)
    if figure is not None and estimate.resolve() == figure.resolve():
        raise SettingError("figure", str(figure), "another file than the estimate")
    application = application_for(estimate)
    evaluation = evaluation_of(estimate, truth, application, frames=frames, **reading.of(application.kind))
    assumed(evaluation.truth)
    metrics = evaluation.metrics | evaluation.application.geometry(evaluation.estimate, evaluation.truth)
    if figure is not None:
        save_figure(evaluation.figure(estimate.stem), figure, overwrite=overwrite)
    say(metrics, json, *(f"{name:6s} {value:.4f} {meaning(name)}".rstrip() for name, value in metrics.items()))


for _camera in CAMERA_SPECS:
    app.command(evaluate, name=_camera, help=f"The same, for the {_camera} camera.")
