"""The demonstration: rendered scenes through every camera and back, with a report."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from tmca.applications.base import APPLICATIONS, Columns, application_of
from tmca.applications.imaging import evaluate, metric_notes, simulate
from tmca.applications.pictures import save_picture
from tmca.applications.report import Section, write_report
from tmca.cameras import Camera, Snapshot, load_cameras
from tmca.data import atomic_path, make_folder
from tmca.decoders import Estimate, decode
from tmca.errors import OutputError, TmcaError

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    Scene = xr.DataArray | xr.Dataset

Progress = Callable[[float, str], None]
_ENDS = (("throughput", "light", ".1%"), ("seconds", "s", ".1f"))


@dataclass(frozen=True)
class Trial:
    """A camera of the demonstration and how its snapshots are decoded.

    Args:
        code: what tables call its codes.
        stem: of the names of its files.
        camera: that takes the snapshot.
        decoder: the camera's usual one if None.
        settings: of the decoder.
    """

    code: str
    stem: str
    camera: Camera
    decoder: str | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Taken:
    """A trial, its snapshot of a scene, the estimate, and how good it is."""

    trial: Trial
    snapshot: Snapshot[Any]
    estimate: Estimate
    metrics: Mapping[str, float]

    def figure(self, scene: Scene) -> Figure:
        """The estimate beside the scene."""
        return application_of(self.trial.camera).figure(self.estimate.to_xarray(), self.trial.camera, scene)


class Demo(ABC):
    """What the demonstration shows of a camera: an application's ``demo``.

    ``key`` names its rows in the results, ``title`` is the heading of its section, ``scenes`` are the names of its
    scenes, ``columns`` those of its table (None: the application's), and ``share`` is the size of its scenes relative
    to what is asked for.
    """

    key: ClassVar[str]
    title: ClassVar[str]
    scenes: ClassVar[tuple[str, ...]]
    columns: ClassVar[Columns | None] = None
    share: ClassVar[Fraction] = Fraction(1)

    @abstractmethod
    def scene(self, name: str, size: tuple[int, int]) -> Any:
        """A scene of (H, W) pixels."""

    @abstractmethod
    def trials(self, scene: Any) -> Sequence[Trial]:
        """The cameras that take it, by name."""

    def text(self, rows: Sequence[Mapping[str, Any]]) -> Sequence[str]:
        """Paragraphs about the rows of its table."""
        return ()

    def figures(self, name: str, scene: Any, taken: Mapping[str, Taken]) -> dict[str, tuple[str, Any]]:
        """File → caption and picture of a scene; for ``.gif`` the views to walk over."""
        return {f"{one.trial.stem}.png": (code, one.figure(scene)) for code, one in taken.items()}


def demo_columns(kind: str) -> Columns:
    """Columns of the table of a kind of camera."""
    application = APPLICATIONS[kind]
    assert application.demo is not None
    scene = (("scene", "scene", ""),) if len(application.demo.scenes) > 1 else ()
    return (("code", "code", ""), *scene, *(application.demo.columns or application.columns), *_ENDS)


def run_demo(
    out: Path, *, size: tuple[int, int] = (192, 256), overwrite: bool = False, progress: Progress | None = None
) -> dict[str, Any]:
    """Take and reconstruct snapshots of rendered scenes that no prior was learned from.

    Args:
        out: folder for snapshots, reconstructions, pictures and ``report.html``.
        size: (H, W) of the scenes, pixels; views of the light field and the scene with depth are two thirds of it.
        overwrite: replace earlier results in ``out``.
        progress: called with the share that is done and what is next.

    Returns:
        Rows of the tables: ``rows`` of the spectral camera, ``light_field``, ``spectral_depth``, …; ``report`` file and
        ``seconds`` in all.

    Raises:
        OutputError: ``out`` holds results and ``overwrite`` is False.
    """
    if (out / "report.html").exists() and not overwrite:
        raise OutputError(
            out / "report.html", "the report of an earlier demo", "none", "pass --overwrite or another --out"
        )
    start, tell = time.perf_counter(), progress or (lambda share, step: None)
    make_folder(out.parent)
    if out.exists():
        rows = _Run(out, size, overwrite, tell).all()
    else:
        with atomic_path(out) as folder:  # whole or not at all: an interrupted demo leaves nothing behind
            try:
                rows = _Run(make_folder(folder), size, overwrite, tell).all()
            except TmcaError as error:  # the folder that the user knows
                place = error.where.replace(str(folder), str(out))
                raise type(error)(place, error.found, error.expected, error.remedy) from error
    return {**rows, "report": str(out / "report.html"), "seconds": time.perf_counter() - start}


@dataclass(frozen=True)
class _Run:
    """One run of the demonstration into a folder that exists."""

    out: Path
    size: tuple[int, int]
    overwrite: bool
    tell: Progress

    def all(self) -> dict[str, list[dict[str, Any]]]:
        """Every camera's files, and the report; returns the rows of the tables."""
        load_cameras()
        kinds, sections, rows = [kind for kind, one in APPLICATIONS.items() if one.demo], [], {}
        for place, kind in enumerate(kinds):
            camera_rows, pages = self._camera(kind, place / len(kinds), 1 / len(kinds))
            sections += pages
            rows[APPLICATIONS[kind].demo.key] = camera_rows  # type: ignore[union-attr]
        write_report(self.out / "report.html", "tmca demo: snapshot cameras", sections, overwrite=self.overwrite)
        self.tell(1.0, "done")
        return rows

    def _camera(self, kind: str, begin: float, share: float) -> tuple[list[dict[str, Any]], list[Section]]:
        """The rows of a camera, and its sections: one, or a summary and one for each of its scenes."""
        demo = APPLICATIONS[kind].demo
        assert demo is not None
        several, rows, pages = len(demo.scenes) > 1, [], []
        for place, name in enumerate(demo.scenes):
            self.tell(begin + share * place / len(demo.scenes), f"{kind}: {name}")
            scene = demo.scene(name, self._size(demo))
            taken = {one.trial.code: one for one in self._taken(scene, demo, begin + share * place / len(demo.scenes))}
            rows += [
                {"code": c, **({"scene": name} if several else {}), **_figures(one, scene)} for c, one in taken.items()
            ]
            pages.append(Section(f"Scene: {name}", figures=self._drawn(demo.figures(name, scene, taken))))
        table = [*_means(rows), *rows] if several else rows
        summary = Section(demo.title, demo.text(table), table, demo_columns(kind))
        if several:
            return rows, [summary, *pages]
        summary.figures = pages[0].figures
        return rows, [summary]

    def _size(self, demo: Demo) -> tuple[int, int]:
        height, width = (max(32, int(side * demo.share)) for side in self.size)
        return self.size if demo.share == 1 else (height, width)

    def _taken(self, scene: Any, demo: Demo, share: float) -> Iterator[Taken]:
        """The scene through every camera and back, with their files."""
        for trial in demo.trials(scene):
            step = f"{trial.stem}: {trial.code}"
            self.tell(share, step)
            snapshot = simulate(scene, trial.camera)
            snapshot.save(self.out / f"{trial.stem}_snapshot.nc", overwrite=self.overwrite)

            def learning(done: float, what: str | None = None) -> None:
                self.tell(share, what or step)  # noqa: B023

            estimate = decode(snapshot, trial.decoder, progress=learning, **trial.settings)
            metrics = evaluate(estimate, scene)
            estimate.notes |= metric_notes(metrics)
            estimate.save(self.out / f"{trial.stem}_{estimate.decoder}.nc", overwrite=self.overwrite)
            yield Taken(trial, snapshot, estimate, metrics)

    def _drawn(self, figures: Mapping[str, tuple[str, Any]]) -> dict[str, Any]:
        """Pictures by their captions, also as files."""
        drawn = {}
        for name, (caption, picture) in figures.items():
            drawn[caption] = save_picture(picture, self.out / name, overwrite=self.overwrite)
        return drawn


def _figures(one: Taken, scene: Any) -> dict[str, Any]:
    """Metrics, throughput and time of a trial."""
    shape = application_of(one.trial.camera).geometry(one.estimate.to_xarray(), scene)
    light = one.snapshot.camera.throughput()
    return {**one.metrics, **shape, "throughput": light, "seconds": one.estimate.seconds}


def _means(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows that are means over scenes, one for each code."""
    means: list[dict[str, Any]] = []
    for code in dict.fromkeys(row["code"] for row in rows):
        of_code = [row for row in rows if row["code"] == code]
        numbers = [name for name, value in of_code[0].items() if isinstance(value, float)]
        mean = {name: sum(row[name] for row in of_code) / len(of_code) for name in numbers}
        means.append({"code": code, "scene": "mean", **mean})
    return means
