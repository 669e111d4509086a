"""The table of the spectral-depth camera: codes × noises × decoders over test scenes, each cell computed once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tmca.applications.example_scenes import some_of
from tmca.cameras import SpectralDepthCamera
from tmca.data.depth_scenes import check_depth_scenes, load_any_depth_scene, withheld_scene
from tmca.data.scene_names import identity_of, short_names
from tmca.errors import SettingError
from tmca.experiments.cells import Grid, Measured, Settings, Timed, timed
from tmca.experiments.results import check_counts, check_decoders, check_new, write_table
from tmca.experiments.source import source_digest
from tmca.experiments.spectral_depth import plan
from tmca.experiments.spectral_depth.cells import measure
from tmca.experiments.spectral_depth.comparison_figures import comparison_pictures, picture_files
from tmca.experiments.spectral_depth.imaging import reading_range
from tmca.experiments.spectral_depth.priors import learned_depth_prior
from tmca.experiments.spectral_depth.rows import DECODER_NAMES, NETWORKS, Sizes
from tmca.experiments.spectral_depth.tables import markdown, results

EFFORT = {"starts": 3, "steps": 40, "rate": 0.003}
"""Of every search of masks, static or not."""


def compare_spectral_depth(
    train: Sequence[str],
    test: Sequence[str],
    out: Path,
    work: Path,
    *,
    decoders: Sequence[str] = ("likelihood",),
    placed: str | None = None,
    from_rgb: bool = False,
    sizes: Sizes | None = None,
    effort: dict[str, Any] | None = None,
    seed: int = 0,
    seeds: int = 1,
    steps: int = 400,
    jobs: int = 1,
    cluster: Settings | None = None,
    overwrite: bool = False,
    progress: Timed | None = None,
    command: Sequence[str] = (),
) -> dict[str, Any]:
    """Measure every code, noise and decoder on the scenes of ``test``.

    Args:
        train: scenes or split files that the prior, the masks and the networks learn from.
        test: scenes or split files that are measured; they choose nothing.
        out: folder of ``spectral-depth.md``, ``spectral-depth.json`` and pictures.
        work: folder of prior, codes and finished cells; a stopped run goes on there.
        decoders: names of ``DECODER_NAMES``.
        placed: how cubes without depth are put at drawn depths, a kind of ``tmca.data.place_cube``.
        from_rgb: make up spectra for RGB-D scenes.
        sizes: of scenes, windows and patches.
        effort: arguments of `MaskEffort`, of every search, static or not.
        seed: of codes, noise and trainings.
        seeds: how many of them, from ``seed`` on.
        steps: of a training.
        jobs: processes side by side.
        cluster: parameters of submitit, to send the cells to Slurm instead.
        overwrite: replace results.
        progress: told (done, all, name, seconds left) after each cell.
        command: how the run was called, kept in the results.

    Raises:
        SettingError: unknown decoder, no scenes, or a scene in both lists.
        OutputError: the results exist.
        DataError: a scene that cannot be used.
        CellsFailed: some cells failed; the others are kept.
    """
    from tmca.data import make_folder
    from tmca.training.scenes import named_scenes

    own = sizes or Sizes()
    check_counts(seeds=seeds, steps=steps, jobs=jobs)
    check_decoders(decoders, DECODER_NAMES)
    _check_side(own, decoders)
    learned, measured = named_scenes(train), named_scenes(test)
    _check_apart(learned, measured)
    names = short_names(list(measured))
    files = [out / "spectral-depth.json", out / "spectral-depth.md"]
    check_new([*files, *picture_files(list(names.values()), out)], overwrite)
    how: Settings = {"side": own.side, "placed": placed, "from_rgb": from_rgb}
    probe = SpectralDepthCamera.from_preset(own.preset, size=own.crop)
    check_depth_scenes(learned, measured, own.crop, **how, **reading_range(probe))
    grid = Grid(partial(measure, folder=str(work)), work, jobs, cluster, progress)
    common = _common(learned, names, work, own, how, progress)
    make_folder(out)
    which = tuple(decoders), range(seed, seed + seeds)
    table = plan.Table(common, own, learned, *which, effort or EFFORT, steps, work, withheld_scene(learned))
    found = _measured(grid, table)
    split = {"train": list(short_names(list(learned)).values()), "test": list(names.values()), **how}
    if {*decoders} & {*NETWORKS}:
        split |= _of_networks(table, split["train"])
    told = results(found, split, {**vars(own), "effort": dict(table.effort), "steps": steps}, command)
    write_table(told, markdown(told), files, overwrite)
    scenes = {
        n: load_any_depth_scene(path, materials="test", **how, **reading_range(probe)) for path, n in names.items()
    }
    comparison_pictures([c for c in found if c["seed"] == seed], scenes, probe, out, overwrite=overwrite)
    grid.failures.check()
    return told


def _of_networks(table: plan.Table, names: Sequence[str]) -> dict[str, Any]:
    """Which scenes networks have beside those of the lists, and which of these is withheld from them."""
    own = plan.network_scenes(table)
    found: dict[str, Any] = {
        "rendered": {"train": own["train"][len(own["prior"]) :], "validation": own["validation"][:1]}
    }
    return found if table.withheld is None else found | {"withheld": names[list(table.train).index(table.withheld)]}


def _common(
    learned: Sequence[str], names: dict[str, str], work: Path, own: Sizes, how: Settings, progress: Timed | None
) -> Settings:
    """What all cells know; the prior is learned first, where it is not kept."""
    from tmca.data import make_folder

    prior = learned_depth_prior(learned, make_folder(work), own.preset, own.window, how, timed(progress))
    common: Settings = {"source": source_digest(__name__), "preset": own.preset, "prior": prior, "crop": list(own.crop)}
    common |= {**how, "examples": some_of(learned), "scenes": names}
    return common | {"checksums": [identity_of(n) or n for n in (*learned, *names)]}


def _measured(grid: Grid, table: plan.Table) -> list[Measured]:
    """All that can be measured.

    Raises:
        CellsFailed: nothing could.
    """
    found = grid.run(plan.searches(table)) + grid.run([plan.constant(table)])
    codes = {(cell["code"], cell["seed"]): cell["codes"] for cell in found if "codes" in cell}
    for decoder in (name for name in table.decoders if name not in NETWORKS):
        rows = plan.untrained(table, codes, decoder)
        found += grid.run(rows) + grid.run(plan.foretold(table, rows))
    trained = grid.run(plan.trainings(table, codes))
    trained += grid.run(plan.behind_learned(table, trained))
    rows = plan.behind_networks(table, trained)
    found += trained + grid.run(rows) + grid.run(plan.foretold(table, rows))
    if not any("metrics" in cell for cell in found):
        grid.failures.check()
    return found


def _check_side(own: Sizes, decoders: Sequence[str]) -> None:
    """Raises SettingError where scenes may be too small for what is measured, or for what networks learn from."""
    from tmca.training.starting_masks import usual_margin

    margin = usual_margin(
        SpectralDepthCamera.preset(own.preset)["bench"].window, SpectralDepthCamera.presets[own.preset]["period"]
    )
    least = max(min(own.crop), own.patch + 2 * margin if {*decoders} & {*NETWORKS} else 1)
    if own.side < least:
        raise SettingError("--side", str(own.side), f"at least {least} pixels, as patches with margins and --crop need")


def _check_apart(train: Sequence[str], test: Sequence[str]) -> None:
    from tmca.training.scenes import place_of

    for name, scenes in (("--train", train), ("--test", test)):
        if not scenes:
            raise SettingError(name, "no scenes", "scenes or split files")
    both = sorted({place_of(name) for name in train} & {place_of(name) for name in test})
    if both:
        raise SettingError("--test", f"{both[0]}, a training scene", "other scenes")
