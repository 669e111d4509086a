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
    for file in files:
        if files.count(file) > 1:
            raise SettingError("estimate", f"{file} twice", "each once", "leave one out")
        check_figure(figure, overwrite, file)
        if figure is not None and Path(file).resolve() == figure.resolve():
            raise SettingError("figure", str(figure), "another file than the estimate")
    found: dict[str, Evaluation] = {}
    metrics: dict[str, dict[str, float]] = {}
    for file in files:
        application = application_for(file)
        one = evaluation_of(file, source, application, frames=frames, **reading.of(application.kind))
        assumed(one.truth)
        found[file], metrics[file] = one, one.metrics | one.application.geometry(one.estimate, one.truth)
    if figure is not None:
        drawn = found[files[0]].figure(estimate.stem) if len(files) == 1 else _together(found)
        save_figure(drawn, figure, overwrite=overwrite, dpi=110 if len(files) == 1 else 200)
    if len(files) == 1:
        own = metrics[files[0]]
        wide, one = max(map(len, own)), found[files[0]]
        lines = (f"{name:{wide}s} {value:.4f} {meaning(name)}".rstrip() for name, value in own.items())
        say(own, json, *lines, *one.application.remarks(one.estimate), *beside_constant(own))
        return
    said = [f"{file}: {line}" for file, own in metrics.items() for line in beside_constant(own)]
    say([{"estimate": file, **own} for file, own in metrics.items()], json, _table(metrics), *said, markdown=markdown)


def _table(metrics: dict[str, dict[str, float]]) -> str:
    """A row for every estimate, and below it what the columns are."""
    from tmca.evaluation.tables import Column, markdown_table

    names = list(dict.fromkeys(name for own in metrics.values() for name in own))
    columns: list[Column] = [("estimate", "estimate", ""), *((name, name, ".4f") for name in names)]
    rows = [{"estimate": file, **own} for file, own in metrics.items()]
    return "\n".join([markdown_table(rows, columns), *(f"{name}: {meaning(name)[1:-1]}" for name in names)])


def _together(found: dict[str, Evaluation]) -> Figure:
    """All estimates beside the truth of the first.

    Raises:
        SettingError: estimates that differ in shape or coordinates, or in their truth.
    """
    from tmca.plots.side_by_side import side_by_side, what_differs

    differing = what_differs([one.estimate for one in found.values()], [one.truth for one in found.values()])
    if differing:
        shapes = ", ".join(f"{Path(file).name} {_shape(one)}" for file, one in found.items())
        text = f"estimates of several shapes: {shapes}" if differing == "shape" else f"they differ in {differing}"
        raise SettingError("figure", text, "estimates of one scene and kind", "leave the figure out")
    names = _short([*found])
    return side_by_side(
        {(names[file], ""): one.estimate for file, one in found.items()}, next(iter(found.values())).truth
    )


def _shape(one: Evaluation) -> tuple[int, ...]:
    values = one.estimate["radiance" if "radiance" in one.estimate else "estimate"]
    return tuple(int(side) for side in values.shape)


def _short(files: Sequence[str]) -> dict[str, str]:
    """Stems, or names where two would be the same."""
    stems = [Path(file).stem for file in files]
    return {file: stem if stems.count(stem) == 1 else file for file, stem in zip(files, stems, strict=True)}


for _camera in CAMERA_SPECS:
    app.command(evaluate, name=_camera, help=f"The same, for the {_camera} camera.")
