"""``tmca evaluate``: estimates beside the truth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App

from tmca.cli.cameras import READING
from tmca.cli.options.output import Json, Markdown, Overwrite, assumed, check_figure, meaning, say
from tmca.errors import SettingError
from tmca.specs import CAMERA_SPECS, TruthReading

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tmca.applications.evaluating import Evaluation

app = App(name="evaluate", help="Compare an estimate with the truth, by every metric.")
_SCENE = TruthReading()


@app.default
def evaluate(
    estimate: Path,
    truth: str,
    /,
    *more: str,
    reading: Annotated[TruthReading, READING] = _SCENE,
    frames: int | None = None,
    figure: Path | None = None,
    overwrite: Overwrite = False,
    json: Json = False,
    markdown: Markdown = False,
) -> None:
    """PSNR, SSIM, UIQI, SAM, ERGAS and DD of ESTIMATE against TRUTH; bands are matched by wavelength.

    Several estimates stand before the truth, and make one table: `tmca evaluate a.nc b.nc coffee`.
    Of a light field PSNR, SSIM and, where the true disparity is known, the error of the disparity that the views show.
    Of spectrum and depth also MAE, RMSE and share within a bin of the depth where it is known.

    Args:
        estimate: a cube, light-field or spectral-depth file, such as one written by `tmca reconstruct`.
        truth: a file, a folder of views, or the name of a rendered scene; a larger truth is cropped to its middle, a
            light field or scene with depth read as it was for the snapshot.
        more: where there are several estimates, all of them stand first and the truth stands last.
        frames: of equal length within the exposure, with each of which a still estimate of a scene that moved is
            compared; the middle of the exposure without it.
        figure: write a picture of all with error maps and spectra (PNG).
    """
    from tmca.applications.evaluating import application_for, evaluation_of
    from tmca.metrics import beside_constant
    from tmca.plots.style import save_figure

    named = [str(estimate), truth, *more]
    files, source = named[:-1], named[-1]
    _check_files(files, figure, overwrite)
    compared: dict[str, Evaluation] = {}
    metrics: dict[str, dict[str, float]] = {}
    for file in files:
        application = application_for(file)
        one = evaluation_of(file, source, application, frames=frames, **reading.of(application.kind))
        assumed(one.truth)
        compared[file], metrics[file] = one, one.metrics | one.application.geometry(one.estimate, one.truth)
    if figure is not None:
        drawn = one.figure(estimate.stem) if len(files) == 1 else _together(compared)
        save_figure(drawn, figure, overwrite=overwrite, dpi=110 if len(files) == 1 else 200)
    if len(files) == 1:
        _say_one(one, metrics[file], json)
        return
    said = [f"{file}: {line}" for file, own in metrics.items() for line in beside_constant(own)]
    say([{"estimate": file, **own} for file, own in metrics.items()], json, _table(metrics), *said, markdown=markdown)


def _check_files(files: Sequence[str], figure: Path | None, overwrite: bool) -> None:
    """Refuse an estimate that is named twice, and a picture in the place of one."""
    for file in files:
        if files.count(file) > 1:
            raise SettingError("estimate", f"{file} twice", "each once", "leave one out")
        check_figure(figure, overwrite, file)
        if figure is not None and Path(file).resolve() == figure.resolve():
            raise SettingError("figure", str(figure), "another file than the estimate")


def _say_one(one: Evaluation, metrics: dict[str, float], as_json: bool) -> None:
    """Say the metrics of a single estimate."""
    from tmca.metrics import beside_constant

    wide = max(map(len, metrics))
    lines = (f"{name:{wide}s} {value:.4f} {meaning(name)}".rstrip() for name, value in metrics.items())
    say(metrics, as_json, *lines, *one.application.remarks(one.estimate), *beside_constant(metrics))


def _table(metrics: dict[str, dict[str, float]]) -> str:
    """A row for every estimate, and below it what the columns are."""
    from tmca.evaluation.tables import Column, markdown_table

    names = list(dict.fromkeys(name for own in metrics.values() for name in own))
    columns: list[Column] = [("estimate", "estimate", ""), *((name, name, ".4f") for name in names)]
    rows = [{"estimate": file, **own} for file, own in metrics.items()]
    return "\n".join([markdown_table(rows, columns), *(f"{name}: {meaning(name)[1:-1]}" for name in names)])


def _together(compared: dict[str, Evaluation]) -> Figure:
    """All estimates beside the truth of the first.

    Raises:
        SettingError: estimates that differ in shape or coordinates, or in their truth.
    """
    from tmca.plots.side_by_side import side_by_side, what_differs

    differing = what_differs([one.estimate for one in compared.values()], [one.truth for one in compared.values()])
    if differing:
        shapes = ", ".join(f"{Path(file).name} {_shape(one)}" for file, one in compared.items())
        text = f"estimates of several shapes: {shapes}" if differing == "shape" else f"they differ in {differing}"
        raise SettingError("figure", text, "estimates of one scene and kind", "leave the figure out")
    names = _short([*compared])
    estimates = {(names[file], ""): one.estimate for file, one in compared.items()}
    return side_by_side(estimates, next(iter(compared.values())).truth)


def _shape(one: Evaluation) -> tuple[int, ...]:
    values = one.estimate["radiance" if "radiance" in one.estimate else "estimate"]
    return tuple(int(side) for side in values.shape)


def _short(files: Sequence[str]) -> dict[str, str]:
    """Stems, or names where two would be the same."""
    stems = [Path(file).stem for file in files]
    return {file: stem if stems.count(stem) == 1 else file for file, stem in zip(files, stems, strict=True)}


for _camera in CAMERA_SPECS:
    app.command(evaluate, name=_camera, help=f"The same, for the {_camera} camera.")
