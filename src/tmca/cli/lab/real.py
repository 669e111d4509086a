"""``tmca real``: what real captures say of their prototype, and how well they can be decoded."""

from __future__ import annotations

import json as json_module
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cyclopts import App

from tmca.cli.options.numbers import Whole
from tmca.cli.options.output import Figure, Json, Overwrite, check_figure, check_targets, say, warned
from tmca.progress import progress_bar

if TYPE_CHECKING:
    import xarray as xr

    from tmca.cameras import Snapshot
    from tmca.decoders import Estimate

app = App(name="real", help="Real captures: mask in register, frames behind a pixel shutter, a report of all.")


@app.command
def register(
    captures: list[Path],
    /,
    *,
    prototype: str,
    mask: Path | None = None,
    name: str | None = None,
    shift: str | None = None,
    by: str = "blocks",
    prior: Path | None = None,
    json: Json = False,
) -> None:
    """Find where the mask lies in CAPTURES: its scale and shift along y, or the place of a pixel shutter and its start.

    By evidence, each capture by itself tells shift, rotation, scale, shear and blur of the mask, and the dispersion.

    Args:
        captures: files of captures of any scenes behind a mask; of one behind a pixel shutter.
        prototype: tsa, pixel-shutter-wine, or a YAML description; its numbers for the registration are not used.
        mask: file of the mask.
        name: of the capture, where a file holds several.
        shift: ROWS,COLUMNS of a pixel shutter that another capture told, for one whose patterns repeat.
        by: blocks (displaced copies of the mask explain each block; no prior) or evidence (where a capture is most
            probable under a prior of scenes).
        prior: Gaussian prior of scenes for --by evidence; without it that of the rendered scenes.
    """
    from tmca.errors import SettingError, check_choice
    from tmca.lab.prototype import SingleDisperser, load_prototype

    check_choice("--by", by, ("blocks", "evidence"))
    if prior is not None and by != "evidence":
        raise SettingError("--prior", str(prior), "none without --by evidence", "leave it out")
    described = load_prototype(prototype)
    if not isinstance(described, SingleDisperser):
        if by == "evidence":
            raise SettingError("--by", "evidence for a pixel shutter", "blocks", "leave it out")
        _shutter_place(captures, described, name, shift, json)
        return
    if mask is None:
        raise SettingError("--mask", "none", "the file of the mask")
    if by == "evidence":
        _by_evidence(captures, described, mask, prior, json)
    else:
        _by_blocks(captures, described, mask, json)


def _by_blocks(captures: list[Path], prototype: Any, mask: Path, as_json: bool) -> None:
    """Say where displaced copies of the mask explain blocks of the captures best."""
    from tmca.lab.importing import read_plane
    from tmca.lab.registering import register_mask

    offsets = [round(prototype.pixels_per_band * band) for band in range(len(prototype.wavelengths_nm))]
    values = [read_plane(file, prototype.capture_key) for file in captures]
    image = read_plane(mask, prototype.mask_key)
    registration, deviation = register_mask(values, image, offsets, black=prototype.black)
    scale, down = registration.scale[0], registration.shift[0]
    say(
        {**registration.model_dump(), "deviation": deviation}, as_json,
        f"{mask}: in the captures {scale:.5f} times as large along y, {down:+.3f} pixels down",
        f"  blocks deviate by {deviation:.3f} pixels",
    )  # fmt: skip


def _by_evidence(captures: list[Path], prototype: Any, mask: Path, prior: Path | None, as_json: bool) -> None:
    from tmca.lab.importing import import_capture
    from tmca.lab.registering import MaskImage
    from tmca.registration import register

    as_filed = prototype.model_copy(update={"registration": MaskImage()})
    reports, lines = list[dict[str, Any]](), list[str]()
    for file in captures:
        with progress_bar(f"register: {file.name}") as progress:
            registered = register(import_capture(file, as_filed, mask), prior, progress=progress)
        reports.append({"capture": str(file), **registered.described()})
        place, *exact = registered.lines()
        lines += [f"{file}: {place}", *exact]
    say(reports, as_json, *lines)


def _shutter_place(captures: list[Path], prototype: Any, name: str | None, shift: str | None, as_json: bool) -> None:
    from tmca.cli.options.numbers import whole_numbers
    from tmca.data import read_array
    from tmca.errors import SettingError, check_choice
    from tmca.lab.importing import read_plane
    from tmca.lab.registering import shutter_place

    check_choice("--name", name, prototype.captures)
    fixed = None if shift is None else whole_numbers(shift, "--shift")
    if fixed is not None and len(fixed) != 2:
        raise SettingError("--shift", repr(shift), "whole ROWS,COLUMNS")
    whole = None if fixed is None else (fixed[0], fixed[1])
    keys = prototype.captures[name]
    for file in captures:
        values, patterns = read_plane(file, keys.capture_key), read_array(file, keys.shutter_key)
        (rows, columns), first = shutter_place(values, patterns, fixed=whole)
        if as_json:
            print(json_module.dumps({"shutter_shift": (rows, columns), "first_slot": first}))
            continue
        print(f"{file}: {name}: shutter displaced by {rows} rows and {columns} columns")
        print(f"  the exposure begins with slot {first}")


@app.command
def movie(
    snapshot: Path,
    /,
    *,
    out: Path,
    frames: Whole = 16,
    decoder: str = "space-time-dct",
    lifetime: float | None = None,
    changing: float | None = None,
    threshold: float | None = None,
    iterations: Whole | None = None,
    motion: float | None = None,
    figure: Figure = None,
    overwrite: Overwrite = False,
) -> None:
    """Frames of a scene that changed during the exposure of SNAPSHOT, a file of `tmca import` or `tmca simulate`.

    Args:
        snapshot: whose aperture does not change from slot to slot.
        out: NetCDF file of frames to write.
        frames: a divisor of the number of slots.
        decoder: space-time-dct (blocks of space and time that are sparse in their cosine transform; any shutter),
            space-time-lmmse (the prior of still scenes, moved), space-time-mixture (parts at rest, or that move by
            what the snapshot says), or kriging (every pixel open within one frame, nothing
            displaced; with a standard deviation).
        lifetime: slots over which the scene changes; without it what predicts the capture's own pixels best (kriging).
        changing: share of the scene's variance that changes during the exposure, 0 to 1; likewise (kriging).
        threshold: of coefficients at the end, relative irradiance; without it half the noise, and 0.5 % of
            the brightest at least (space-time-dct).
        iterations: over which the threshold falls to it, 40 without it (space-time-dct).
        motion: largest displacement within the exposure that is expected, pixels; 4 without it (space-time-lmmse,
            space-time-mixture).
    """
    from tmca.cameras import Snapshot
    from tmca.data import write_dataset
    from tmca.decoders import decode, decoders_for
    from tmca.errors import check_choice

    check_figure(figure, overwrite, snapshot)
    check_targets([out], overwrite, snapshot)
    taken: Snapshot[Any] = Snapshot.load(snapshot)
    check_choice("decoder", decoder, decoders_for("spectral", moving=True))
    given = {
        "lifetime": lifetime, "changing": changing, "threshold": threshold, "iterations": iterations, "motion": motion,
    }  # fmt: skip
    settings: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    with progress_bar(f"{decoder}: {snapshot.name}") as progress:
        estimate = decode(taken, decoder, progress=progress, frames=frames, **settings)
    labelled = frames_of(estimate)
    write_dataset(labelled, out, overwrite=overwrite)
    if figure is not None:
        _draw_movie(taken, labelled, decoder, figure, overwrite)
    about = labelled.attrs
    print(f"{out}: {frames} frames of {about['slots_per_frame']} slots each, {decoder}")
    if "scene_lifetime" in about:
        share = f"{about['scene_changing']:.1%} of its variance within {about['scene_lifetime']:g} slots"
        print(f"  the scene changes over {about['scene_length']:g} pixels, {share}")


def _draw_movie(taken: Snapshot[Any], labelled: xr.Dataset, decoder: str, figure: Path, overwrite: bool) -> None:
    """Draw the frames, eight of them at most, beside the snapshot."""
    from tmca.plots import frames_figure, save_figure

    values, pictures = taken.values[0, 0].numpy(), labelled["frames"].values.mean(1)
    drawing = frames_figure({decoder: pictures}, {decoder: values}, shown=min(len(pictures), 8))
    save_figure(drawing, figure, overwrite=overwrite)


def frames_of(estimate: Estimate) -> xr.Dataset:
    """``frames`` (frame, wavelength, y, x) of a scene that changes, ``frames_std`` where the decoder knows their
    standard deviation, and the first slot of each."""
    labelled = estimate.to_xarray()
    names = {"estimate": "frames", "deviation": "frames_std", "slot": "frame"}
    labelled = labelled.rename({old: new for old, new in names.items() if old in labelled or old in labelled.dims})
    slots = estimate.camera.slots // labelled.sizes["frame"]
    first = ("frame", [slots * frame for frame in range(labelled.sizes["frame"])])
    return labelled.assign_coords(first_slot=first).assign_attrs(slots_per_frame=slots)


@app.command
def report(
    *,
    data: Path,
    out: Path,
    weights: Path = Path("universal"),
    decoders: str = "admm-tv,pnp,network",
    control: list[str] | None = None,
    keep: Path = Path("real-estimates"),
    overwrite: Overwrite = False,
) -> None:
    """Decode and judge the public captures of TSA-Net and of the shuffled rolling shutter: a page, JSON and pictures.

    Args:
        data: folder that holds tsa/ and pixel_shutter_wine/, or the one above.
        out: page to write, without suffix.
        weights: of network, which starts from admm-tv and adapts: a run, or weights that come with tmca.
        decoders: some of admm-tv, pnp, network, separated by commas.
        control: scenes that are known (files, or names of rendered ones), imaged behind the same mask, to hold the
            merit against the truth.
        keep: folder of estimates, which the next report uses again where their input is the same.
    """
    from tmca.cli.studies import study_module

    names = [name.strip() for name in decoders.split(",") if name.strip()]
    command = ["tmca", *sys.argv[1:]]
    files = study_module("real.report").write_report(
        data, out, names, weights, keep, command, control=control or (), overwrite=overwrite, told=warned
    )
    print(f"{files[1]}: {', '.join(file.name for file in files[2:])} beside it")
