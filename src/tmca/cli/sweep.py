"""``tmca sweep``: every combination of some settings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from tmca.cli.cameras import READING, scenes_of
from tmca.cli.options.grid import DepthScenes, GridOptions
from tmca.cli.options.numbers import Whole, size
from tmca.cli.options.output import say
from tmca.cli.progress import cell_done
from tmca.errors import SettingError
from tmca.specs import MeasuredReading

app = App(name="sweep", help="Every combination of some settings, over test scenes.")
_GRID, _VIEWS, _DEPTH = GridOptions(), MeasuredReading(), DepthScenes()


@app.command
def spectral(
    *scenes: str,
    vary: list[str],
    out: Path = Path("sweep"),
    work: Path = Path("runs/sweep-spectral"),
    test: Path | None = None,
    train: Path | None = None,
    validation: Path | None = None,
    decoder: str = "lmmse",
    set_: Annotated[list[str] | None, Parameter(name="--set")] = None,
    steps: Whole = 300,
    bands: Whole = 12,
    crop: str | None = None,
    grid: GridOptions = _GRID,
) -> None:
    """Sweep settings of the spectral camera over SCENES: `--vary noise=0,0.01,0.1 --vary slots=2,4,8`.

    Writes OUT.json, OUT.csv, OUT.md and OUT.png. Finished cells are kept in --work: a run that was stopped goes on.

    Args:
        scenes: cubes or rendered scenes to measure on; the rendered test scenes without any.
        vary: NAME=VALUE,VALUE,… given several times; NAME: noise (read noise), full_well, read_noise_electrons, bits,
            slots, aperture, shutter, buckets, exposure, dispersion, disperser, transmittance, duty, period, decoder,
            seed, a setting of the decoder (decoder.tv_weight, …; `tmca decoders`), or a fault of the bench that
            decoders are not told of: misregistration, delay, … (docs/hardware.md).
        out: results, without a suffix.
        work: folder of finished cells.
        test: split file of scenes to add.
        train: split file of the scenes that teach priors and networks; the rendered scenes' prior without it.
        validation: split file of the scenes that choose a network's best step; some of --train without it.
        decoder: one that `tmca decoders` lists for the camera, your own as FILE.py:Class or FILE.pt2, or a network
            trained at every combination: unet-thesis, unet, unrolled.
        set_: NAME=VALUE of the same names for all cells.
        steps: of each training.
        bands: bands, nearest to even spacing from 400 to 700 nm.
        crop: HEIGHTxWIDTH, the middle of the scenes.
    """
    from tmca.data import split_rendered

    named = scenes_of(scenes, test) or sorted(split_rendered()["test"])
    reading = {"bands": bands, "size": size(crop, "--crop")}
    _run("spectral", vary, set_, named, out, work, grid, reading=reading, decoder=decoder, train=scenes_of((), train),
         validation=scenes_of((), validation), steps=steps)  # fmt: skip


@app.command
def light_field(
    *scenes: str,
    vary: list[str],
    out: Path = Path("sweep"),
    work: Path = Path("runs/sweep-light-field"),
    test: Path | None = None,
    train: Path | None = None,
    decoder: str = "lmmse",
    set_: Annotated[list[str] | None, Parameter(name="--set")] = None,
    reading: Annotated[MeasuredReading, READING] = _VIEWS,
    crop: str | None = None,
    grid: GridOptions = _GRID,
) -> None:
    """Sweep settings of the light-field camera over SCENES: `--vary noise=0.01,0.1 --set slots=8 --set design=free`.

    Writes OUT.json, OUT.csv, OUT.md and OUT.png. Finished cells are kept in --work: a run that was stopped goes on.

    Args:
        scenes: light fields to measure on: folders, files, or rendered ones; the rendered test scenes without any.
        vary: NAME=VALUE,VALUE,… given several times; NAME: noise (read noise), full_well, read_noise_electrons, bits,
            slots, aperture, shutter, buckets, exposure, shear, transmittance, duty, period, decoder, seed, or design:
            codes searched for every combination (free, one-hot, static, …), or a fault of the bench that decoders are
            not told of: misregistration, delay, … (docs/hardware.md).
        out: results, without a suffix.
        work: folder of priors, designs and finished cells.
        test: split file of light fields to add.
        train: split file of the light fields that teach priors and designs; rendered ones without it.
        decoder: one that `tmca decoders` lists for the camera; no network.
        set_: NAME=VALUE of the same names for all cells.
        crop: HEIGHTxWIDTH, the middle of the light fields.
    """
    from tmca.data import split_rendered_light_fields

    named = scenes_of(scenes, test) or sorted(split_rendered_light_fields()["test"])
    asked = {**reading.model_dump(), "size": size(crop, "--crop")}
    _run("light-field", vary, set_, named, out, work, grid, reading=asked, decoder=decoder, train=scenes_of((), train))


@app.command
def spectral_depth(
    *scenes: str,
    vary: list[str],
    out: Path = Path("sweep"),
    work: Path = Path("runs/sweep-spectral-depth"),
    test: list[str] | None = None,
    train: list[str] | None = None,
    decoder: str = "likelihood",
    set_: Annotated[list[str] | None, Parameter(name="--set")] = None,
    depth: DepthScenes = _DEPTH,
    grid: GridOptions = _GRID,
) -> None:
    """Sweep settings of the spectral-depth camera over SCENES: `--vary contrast=0,0.1,1 --vary slots=1,4`.

    Depth and spectrum are those of the patch likelihood. Writes OUT.json, OUT.csv, OUT.md and OUT.png. Finished cells
    are kept in --work: a run that was stopped goes on.

    Args:
        scenes: scenes with depth, RGB-D scenes, cubes, rendered scenes, or split files (.txt) of them; the rendered
            test scenes without any.
        vary: NAME=VALUE,VALUE,… given several times; NAME: noise (read noise), full_well, read_noise_electrons, bits,
            slots, mask, rms (metres), modes, shutter, buckets, filters, channels, planes, exposure, image_formation,
            period, seed, contrast of the scenes' texture (0 to 1), codes: files of `tmca design spectral-depth`, or a
            fault of the bench that decoders are not told of: height_error, delay, … (docs/hardware.md).
        out: results, without a suffix.
        work: folder of the prior and finished cells.
        test: more of them.
        train: scenes or split files that teach the prior; that of the rendered scenes without any.
        decoder: one that `tmca decoders` lists for the camera.
        set_: NAME=VALUE of the same names for all cells.
    """
    from tmca.data import split_rendered
    from tmca.data.scene_names import named_scenes

    named = named_scenes([*scenes, *(test or ())]) or sorted(split_rendered()["test"])
    _run("spectral-depth", vary, set_, named, out, work, grid, reading=depth.reading(), decoder=decoder,
         train=named_scenes(train or ()))  # fmt: skip


@app.default
def any_camera(
    kind: str | None = None,
    /,
    *scenes: str,
    vary: list[str] | None = None,
    out: Path = Path("sweep"),
    work: Path = Path("runs/sweep"),
    train: list[str] | None = None,
    decoder: str | None = None,
    set_: Annotated[list[str] | None, Parameter(name="--set")] = None,
    crop: str | None = None,
    grid: GridOptions = _GRID,
) -> None:
    """Sweep settings of a camera of KIND, which has no command of its own, over SCENES.

    Writes OUT.json, OUT.csv, OUT.md and OUT.png. Finished cells are kept in --work: a run that was stopped goes on.

    Args:
        kind: of a camera without a command of its own, such as one of another package.
        scenes: that are measured.
        vary: NAME=VALUE,VALUE,… given several times; NAME: noise (read noise), full_well, read_noise_electrons, bits,
            decoder, a setting of the decoder (decoder.NAME), or a number or word that the camera's constructor takes.
        out: results, without a suffix.
        work: folder of finished cells.
        train: scenes that teach the prior.
        decoder: one that `tmca decoders` lists for the camera; the usual one without it.
        set_: NAME=VALUE of the same names for all cells.
        crop: HEIGHTxWIDTH, the middle of the scenes.
    """
    from tmca.applications import application_of

    if kind is None:
        from tmca.cli.app import app as whole

        whole.help_print(["sweep"])
        return
    if not scenes:
        raise SettingError(f"sweep {kind}", "no scenes", "names or files of scenes")
    used = decoder or application_of(kind).default_decoder
    _run(kind, vary or (), set_, scenes, out, work, grid, reading={"size": size(crop, "--crop")}, decoder=used,
         train=train or ())  # fmt: skip


def _run(
    camera: str, vary: Sequence[str], fixed: Sequence[str] | None, scenes: Sequence[str], out: Path, work: Path,
    grid: GridOptions, **how: Any,
) -> None:  # fmt: skip
    """Sweep, and print the page."""
    from tmca.evaluation.sweep import Sweep, run_sweep
    from tmca.lab.decoder_files import decoder_named, names_of

    axes, settled = named_values(vary, "--vary"), one_value(fixed)
    how["decoder"] = decoder_named(how["decoder"])
    if "decoder" in axes:
        axes["decoder"] = [*names_of(axes["decoder"], "--vary decoder").values()]
    if "decoder" in settled:
        settled["decoder"] = decoder_named(settled["decoder"], "--set decoder")
    found = run_sweep(Sweep(camera, axes, scenes, fixed=settled, **how), out, work, progress=cell_done, **grid.how())
    say(found, grid.json, out.with_suffix(".md").read_text(), markdown=grid.markdown)


def one_value(texts: Sequence[str] | None, option: str = "--set", example: str = "slots=4") -> dict[str, str]:
    """Name → value of the NAME=VALUE texts of an option.

    Raises:
        SettingError: a text of another form, or a name twice.
    """
    found: dict[str, str] = {}
    for text in texts or ():
        name, _, value = (part.strip() for part in text.partition("="))
        if not name or not value:
            raise SettingError(option, repr(text), f"NAME=VALUE, such as {example}")
        if name in found:
            raise SettingError(option, f"{name} twice", "one value of each name", "leave one out")
        found[name] = value
    return found


def named_values(texts: Sequence[str], option: str) -> dict[str, list[str]]:
    """Name → values of NAME=VALUE,VALUE texts.

    Raises:
        SettingError: a text of another form, or a name twice.
    """
    found: dict[str, list[str]] = {}
    for text in texts:
        name, sign, values = text.partition("=")
        parts = [value.strip() for value in values.split(",") if value.strip()]
        if not sign or not name.strip() or not parts:
            raise SettingError(option, repr(text), "NAME=VALUE,VALUE, such as slots=2,4,8")
        if name.strip() in found:
            raise SettingError(option, f"{name.strip()} twice", "all its values in one list")
        found[name.strip()] = parts
    return found
