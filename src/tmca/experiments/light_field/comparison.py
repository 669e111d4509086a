"""The table of the light-field camera: codes × noises × decoders over test scenes, in cells that are computed once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from tmca.errors import SettingError
from tmca.experiments.cells import Failures, Measured, Settings, Timed, cell_key, run_cells, source_digest, timed
from tmca.experiments.light_field.cells import measure
from tmca.experiments.light_field.comparison_figures import comparison_pictures, picture_files, slug
from tmca.experiments.light_field.learned import Learned
from tmca.experiments.light_field.reading import NOTHING, Reading, check_asked, read
from tmca.experiments.light_field.rows import (
    DECODER_NAMES,
    DESIGNED,
    EFFORT,
    LEARNED,
    NETWORKS,
    NOISES,
    SHOWN,
    SHOWN_NOISE,
    TRAINED,
    Sizes,
    rows,
    scenes_of,
    search_of,
    training_of,
)
from tmca.experiments.light_field.tables import markdown, results
from tmca.experiments.results import check_counts, check_decoders, check_new
from tmca.experiments.scenes import identity_of, short_names
from tmca.optics import view_grid

_DICTIONARY = "dictionary"


def compare_light_field(
    train: Path,
    test: Path,
    out: Path,
    work: Path,
    *,
    decoders: Sequence[str] = tuple(DECODER_NAMES),
    sizes: Sizes | None = None,
    effort: Mapping[str, int] = EFFORT,
    reading: Reading = NOTHING,
    test_scale: int | None = None,
    atoms: int = 1024,
    seed: int = 0,
    seeds: int = 1,
    steps: int = 300,
    jobs: int = 1,
    cluster: Settings | None = None,
    overwrite: bool = False,
    progress: Timed | None = None,
    command: Sequence[str] = (),
) -> dict[str, Any]:
    """Measure every code, noise and decoder on the light fields of ``test`` and on rendered ones of known geometry.

    Args:
        train: split file of the light fields that priors, dictionary, codes and networks learn from.
        test: split file of the measured light fields; they choose nothing.
        out: folder of ``light-field.md``, ``light-field.json`` and pictures.
        work: folder of priors, designs and finished cells; a stopped run goes on there.
        decoders: names of ``DECODER_NAMES``; the dictionary decodes a crop, where the others are measured too.
        sizes: of views, frames, codes and patches.
        effort: arguments of ``Effort``, of every search, static or not.
        reading: of light fields from files; its ``scale`` of those of ``train``.
        test_scale: the scale of those of ``test``.
        atoms: of the dictionary.
        seed: of codes, noise and trainings.
        seeds: how many of them, from ``seed`` on.
        steps: of a training.
        jobs: processes side by side.
        cluster: parameters of submitit, to send the cells to Slurm instead.
        overwrite: replace results.
        progress: told (done, all, name, seconds left) after each cell.
        command: how the run was called, kept in the results.

    Raises:
        SettingError: unknown decoder, an even number of views, or a frame smaller than the crop.
        OutputError: the results exist.
        DataError: a light field of a split is missing or altered.
        CellsFailed: some cells failed; the table of the others is written.
    """
    from tmca.data import make_folder, read_split, split_rendered_light_fields, write_json, write_text

    check_counts(seeds=seeds, steps=steps, jobs=jobs)
    check_decoders(decoders, DECODER_NAMES)
    own = sizes or Sizes()
    view_grid(own.views)  # refuses even ones before anything is made
    examples = [str(path) for path in read_split(train)]
    real = [str(path) for path in read_split(test)]
    scenes = short_names(real + sorted(split_rendered_light_fields()["test"]))
    files = [out / "light-field.json", out / "light-field.md"]
    check_new([*files, *picture_files([slug(name) for name in scenes.values()], out)], overwrite)
    measured_as = replace(reading, scale=test_scale)
    check_asked([*examples, *real], pattern=reading.pattern, lens=reading.lens)
    _check_readable(examples, real, own, reading, measured_as)
    make_folder(out)
    learned = _learn(Learned(examples, make_folder(work), own.views, reading), decoders, atoms)
    failures = Failures(work)

    def run(part: list[Settings]) -> list[Measured]:
        compute, told = partial(measure, folder=str(work)), timed(progress)
        return run_cells(part, compute, work, jobs=jobs, cluster=cluster, progress=told, failures=failures)

    common: Settings = {"source": source_digest(), "views": 2 * [own.views]}
    common |= {"examples": learned["examples"], "designs": str(make_folder(work / "designs"))}
    common |= {"period": 2 * [own.period], "effort": dict(effort), "exposures": 1}
    places = _places(scenes, real, own, measured_as)
    searched = _searches(common, seed, seeds)
    for slots in (True, False):  # a search of multiplexed codes contains that of the static ones
        run([cell for cell in searched if (cell["search"][1] > 1) == slots])
    measured = run(searched) + run(_geometries(common, places))
    maps = {cell["path"]: cell["disparity"] for cell in measured if cell["kind"] == "geometry"}
    measured += run(_untrained(common, places, decoders, learned, maps, seed, seeds))
    trained = run(_trainings(common, examples, reading, work, own, decoders, seed, seeds, steps))
    measured += trained + run(_behind_networks(common, places, trained, maps))
    if not any("metrics" in cell for cell in measured):
        failures.check()
    split: Settings = {"train": list(short_names(examples).values()), "test": list(scenes.values())}
    split["real"] = [scenes[name] for name in real]
    split |= {**vars(reading), "test_scale": test_scale, "atoms": atoms}
    found = results(measured, split, {**vars(own), "effort": dict(effort), "steps": steps}, command)
    write_json(found, files[0], overwrite=overwrite)
    write_text(markdown(found), files[1], overwrite=overwrite)
    shown = [cell for cell in measured if cell.get("seed", seed) == seed]
    comparison_pictures(shown, out, overwrite=overwrite)
    failures.check()
    return found


def _learn(learned: Learned, decoders: Sequence[str], atoms: int) -> dict[str, str]:
    """Files that the decoders need, and the examples of the searches."""
    found = {"examples": learned.examples(), "lmmse": learned.prior()}
    if "mixture" in decoders:
        found["mixture"] = learned.mixture()
    if _DICTIONARY in decoders:
        found[_DICTIONARY] = learned.dictionary(atoms)
    return found


def _searches(common: Settings, first: int, seeds: int) -> list[Settings]:
    """Every design of every noise and seed."""
    return [
        {**common, "kind": "search", "name": f"search · {code} · {noise} · seed {seed}", "search": [kind, slots],
         "code": code, "noise": noise, "sensor": NOISES[noise], "seed": seed}
        for seed in range(first, first + seeds)
        for noise in NOISES
        for code, (kind, slots) in ((c, search_of(c, noise)[:2]) for c, (_, target) in DESIGNED.items() if not target)
    ]  # fmt: skip


def _check_readable(
    examples: Sequence[str], real: Sequence[str], sizes: Sizes, reading: Reading, measured_as: Reading
) -> None:
    """Refuse light fields that cannot be used, and a frame that the crop does not fit, before anything is learned."""
    for side, most in zip(sizes.crop, sizes.frame, strict=True):
        if side > most:
            found, wanted = "×".join(map(str, sizes.frame)), "×".join(map(str, sizes.crop))
            raise SettingError("frame", f"{found} pixels", f"at least {wanted}, the crop that the dictionary decodes")
    for name in examples:
        read(name, sizes.views, reading)
    try:
        for name in real:
            read(name, sizes.views, measured_as, sizes.frame)
    except SettingError as error:
        where = "frame" if error.where == "crop" else error.where
        raise SettingError(where, error.found, error.expected, error.remedy) from error


def _places(scenes: Mapping[str, str], real: Sequence[str], sizes: Sizes, measured_as: Reading) -> list[Settings]:
    """Where is measured: on every scene, and on a crop of those from files, where the dictionary can follow."""
    whole: list[Settings] = [
        {"path": scene, "scene": name, "checksum": identity_of(scene), "crop": None, "reading": vars(measured_as),
         "size": list(sizes.frame if scene in real else sizes.rendered)}
        for scene, name in scenes.items()
    ]  # fmt: skip
    return whole + [{**place, "crop": list(sizes.crop)} for place in whole if place["path"] in real]


def _geometries(common: Settings, places: Sequence[Settings]) -> list[Settings]:
    plain = {name: common[name] for name in ("source", "views")}
    return [
        {**plain, **place, "kind": "geometry", "name": f"{place['scene']} · disparity of the true views"}
        for place in places if not place["crop"]
    ]  # fmt: skip


def _untrained(
    common: Settings,
    places: Sequence[Settings],
    decoders: Sequence[str],
    learned: dict[str, str],
    maps: dict[str, str],
    first: int,
    seeds: int,
) -> list[Settings]:
    """Measurements without training."""
    found = []
    for decoder in (name for name in decoders if name not in NETWORKS):
        prior = {"dictionary" if decoder == _DICTIONARY else "prior": learned[decoder]}
        for noise in NOISES:
            for code in rows(noise):
                for seed in range(first, first + seeds):
                    cell = {**common, **prior, "code": code, "noise": noise, "decoder": decoder, "seed": seed}
                    found += _measurements(cell, places, maps)
    return found


def _measurements(cell: Settings, places: Sequence[Settings], maps: dict[str, str]) -> list[Settings]:
    """One in every place; the dictionary's on crops alone."""
    keep = (cell["code"], cell["decoder"]) in SHOWN and cell["noise"] == SHOWN_NOISE
    label = f"{cell['code']} · {cell['noise']} · {DECODER_NAMES[cell['decoder']]} · seed {cell['seed']}"
    return [
        {**cell, **place, "kind": "measurement", "keep": keep and not place["crop"],
         "name": f"{place['scene']}{' crop' if place['crop'] else ''} · {label}",
         "disparity": None if place["crop"] else maps.get(place["path"])}
        for place in places if place["crop"] or cell["decoder"] != _DICTIONARY
    ]  # fmt: skip


def _trainings(
    common: Settings,
    examples: Sequence[str],
    reading: Reading,
    work: Path,
    sizes: Sizes,
    decoders: Sequence[str],
    first: int,
    seeds: int,
    steps: int,
) -> list[Settings]:
    """Trainings of all rows and seeds."""
    from tmca.experiments.codes.task import Task

    asked = {name: value for name, value in vars(reading).items() if value is not None}
    checksums = [identity_of(name) for name in examples]
    cells = []
    for seed in range(first, first + seeds):
        for decoder in (name for name in decoders if name in NETWORKS):
            for code in TRAINED:
                codes, start = None, LEARNED.get(code, (code,))[0]
                if start in DESIGNED:
                    kind, slots, target = search_of(start, "")
                    codes = str(Task.of({**common, "seed": seed, "sensor": NOISES[target]}).file(kind, slots))
                training = training_of(code, decoder, seed, steps, sizes, codes)
                training["data"] = {**training["data"], **scenes_of(examples), **asked}
                cell: Settings = {**common, "kind": "training", "code": code, "decoder": decoder, "seed": seed}
                cell |= {"name": f"training · {code} · {DECODER_NAMES[decoder]} · seed {seed}"}
                cell |= {"training": training, "checksums": checksums}
                cells.append(cell | {"folder": str(work / f"training-{cell_key(cell)}")})
    return cells


def _behind_networks(
    common: Settings, places: Sequence[Settings], trained: Sequence[Measured], maps: dict[str, str]
) -> list[Settings]:
    """Measurements of trained rows."""
    found = []
    for row in trained:
        for noise in NOISES:
            cell = {**common, "code": row["code"], "noise": noise, "decoder": row["decoder"], "seed": row["seed"]}
            found += _measurements(cell | {"weights": row["weights"]}, places, maps)
    return found
