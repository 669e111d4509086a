"""Priors as files: learned, drawn, asked for the expected error of a camera."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from tmca.cameras import Snapshot, SpectralDepthCamera, camera_of
from tmca.data.fitting import at_bands
from tmca.data.scenes import load_scene
from tmca.decoders.likelihood import usual_window
from tmca.errors import OutputError, SettingError
from tmca.plots.style import save_figure
from tmca.priors import GaussianPrior, Prior, expected_psnr, learn_prior
from tmca.priors.spectral_depth import needed_block
from tmca.specs import SensorSpec, SpectralSpec

_FRAME = 128


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
    progress: Callable[[float, str], None] | None = None,
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
    cubes, told = [], progress or (lambda share, step: None)
    for index, source in enumerate(sources):
        told(0.5 * index / len(sources), f"reading {source}")
        cube = load_scene(source, bands=None if wavelengths else bands, **(reading or {}))
        cubes.append(at_bands(cube, wavelengths) if wavelengths else cube)
    told(0.5, f"learning the {'mixture ' if mixture else ''}prior")
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
    if not isinstance(camera, SpectralDepthCamera):
        raise SettingError("--like", f"a {camera.kind} snapshot", "one of the spectral-depth camera")
    return camera.wavelengths, needed_block(usual_window(camera), camera.bench.window)


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
