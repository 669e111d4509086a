"""``tmca compare``: the table of codes, noises and decoders."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import App

from tmca.cli.cameras import READING
from tmca.cli.options.grid import DepthScenes, GridOptions
from tmca.cli.options.numbers import Whole, size
from tmca.cli.options.output import say
from tmca.cli.progress import cell_done
from tmca.specs import MeasuredReading

app = App(name="compare", help="A table of codes, noises and decoders over a list of test scenes.")
_GRID, _VIEWS, _DEPTH = GridOptions(), MeasuredReading(), DepthScenes()


@app.command
def spectral(
    *,
    train: Path,
    test: Path,
    out: Path = Path("docs/results"),
    work: Path = Path("runs/compare-spectral"),
    bands: Whole = 12,
    decoders: str = "lmmse,mixture,admm-tv",
    validation: Path | None = None,
    seed: Whole = 0,
    seeds: Whole = 1,
    steps: Whole = 400,
    grid: GridOptions = _GRID,
) -> None:
    """Static CASSI against time-multiplexed codes, noise-free, at σ = 0.01 and with a real sensor.

    Writes spectral.md and spectral.json. Finished cells are kept in --work: a run that was stopped goes on.

    Args:
        train: split file (a path per line: docs/studies.md) whose scenes teach priors and networks.
        test: split file whose scenes are measured; it chooses nothing.
        out: folder of the two result files.
        work: folder of priors and finished cells.
        bands: bands, nearest to even spacing from 400 to 700 nm.
        decoders: which of those that `tmca decoders` lists for the camera, and of the trained unet-thesis (from Φᵀy),
            unet (from the LMMSE), unrolled, unrolled-mixture; separated by commas. unet-thesis and unrolled learn codes
            too. Your own are FILE.py:Class, or FILE.pt2 of `tmca decoder export`.
        validation: split file of the scenes that choose a network's best step.
        seed: of codes, noise and trainings.
        seeds: how many codes and trainings, from --seed on (ADMM-TV: one).
        steps: optimiser steps of the unrolled network with fixed codes; others take as many minutes.
    """
    _run("spectral", out, work, grid, scenes=_scenes(train, test, validation), reading={"bands": bands},
         decoders=_named(decoders), seed=seed, seeds=seeds, train__steps=steps)  # fmt: skip


@app.command
def light_field(
    *,
    train: Path,
    test: Path,
    out: Path = Path("docs/results"),
    work: Path = Path("runs/compare-light-field"),
    decoders: str = "dictionary,lmmse,mixture",
    frame: str = "270x480",
    period: Whole = 16,
    reading: Annotated[MeasuredReading, READING] = _VIEWS,
    atoms: Whole = 1024,
    seed: Whole = 0,
    seeds: Whole = 1,
    steps: Whole = 300,
    grid: GridOptions = _GRID,
) -> None:
    """Compressive light-field photography (static mask) against time-multiplexed masks, with geometry.

    Random, one-hot and optimised codes, noise-free, at σ = 0.05 and with a real sensor, on the light fields of --test
    and on rendered ones whose geometry is known. Writes light-field.md, light-field.json and pictures. Finished cells
    are kept in --work: a run that was stopped goes on.

    Args:
        train: split file (a path per line: docs/studies.md) whose light fields teach priors, dictionary, codes and
            networks.
        test: split file whose light fields are measured; it chooses nothing.
        out: folder of the results.
        work: folder of priors, designs and finished cells.
        decoders: which of those that `tmca decoders` lists for the camera (dictionaries on a crop), and of the trained
            sub-network (the thesis') and consistent (measurement-consistent, from the lmmse); separated by commas.
        frame: HEIGHTxWIDTH, the middle of the light fields of --test; dictionaries have 96x96 of it at most.
        period: tile of all codes, pixels.
        atoms: of the dictionary.
        seed: of codes, noise and trainings.
        seeds: how many codes and trainings, from --seed on.
        steps: optimiser steps of every network.
    """
    asked = {**reading.model_dump(), "frame": size(frame, "--frame")}
    _run("light-field", out, work, grid, scenes=_scenes(train, test), reading=asked,
         settings={"period": [period, period]}, decoders=_named(decoders), priors={"dictionary": {"atoms": atoms}},
         seed=seed, seeds=seeds, train__steps=steps)  # fmt: skip


@app.command
def spectral_depth(
    *,
    train: list[str],
    test: list[str],
    out: Path = Path("docs/results"),
    work: Path = Path("runs/compare-spectral-depth"),
    decoders: str = "likelihood",
    depth: DepthScenes = _DEPTH,
    seed: Whole = 0,
    seeds: Whole = 1,
    steps: Whole = 400,
    grid: GridOptions = _GRID,
) -> None:
    """A phase mask alone against masks, filters and shutters that change within the exposure: depth and spectrum.

    Writes spectral-depth.md, spectral-depth.json and pictures. Finished cells are kept in --work: a run that was
    stopped goes on.

    Args:
        train: scenes or split files that prior, masks and networks learn from; may be given several times.
        test: scenes or split files that are measured; they choose nothing.
        out: folder of the results.
        work: folder of prior, codes, trainings and finished cells.
        decoders: which of those that `tmca decoders` lists for the camera, and of the trained two-headed (from the
            snapshot) and physics (from the likelihood); separated by commas.
        seed: of codes, noise and trainings.
        seeds: how many of them, from --seed on.
        steps: optimiser steps of a training.
    """
    _run("spectral-depth", out, work, grid, scenes=_scenes(train, test), reading=depth.reading(),
         decoders=_named(decoders), seed=seed, seeds=seeds, train__steps=steps)  # fmt: skip


def _named(decoders: str) -> list[str]:
    """Names of decoders, those of files loaded."""
    from tmca.lab.decoder_files import decoders_named

    return decoders_named(decoders)


def _scenes(train: Path | list[str], test: Path | list[str], validation: Path | None = None) -> dict[str, list[str]]:
    """Scenes of a study."""
    lists = {"train": train, "test": test, "validation": validation or []}
    return {name: [*given] if isinstance(given, list) else [str(given)] for name, given in lists.items()}


def _run(camera: str, out: Path, work: Path, grid: GridOptions, **changes: Any) -> None:
    """Run the shipped study of a camera with other settings, and print its page."""
    from tmca.evaluation.run import run_study
    from tmca.evaluation.study import read_study
    from tmca.evaluation.tables import check_counts

    check_counts(seeds=changes["seeds"], steps=changes["train__steps"])
    study = read_study(camera)
    reading = {**study.reading, **changes.pop("reading", {})}
    if "frame" in reading:
        reading["crop"] = tuple(map(min, reading["crop"], reading["frame"]))
    found = run_study(study.with_(reading=reading, **changes), out, work, progress=cell_done, **grid.how())
    say(found, grid.json, (out / f"{study.name}.md").read_text().rstrip())
