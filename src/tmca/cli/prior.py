"""``tmca prior``: learn a prior, look at it, and judge a code by it before anything is captured."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from tmca.cli.cameras import CAMERA, READING, SENSOR, scenes_of
from tmca.cli.options.numbers import MaybeWhole, Whole
from tmca.cli.options.output import Figure, Json, Overwrite, check_figure, say
from tmca.errors import SettingError
from tmca.progress import progress_bar
from tmca.specs import BandsReading, LightFieldsReading, SensorSpec, SpectralSpec

app = App(name="prior", help="Learn, show and judge codes by a Gaussian prior of scene blocks.")
_CAMERA, _SENSOR, _CUBE, _VIEWS = SpectralSpec(), SensorSpec(), BandsReading(), LightFieldsReading()


@app.command
def learn(
    *scenes: str,
    out: Path,
    mixture: bool = False,
    any_bands: bool = False,
    split: Path | None = None,
    bands: Whole = 12,
    all_bands: bool = False,
    extent: Annotated[MaybeWhole, Parameter(name="--spread")] = None,
    like: Path | None = None,
    reading: Annotated[BandsReading, READING] = _CUBE,
    figure: Figure = None,
    overwrite: Overwrite = False,
    seed: Whole = 0,
) -> None:
    """Learn a prior from SCENES: cube files, or names of rendered scenes.

    Args:
        scenes: cubes or rendered scenes.
        out: file to write (NetCDF).
        mixture: a Gaussian mixture instead of one Gaussian.
        any_bands: one Gaussian over wavelength and space from all bands of the files, which serves cameras of any bands
            between the first and the last.
        split: a split file whose scenes are added.
        bands: nearest to even spacing from 400 to 700 nm.
        all_bands: keep every band of the files instead.
        extent: pixels between the first and the last band on the sensor; one per band without it, 54 with --any-bands.
        like: snapshot of the spectral-depth camera, for whose bands and point spread functions the prior is.
        seed: of the random blocks.
    """
    from tmca.applications.prior_files import cube_reader, write_prior

    check_figure(figure, overwrite)
    if any_bands and mixture:
        raise SettingError("prior learn", "--any-bands and --mixture", "one of them", "leave one out")
    kind = "subspace" if any_bands else "mixture" if mixture else "gaussian"
    read, settings = cube_reader(None if all_bands else bands, extent, like, reading.given(), kind)
    names = scenes_of(scenes, split)
    how: dict[str, Any] = {"seed": seed, "figure": figure, "overwrite": overwrite}
    with progress_bar(f"prior {out.name}") as progress:
        prior = write_prior(names, read, out, kind, settings, progress=progress, **how)
    sizes = " × ".join(map(str, prior.block))
    named = {"mixture": "mixture prior", "subspace": "prior of any bands,"}.get(kind, "Gaussian prior")
    print(f"{out}: {named} of blocks {sizes} (bands, rows, columns)")


@app.command
def learn_views(
    *light_fields: str,
    out: Path,
    dictionary: bool = False,
    atoms: Whole = 1024,
    split: Path | None = None,
    mixture: bool = False,
    reading: Annotated[LightFieldsReading, READING] = _VIEWS,
    figure: Figure = None,
    overwrite: Overwrite = False,
    seed: Whole = 0,
) -> None:
    """Learn a prior of LIGHT_FIELDS, or a dictionary of their patches: folders of views, files, or rendered scenes.

    Args:
        light_fields: light fields in grey; rendered ones as coffee, or coffee:3 with the seed of their arrangement.
        out: file to write (NetCDF).
        dictionary: an overcomplete dictionary of 11×11 patches (Marwah 2013) instead of a Gaussian.
        atoms: of the dictionary.
        mixture: a Gaussian mixture instead of one Gaussian.
        split: a split file whose light fields are added.
        seed: of the patches that a dictionary or a mixture learns from.
    """
    from tmca.applications.prior_files import write_prior
    from tmca.data.light_field_scenes import Reading, check_asked, load_light_field

    check_figure(figure, overwrite)
    if dictionary and mixture:
        raise SettingError("prior learn-views", "--dictionary and --mixture", "one of them", "leave one out")
    kind = "dictionary" if dictionary else "mixture" if mixture else "gaussian"
    asked, names = Reading(**reading.files()), scenes_of(light_fields, split)
    check_asked(names, **vars(asked))
    settings = {"atoms": atoms} if dictionary else {}
    how: dict[str, Any] = {"seed": seed, "figure": figure, "overwrite": overwrite}

    def read(name: str) -> Any:
        return load_light_field(name, views=reading.views, **asked.of(name))

    with progress_bar(f"prior {out.name}") as progress:
        learned = write_prior(names, read, out, kind, settings, progress=progress, **how)
    channels, rows, columns = learned.block
    what = {"dictionary": "dictionary of patches", "mixture": "Gaussian mixture of blocks"}
    print(f"{out}: {what.get(kind, 'Gaussian prior of blocks')} {channels} × {rows} × {columns} (views, rows, columns)")


@app.command
def show(prior: Path, /, *, out: Path | None = None, overwrite: Overwrite = False) -> None:
    """Draw PRIOR: leading eigen-blocks, eigenvalues, mean spectrum.

    Args:
        prior: file written by `tmca prior learn`.
        out: PNG to write; the prior's name with .png without it.
    """
    from tmca.applications.file_pictures import picture_of

    print(picture_of(prior, out or prior.with_suffix(".png"), overwrite=overwrite))


@app.command
def expect(
    prior: Path,
    /,
    *,
    camera: Annotated[SpectralSpec, CAMERA] = _CAMERA,
    sensor: Annotated[SensorSpec, SENSOR] = _SENSOR,
    json: Json = False,
) -> None:
    """The error that a code is expected to leave, under PRIOR, before anything is captured.

    Args:
        prior: Gaussian prior file.
    """
    from tmca.applications.prior_files import expected

    found = expected(prior, camera, sensor)
    line = f"expected PSNR {found['expected_psnr']:.2f} dB; light throughput {found['throughput']:.1%}"
    say(found, json, line)
