"""``tmca train``: codes and decoders that learn together, and with ``--from`` on calibrated captures."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from tmca.cli.cameras import READING
from tmca.cli.options.numbers import MaybeWhole
from tmca.cli.options.output import Json, say
from tmca.errors import SettingError
from tmca.progress import progress_bar
from tmca.specs import CAMERA_SPECS, ViewsReading

app = App(
    name="train",
    help="Learn a camera's codes and its decoder together; or, with --from, fine-tune a trained decoder on captures.",
)
_VIEWS = ViewsReading()


@app.default
def fine_tune(
    *,
    from_: Annotated[str | None, Parameter(name="--from")] = None,
    captures: Path | None = None,
    out: Path | None = None,
    calibration: Path | None = None,
    validation: list[str] | None = None,
    steps: MaybeWhole = None,
    rate: float | None = None,
    batch: MaybeWhole = None,
    patch: MaybeWhole = None,
    set_: Annotated[list[str] | None, Parameter(name="--set")] = None,
    accelerator: str = "auto",
    json: Json = False,
) -> None:
    """Fine-tune the decoder of a trained run, of any camera, on captures with their truth. The same command goes on.

    Codes, optics and calibration stay as they are. What is saved is never worse on the captures that are held out than
    the decoder as it was. Writes into --out what a run writes, and before_after.png of a capture that was held out.

    Args:
        from_: the run: its folder, its weights file, or a camera that comes with tmca: default (spectral, K = 8),
            default-light-field, default-spectral-depth.
        captures: folder of snapshot files NAME.nc, each with its true scene NAME_truth.nc (or .mat, a folder, …).
        out: folder of the run.
        calibration: of the camera, by `tmca calibrate`: a file, or its name without the date for the newest; the run's
            own operator without it.
        validation: names of captures that are held out, or one share such as 0.2, which is the default.
        steps: optimiser steps; 200 without it.
        rate: learning rate; 1e-4 without it.
        batch: windows of captures per step; 2 without it.
        patch: rows of these windows; whole captures up to 256 rows without it.
        set_: a setting of data, optimiser, precision, validate_every, checkpoint_every or seed, as optimiser.loss=l1.
        accelerator: auto, cpu or cuda.
    """
    if from_ is None or captures is None or out is None:
        needed = {"--from": from_, "--captures": captures, "--out": out}
        missing = [name for name, given in needed.items() if given is None]
        wanted = f"{', '.join(CAMERA_SPECS)}; or --from RUN, --captures and --out to fine-tune"
        raise SettingError("train", f"no camera, and no {missing[0]}", wanted, "tmca train --help says more")
    from tmca.tuning.run import prepared

    named = {"optimiser.steps": steps, "optimiser.decoder_rate": rate, "data.batch": batch, "data.patch": patch}
    changes = _settings(set_) | {name: value for name, value in named.items() if value is not None}
    ready = prepared(from_, captures, calibration, validation=validation, changes=changes)
    _run_tuning(ready, out, accelerator, json)


@Parameter(name="*")
@dataclass(frozen=True)
class RunOptions:
    """A run and its settings."""

    out: Path
    "Folder of the run."
    preset: str | None = None
    "quick (minutes on two cores), or thesis (the thesis' setting, docs/training.md)."
    config: Path | None = None
    "YAML description; options replace its values."
    train: list[str] | None = None
    "Scenes to learn from, files, rendered scenes, or split files of them; may be given several times."
    validation: list[str] | None = None
    "The same, for choosing the best checkpoint; else shares of --train are set aside."
    set_: Annotated[list[str] | None, Parameter(name="--set")] = None
    "Any setting, as camera.slots=4 or noise='[{read_noise: 0.01}]'; may be given several times."
    steps: MaybeWhole = None
    "Optimiser steps."
    accelerator: str = "auto"
    "auto, cpu or cuda."
    json: Json = False

    def settings(self, kind: str, beside: Mapping[str, Any]) -> Any:
        """Settings of a run; ``beside`` are those that other options say, by dotted name."""
        from tmca.training import training_settings

        named = {"data.train": self.train, "data.validation": self.validation, "optimiser.steps": self.steps}
        options = {name: value for name, value in named.items() if value is not None}
        return training_settings(kind, self.preset, self.config, {**beside, **_settings(self.set_), **options})


@app.command
def spectral(*, run: RunOptions, snapshot: Path | None = None) -> None:
    """Train the spectral camera. The same command goes on with a run that was stopped.

    Writes into --out: weights.safetensors (codes and decoder with the best validation), log.csv, pictures, checkpoints.
    For several processes start it with `torchrun --nproc-per-node N -m tmca.cli train spectral …`, on several machines
    with --nnodes too; they share the folder of the run.

    Args:
        snapshot: a file of a real or simulated capture, for whose camera the decoder is trained: its codes (kept as
            they are), bands, optics and noise; scenes are interpolated to its bands.
    """
    if snapshot is None:
        _train("spectral", run, {})
        return
    from tmca.training.snapshot_camera import training_of as training_of_capture

    _train("spectral", run, *training_of_capture(snapshot))


@app.command
def light_field(*, run: RunOptions, reading: Annotated[ViewsReading, READING] = _VIEWS) -> None:
    """Train the light-field camera. The same command goes on with a run that was stopped.

    Writes into --out: weights.safetensors (codes and decoder with the best validation), log.csv, pictures, checkpoints.
    """
    _train("light-field", run, {f"data.{name}": value for name, value in reading.given().items()})


@app.command
def spectral_depth(
    *, run: RunOptions, from_rgb: Annotated[bool, Parameter(negative="")] = False, placed: str | None = None
) -> None:
    """Train the spectral-depth camera. The same command goes on with a run that was stopped.

    Writes into --out: weights.safetensors (masks, shutter, filters and decoder with the best validation), log.csv,
    pictures, checkpoints.

    Args:
        from_rgb: make up spectra of measured reflectances for RGB-D scenes.
        placed: put cubes without depth at drawn depths: plane, slanted, staged, smooth, pieces or random.
    """
    beside = {"data.from_rgb": from_rgb or None, "data.placed": placed}
    _train("spectral-depth", run, {name: value for name, value in beside.items() if value})


def _train(kind: str, options: RunOptions, beside: Mapping[str, Any], load: Any = None) -> None:
    """Train, draw how it went, and say what came out."""
    from tmca.reports.training import training_pictures
    from tmca.training import scene_reader, train

    settings, out = options.settings(kind, beside), options.out
    pictures: list[Path] = []

    def run(read: Any, how: dict[str, Any]) -> Any:
        return train(settings, out, read, finish=lambda: pictures.extend(training_pictures(out)), **how)

    trained = _run_with_bar(f"train {out.name}", "training", load or scene_reader(settings), run, options.accelerator)
    if _rank():
        return
    best = trained.best
    validated = best["step"] and isfinite(best["psnr"])
    merit = f", validation PSNR {best['psnr']:.2f} dB at step {best['step']}" if validated else ""
    merit += "" if validated else "; no scene was set aside to choose the best step: --validation names some"
    line = f"{trained.weights}: {trained.steps} steps{merit}; {', '.join(one.name for one in pictures)} beside it"
    say({"weights": str(trained.weights), "best": best, "steps": trained.steps}, options.json, line)


def _rank() -> int:
    """Of this process among those of a run."""
    return int(os.environ.get("RANK", "0"))


def _run_with_bar(title: str, doing: str, load: Callable[[str], Any], run: Callable[..., Any], accelerator: str) -> Any:
    """``run``, which takes what reads a scene and the engine's arguments of `tmca.training.train`, with a bar."""
    processes = int(os.environ.get("LOCAL_WORLD_SIZE", "1"))
    nodes = int(os.environ.get("WORLD_SIZE", "1")) // processes
    with progress_bar(title) as bar:

        def read(name: str) -> Any:
            scene = load(name)
            if not _rank():
                bar(None, f"{Path(name).name} read")
            return scene

        def show(done: int, steps: int, text: str) -> None:
            bar(done / steps, doing, f"step {done}/{steps}, {text}")

        return run(read, {"accelerator": accelerator, "processes": processes, "nodes": nodes, "progress": show})


def _run_tuning(prepared: Any, out: Path, accelerator: str, json: bool) -> None:
    """Fine-tune, draw how it went, and say what came out."""
    from tmca.tuning import tuning_pictures

    pictures: list[Path] = []

    def run(read: Any, how: dict[str, Any]) -> Any:
        return prepared.run(out, read, finish=lambda: pictures.extend(tuning_pictures(prepared, out)), **how)

    tuned = _run_with_bar(f"tune {out.name}", "fine-tuning", prepared.read, run, accelerator)
    if not _rank():
        report = _report(prepared, out, tuned, pictures)
        say(report, json, *_lines(report))


def _report(prepared: Any, out: Path, tuned: Any, pictures: list[Path]) -> dict[str, Any]:
    from tmca.training.log import TrainingLog

    before = {name: float(value) for name, value in TrainingLog(out / "log.csv").rows()[0].items() if value}
    data, used = prepared.settings.data, prepared.calibration
    return {
        "weights": str(tuned.weights),
        "calibration": None if used is None else used.where,
        "learned_from": list(data.train),
        "held_out": list(data.validation),
        "before": {name: before[name] for name in tuned.best if name in before and name != "step"},
        "best": tuned.best,
        "steps": tuned.steps,
        "files": [str(picture) for picture in pictures],
    }


def _lines(report: dict[str, Any]) -> list[str]:
    """The report for people."""
    from tmca.metrics import MERITS, with_unit

    best, held = report["best"], len(report["held_out"])
    count = f"{len(report['learned_from'])} captures learned from, {held} held out"
    operator = f"calibrated by {report['calibration']}" if report["calibration"] else "the run's own, not calibrated"
    lines = [f"{report['weights']}: {count}, {report['steps']} steps", f"  operator: {operator}"]
    for name, value in report["before"].items():
        if name != "score":
            better = f"; {MERITS[name].direction}" if name in MERITS else ""
            after = f"{with_unit(name, best[name])} after (step {best['step']}{better})"
            lines.append(f"  {name} held out: {with_unit(name, value)} before, {after}")
    if not best["step"]:
        lines.append("  no step was better than the decoder as it was, which is what is saved")
    return [*lines, f"  {', '.join(Path(file).name for file in report['files'])} beside it"]


def _settings(texts: list[str] | None) -> dict[str, Any]:
    """Settings by dotted name, of ``--set``."""
    return dict(map(_setting, texts or ()))


def _setting(text: str) -> tuple[str, Any]:
    import yaml

    from tmca.yaml_files import parsed_yaml

    name, sign, value = text.partition("=")
    if not sign or not name:
        raise SettingError("--set", repr(text), "name=value, such as camera.slots=4")
    try:
        return name.strip(), parsed_yaml(value)
    except yaml.YAMLError:
        raise SettingError("--set", repr(text), "a value in YAML, such as 4, one-hot or [4, 40]") from None
