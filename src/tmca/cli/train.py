"""``tmca train``: codes and decoders that learn together."""

from __future__ import annotations

import json as json_module
from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from tmca.cli.cameras import READING
from tmca.cli.options.numbers import MaybeWhole
from tmca.errors import SettingError
from tmca.specs import ViewsReading

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
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Fine-tune the decoder of a trained run, of any camera, on captures with their truth. The same command goes on.

    Codes, optics and calibration stay as they are. What is kept is never worse on the captures that are held out than
    the decoder as it was. Writes into --out what a run writes, and before_after.png of a capture that was held out.

    Args:
        from_: the run: its folder, its weights file, or default.
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
        json: print the result as JSON.
    """
    if from_ is None or captures is None or out is None:
        asked = {"--from": from_, "--captures": captures, "--out": out}
        missing = [name for name, given in asked.items() if given is None]
        known = "spectral, light-field or spectral-depth; or --from RUN, --captures and --out to fine-tune"
        raise SettingError("train", f"no camera, and no {missing[0]}", known, "tmca train --help says more")
    from tmca.cli.tune import run_tuning
    from tmca.tuning.run import prepared

    changes = {name: value for name, value in map(_setting, set_ or ())}
    named = {"optimiser.steps": steps, "optimiser.decoder_rate": rate, "data.batch": batch, "data.patch": patch}
    changes |= {name: value for name, value in named.items() if value is not None}
    ready = prepared(from_, captures, calibration, validation=validation, changes=changes)
    run_tuning(ready, out, accelerator, json)


@app.command
def spectral(
    *,
    out: Path,
    preset: str | None = None,
    config: Path | None = None,
    train: list[str] | None = None,
    validation: list[str] | None = None,
    snapshot: Path | None = None,
    set_: Annotated[list[str] | None, Parameter(name="--set")] = None,
    steps: MaybeWhole = None,
    accelerator: str = "auto",
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Train the spectral camera. The same command goes on with a run that was stopped.

    Writes into --out: weights.safetensors (codes and decoder with the best validation), log.csv, pictures, checkpoints.
    For several processes start it with `torchrun --nproc-per-node N -m tmca.cli train spectral …`, on several machines
    with --nnodes too; they share the folder of the run.

    Args:
        out: folder of the run.
        preset: quick (minutes on two cores), or thesis (12 bands, 256², K = 8, U-Net, 500 epochs).
        config: YAML description; options replace its values.
        train: cubes, rendered scenes, or split files; may be given several times.
        validation: the same, for choosing the best checkpoint; else shares of --train are set aside.
        snapshot: a file of a real or simulated capture, for whose camera the decoder is trained: its codes (kept as
            they are), bands, optics and noise; scenes are interpolated to its bands.
        set_: any setting, as camera.slots=4 or noise='[{read_noise: 0.01}]'; may be given several times.
        steps: optimiser steps.
        accelerator: auto, cpu or cuda.
        json: print the result as JSON.
    """
    own: dict[str, Any] = {}
    read: Any = None
    if snapshot is not None:
        from tmca.training.snapshot_camera import training_of as training_of_capture

        own, read = training_of_capture(snapshot)
    changes = own | _changes(set_, train, validation, steps)
    _run("spectral", (preset, config, changes), out, accelerator, json, read)


@app.command
def light_field(
    *,
    out: Path,
    preset: str | None = None,
    config: Path | None = None,
    train: list[str] | None = None,
    validation: list[str] | None = None,
    reading: Annotated[ViewsReading, READING] = _VIEWS,
    set_: Annotated[list[str] | None, Parameter(name="--set")] = None,
    steps: MaybeWhole = None,
    accelerator: str = "auto",
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Train the light-field camera. The same command goes on with a run that was stopped.

    Writes into --out: weights.safetensors (codes and decoder with the best validation), log.csv, pictures, checkpoints.

    Args:
        out: folder of the run.
        preset: quick (minutes on two cores), or thesis (5×5 views of 480×270, K = 8, patches of 11×11, 500 epochs).
        config: YAML description; options replace its values.
        train: folders of views, lenslet pictures, files, rendered scenes such as coffee or coffee:3, or split files.
        validation: the same, for choosing the best checkpoint; else shares of --train are set aside.
        set_: any setting, as camera.slots=4 or noise='[{read_noise: 0.05}]'; may be given several times.
        steps: optimiser steps.
        accelerator: auto, cpu or cuda.
        json: print the result as JSON.
    """
    files = {f"data.{name}": value for name, value in reading.given().items()}
    changes = _changes(set_, train, validation, steps, files)
    _run("light-field", (preset, config, changes), out, accelerator, json)


@app.command
def spectral_depth(
    *,
    out: Path,
    preset: str | None = None,
    config: Path | None = None,
    train: list[str] | None = None,
    validation: list[str] | None = None,
    from_rgb: Annotated[bool, Parameter(negative="")] = False,
    placed: str | None = None,
    set_: Annotated[list[str] | None, Parameter(name="--set")] = None,
    steps: MaybeWhole = None,
    accelerator: str = "auto",
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Train the spectral-depth camera. The same command goes on with a run that was stopped.

    Writes into --out: weights.safetensors (masks, shutter, filters and decoder with the best validation), log.csv,
    pictures, checkpoints.

    Args:
        out: folder of the run.
        preset: quick (minutes on two cores), or thesis (25 bands, 256², K = 4, eight planes, everything learned).
        config: YAML description; options replace its values.
        train: rendered scenes, RGB-D scenes, cubes, spectral scenes with depth, or split files of them.
        validation: the same, for choosing the best checkpoint; else shares of --train are set aside.
        from_rgb: make up spectra of measured reflectances for RGB-D scenes.
        placed: put cubes without depth at drawn depths: plane, slanted, staged, smooth, pieces or random.
        set_: any setting, as camera.slots=4 or noise='[{read_noise: 0.002}]'; may be given several times.
        steps: optimiser steps.
        accelerator: auto, cpu or cuda.
        json: print the result as JSON.
    """
    changes = _changes(set_, train, validation, steps)
    changes |= {"data.from_rgb": True} if from_rgb else {}
    changes |= {"data.placed": placed} if placed else {}
    _run("spectral-depth", (preset, config, changes), out, accelerator, json)


def _changes(
    set_: list[str] | None,
    train: list[str] | None,
    validation: list[str] | None,
    steps: int | None,
    files: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Settings that options replace, by dotted name."""
    changes = {name: value for name, value in map(_setting, set_ or ())}
    named = {"data.train": train, "data.validation": validation, "optimiser.steps": steps, **(files or {})}
    return changes | {name: value for name, value in named.items() if value is not None}


def _run(kind: str, described: tuple[Any, ...], out: Path, accelerator: str, json: bool, load: Any = None) -> None:
    """Train, draw how it went, and say what came out; ``described`` is preset, file and changes of the settings."""
    from tmca.cli.tune import rank, run_with_bar
    from tmca.reports.training import training_pictures
    from tmca.training import scene_reader, train, training_settings

    settings = training_settings(kind, *described)

    def run(read: Any, how: dict[str, Any]) -> Any:
        return train(settings, out, read, **how)

    trained = run_with_bar(f"train {out.name}", "training", load or scene_reader(settings), run, accelerator)
    if rank():
        return
    pictures = training_pictures(out)
    if json:
        print(
            json_module.dumps({"weights": str(trained.weights), "best": trained.best, "steps": trained.steps}, indent=1)
        )
        return
    checked = trained.best["step"] and isfinite(trained.best["psnr"])
    said = f", validation PSNR {trained.best['psnr']:.2f} dB at step {trained.best['step']}" if checked else ""
    said += "" if checked else "; no scene was set aside to choose the best step: --validation names some"
    print(
        f"{trained.weights}: {trained.steps} steps{said}; {', '.join(picture.name for picture in pictures)} beside it"
    )


def _setting(text: str) -> tuple[str, Any]:
    import yaml

    name, sign, value = text.partition("=")
    if not sign or not name:
        raise SettingError("--set", repr(text), "name=value, such as camera.slots=4")
    try:
        return name.strip(), yaml.safe_load(value)
    except yaml.YAMLError:
        raise SettingError("--set", repr(text), "a value in YAML, such as 4, one-hot or [4, 40]") from None
