"""Priors as files: learned of cubes or light fields, drawn, asked for the expected error of a camera."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.cameras import Snapshot, camera_of
from tmca.data.fitting import at_bands
from tmca.data.light_field_scenes import NOTHING, Reading, check_asked, load_light_field
from tmca.data.scenes import load_scene
from tmca.decoders.likelihood import usual_window
from tmca.errors import OutputError, SettingError
from tmca.operators.window_moments import needed_block
from tmca.plots.style import save_figure
from tmca.priors import GaussianPrior, Prior, expected_psnr, learn_prior
from tmca.specs import SensorSpec, SpectralSpec

if TYPE_CHECKING:
    import xarray as xr

_FRAME = 128
Report = Callable[[float, str], None]
"""Called with the share that is done and what is done."""


def learn_to_file(
    scenes: Sequence[str],
    out: Path,
    *,
    mixture: bool = False,
    split: Path | None = None,
    bands: int | None = 12,
    extent: int | None = None,
    like: Path | None = None,
    reading: dict[str, Any] | None = None,
    figure: Path | None = None,
    overwrite: bool = False,
    seed: int = 0,
    progress: Report | None = None,
) -> Prior:
    """Learn a prior from files, rendered scenes or a split, and write it with its picture.

    ``like`` is a snapshot of the spectral-depth camera, whose bands and block the prior gets.

    Raises:
        SettingError: no scenes, or ``like`` beside what it decides.
        OutputError: a file exists.
    """
    from tmca.data import read_split

    for file in (out, figure):
        if file is not None and file.exists() and not overwrite:
            raise OutputError(file, "an existing file", "a new name", "pass --overwrite")
    sources = [*scenes, *(map(str, read_split(split)) if split else ())]
    if not sources:
        raise SettingError("prior learn", "no scenes", "cube files, rendered scenes or --split")
    if extent is not None and extent < 0:
        raise SettingError("--spread", str(extent), "0 pixels or more")
    wavelengths, block = (None, None) if like is None else _needed(like, mixture, extent)
    cubes, report = [], progress or (lambda share, step: None)
    for index, source in enumerate(sources):
        report(0.5 * index / len(sources), f"reading {source}")
        cube = load_scene(source, bands=None if wavelengths else bands, **(reading or {}))
        cubes.append(at_bands(cube, wavelengths) if wavelengths else cube)
    report(0.5, f"learning the {'mixture ' if mixture else ''}prior")
    wide = cubes[0].sizes["wavelength"] - 1 if extent is None else extent
    kind = "mixture" if mixture else "gaussian"
    prior = learn_prior(cubes, None, kind, extent=wide, block=block, seed=seed)
    prior.save(out, overwrite=overwrite)
    if figure is not None:
        save_figure(prior.figure(), figure, overwrite=overwrite)
    return prior


def _needed(like: Path, mixture: bool, extent: int | None) -> tuple[tuple[float, ...], tuple[int, int]]:
    """Wavelengths and block (rows, columns) of the prior that a snapshot's camera needs."""
    for name, given in (("--mixture", mixture), ("--spread", extent is not None)):
        if given:
            raise SettingError(name, "given beside --like", "one of them", "leave it out")
    camera = Snapshot.load(like).camera
    if camera.psf_window is None:
        raise SettingError("--like", f"a {camera.kind} snapshot", "one of the spectral-depth camera")
    return camera.wavelengths, needed_block(usual_window(camera), camera.psf_window)


def learn_views_to_file(
    sources: Sequence[str],
    out: Path,
    *,
    split: Path | None = None,
    views: int = 5,
    reading: Reading = NOTHING,
    kind: str = "gaussian",
    atoms: int = 1024,
    seed: int = 0,
    figure: Path | None = None,
    overwrite: bool = False,
    progress: Report | None = None,
) -> Prior:
    """Learn a prior or a dictionary of light fields, and write it with its picture.

    Args:
        sources: what ``load_light_field`` reads.
        out: file to write.
        split: a split file whose light fields are added.
        views: n for the centre n×n views.
        reading: of those from files.
        kind: ``"gaussian"``, ``"mixture"`` (of Gaussians) or ``"dictionary"``.
        atoms: of the dictionary.
        seed: of the patches that a dictionary or a mixture learns from.
        figure: PNG to write.
        overwrite: replace files.
        progress: called with the share that is done and what is done.

    Raises:
        SettingError: no light fields, an unknown kind, or a reading that applies to none of them.
        OutputError: a file exists.
    """
    from tmca.data import check_target, read_split

    for file in (out, figure):
        if file is not None:
            check_target(file, overwrite)
    if kind not in ("gaussian", "mixture", "dictionary"):
        raise SettingError("kind", repr(kind), "gaussian, mixture or dictionary")
    names = [*sources, *(map(str, read_split(split)) if split else ())]
    if not names:
        raise SettingError("prior learn-views", "no light fields", "folders, files, rendered scenes or --split")
    check_asked(names, **vars(reading))
    report = progress or (lambda share, step: None)
    fields = _read(names, views, reading, report)
    report(0.3, f"learning the {'dictionary' if kind == 'dictionary' else 'prior'}")
    settings: dict[str, Any] = {}
    if kind == "dictionary":
        settings = {"atoms": atoms, "progress": lambda share: report(0.3 + 0.7 * share, "learning the dictionary")}
    prior = learn_prior(fields, None, kind, seed=seed, **settings)
    prior.save(out, overwrite=overwrite)
    if figure is not None:
        save_figure(prior.figure(), figure, overwrite=overwrite)
    return prior


def _read(names: Sequence[str], views: int, reading: Reading, report: Report) -> list[xr.DataArray]:
    fields = []
    for index, name in enumerate(names):
        report(0.3 * index / len(names), f"reading {name}")
        fields.append(load_light_field(name, views=views, **reading.of(name)))
    return fields


def expected(prior: Path, spec: SpectralSpec, sensor: SensorSpec) -> dict[str, float]:
    """Expected PSNR and light throughput of a camera under a prior, mean over blocks of a 128-pixel frame.

    Raises:
        DataError: a file without a Gaussian prior.
        SettingError: unknown preset, or relay blur.
    """
    known = GaussianPrior.load(prior)
    size = (max(_FRAME, known.block[1]), max(_FRAME, known.block[2]))
    camera = camera_of(spec, sensor, bands=known.wavelengths or known.block[0], size=size)
    noise = camera.noise
    value = expected_psnr(known, camera.taps(), noise)
    return {"expected_psnr": value, "throughput": camera.throughput(), "read_noise": noise.read, "shot": noise.shot}
