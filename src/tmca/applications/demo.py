"""The demonstration: rendered scenes through every camera and back, with a report."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from tmca.applications.base import APPLICATIONS, Columns, application_of
from tmca.applications.evaluating import evaluate, metric_notes
from tmca.applications.imaging import simulate
from tmca.applications.pictures import save_picture
from tmca.applications.report import Section, write_report
from tmca.cameras import Camera, Snapshot, load_cameras
from tmca.data import atomic_path, make_folder, write_dataset
from tmca.decoders import Estimate, Weights, decode
from tmca.errors import OutputError, TmcaError
from tmca.sensor import Sensor
from tmca.workers import in_processes

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    Scene = xr.DataArray | xr.Dataset

Progress = Callable[[float, str], None]
_Outcome = tuple[list[dict[str, Any]], dict[str, Path]]
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


def shipped_trial(code: str, stem: str, kind: str, size: tuple[int, int], sensor: Sensor, slots: int = 8) -> Trial:
    """A camera that comes with tmca, of (H, W) pixels, decoded by its network."""
    weights = Weights.find("default", slots, kind)
    return Trial(code, stem, weights.camera_for(size, sensor=sensor), "network", {"weights": weights})


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
    writes_scene: ClassVar[bool] = False  # where no command makes a rendered scene this small

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
    out: Path,
    *,
    size: tuple[int, int] = (192, 256),
    overwrite: bool = False,
    progress: Progress | None = None,
    jobs: int = 1,
) -> dict[str, Any]:
    """Take and reconstruct snapshots of rendered scenes that no prior was learned from.

    Args:
        out: folder for snapshots, reconstructions, pictures and ``report.html``.
        size: (H, W) of the scenes, pixels; views of the light field and the scene with depth are two thirds of it.
        overwrite: replace earlier results in ``out``.
        progress: called with the share that is done and what is next.
        jobs: scenes that are computed side by side.

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
        rows = _all(out, size, overwrite, tell, jobs)
    else:
        with atomic_path(out) as folder:  # whole or not at all: an interrupted demo leaves nothing behind
            try:
                rows = _all(make_folder(folder), size, overwrite, tell, jobs)
            except TmcaError as error:  # the folder that the user knows
                place = error.where.replace(str(folder), str(out))
                raise type(error)(place, error.found, error.expected, error.remedy) from error
    return {**rows, "report": str(out / "report.html"), "seconds": time.perf_counter() - start}


def _all(
    out: Path, size: tuple[int, int], overwrite: bool, tell: Progress, jobs: int
) -> dict[str, list[dict[str, Any]]]:
    """Files of every scene, and the report; returns the rows of the tables."""
    load_cameras()
    demos = {kind: one.demo for kind, one in APPLICATIONS.items() if one.demo is not None}
    parts = [_Part(kind, name, out, size, overwrite) for kind, demo in demos.items() for name in demo.scenes]
    parts.sort(key=lambda part: len(demos[part.kind].scenes))  # the scene that is alone takes longest
    done = dict(zip(parts, _computed(parts, tell, jobs), strict=True))
    sections, rows = [], {}
    for kind, demo in demos.items():
        scenes = {part.name: outcome for part, outcome in done.items() if part.kind == kind}
        rows[demo.key] = [row for one, _ in scenes.values() for row in one]
        sections += _sections(kind, demo, rows[demo.key], {name: drawn for name, (_, drawn) in scenes.items()})
    write_report(out / "report.html", "tmca demo: snapshot cameras", sections, overwrite=overwrite)
    tell(1.0, "done")
    return rows


def _computed(parts: Sequence[_Part], tell: Progress, jobs: int) -> list[_Outcome]:
    """Rows and pictures of every part, in their order."""
    if jobs <= 1:
        return [part.run(partial(tell, place / len(parts))) for place, part in enumerate(parts)]
    outcomes: dict[int, _Outcome] = {}
    tell(0.0, f"{len(parts)} scenes, {min(jobs, len(parts))} at a time")
    for place, outcome in in_processes(_Part.run, [(part,) for part in parts], jobs):
        outcomes[place] = outcome
        tell(len(outcomes) / len(parts), f"{parts[place].kind}: {parts[place].name} is done")
    return [outcomes[place] for place in range(len(parts))]


def _sections(
    kind: str, demo: Demo, rows: Sequence[dict[str, Any]], drawn: Mapping[str, dict[str, Path]]
) -> list[Section]:
    """A table and pictures: one section, or a summary and one for each of several scenes."""
    several = len(demo.scenes) > 1
    table = [*_means(rows), *rows] if several else rows
    summary = Section(demo.title, demo.text(table), table, demo_columns(kind))
    if several:
        return [summary, *(Section(f"Scene: {name}", figures={**pictures}) for name, pictures in drawn.items())]
    summary.figures = {**drawn[demo.scenes[0]]}
    return [summary]


@dataclass(frozen=True)
class _Part:
    """A scene before every camera of a kind and back, into a folder that exists."""

    kind: str
    name: str
    out: Path
    size: tuple[int, int]
    overwrite: bool

    def run(self, tell: Callable[[str], None] | None = None) -> _Outcome:
        """Rows of its table, and the files of its pictures by their captions."""
        load_cameras()
        demo, tell = APPLICATIONS[self.kind].demo, tell or (lambda step: None)
        assert demo is not None
        tell(f"{self.kind}: {self.name}")
        height, width = (max(32, int(side * demo.share)) for side in self.size)
        scene = demo.scene(self.name, self.size if demo.share == 1 else (height, width))
        notes = self._written(scene) if demo.writes_scene else {}
        taken = {one.trial.code: one for one in self._taken(scene, demo, notes, tell)}
        named = {"scene": self.name} if len(demo.scenes) > 1 else {}
        rows = [{"code": code, **named, **_figures(one, scene)} for code, one in taken.items()]
        figures = demo.figures(self.name, scene, taken)
        return rows, {
            caption: save_picture(picture, self.out / file, overwrite=self.overwrite)
            for file, (caption, picture) in figures.items()
        }

    def _written(self, scene: Any) -> dict[str, str]:
        """Writes the scene beside its snapshots, whose truth it is; their note of that."""
        name = f"{self.name}_scene"
        write_dataset(scene.to_dataset(name="radiance"), self.out / f"{name}.nc", overwrite=self.overwrite)
        return {"scene": name}

    def _taken(self, scene: Any, demo: Demo, notes: Mapping[str, str], tell: Callable[[str], None]) -> Iterator[Taken]:
        """The scene through every camera and back, with their files."""
        for trial in demo.trials(scene):
            step = f"{trial.stem}: {trial.code}"
            tell(step)
            snapshot = simulate(scene, trial.camera)
            snapshot.notes |= notes
            snapshot.save(self.out / f"{trial.stem}_snapshot.nc", overwrite=self.overwrite)
            estimate = decode(snapshot, trial.decoder, progress=_reporter(tell, step), **trial.settings)
            metrics = evaluate(estimate, scene)
            estimate.notes |= metric_notes(metrics)
            estimate.save(self.out / f"{trial.stem}_{estimate.decoder}.nc", overwrite=self.overwrite)
            yield Taken(trial, snapshot, estimate, metrics)


def _reporter(tell: Callable[[str], None], step: str) -> Callable[..., None]:
    """What a decoder calls with its progress, of which only what is done next is told."""

    def report(share: float | None, what: str | None = None) -> None:
        tell(what or step)

    return report


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
