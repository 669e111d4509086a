"""Priors as files: learned of cubes or light fields, drawn, asked for the expected error of a camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.cameras import Snapshot, camera_of
from tmca.data import check_target
from tmca.data.fitting import at_bands
from tmca.data.scenes import load_scene
from tmca.decoders.likelihood import usual_window
from tmca.errors import SettingError
from tmca.operators.window_moments import needed_block
from tmca.plots.style import save_figure
from tmca.priors import GaussianPrior, Prior, SubspacePrior, expected_psnr, learn_prior
from tmca.specs import SensorSpec, SpectralSpec

if TYPE_CHECKING:
    import xarray as xr

_FRAME = 128
_OPTIONS = {"mixture": "mixture", SubspacePrior.kind: "any-bands"}
Report = Callable[[float, str], None]
"""Called with the share that is done and what is done."""
Read = Callable[[str], "xr.DataArray"]


def cube_reader(
    bands: int | None, extent: int | None, like: Path | None, reading: Mapping[str, Any], kind: str = "gaussian"
) -> tuple[Read, dict[str, Any]]:
    """What reads the cubes of a prior, and its settings.

    Args:
        bands: nearest to even spacing from 400 to 700 nm; all if None, and for a prior of any bands.
        extent: pixels between the first and the last band on the sensor; one per band if None, 54 for any bands.
        like: a snapshot of the spectral-depth camera, whose bands and block the prior gets.
        reading: further arguments of ``load_scene``.
        kind: of the prior.

    Raises:
        SettingError: ``like`` beside what it decides.
    """
    any_bands = kind == SubspacePrior.kind
    if extent is not None and extent < 0:
        raise SettingError("--spread", str(extent), "0 pixels or more")
    wavelengths, block = (None, None) if like is None else _needed(like, kind, extent)

    def read(source: str) -> xr.DataArray:
        cube = load_scene(source, bands=None if wavelengths or any_bands else bands, **reading)
        return at_bands(cube, wavelengths) if wavelengths else cube

    return read, {"extent": extent, "block": block}


def _needed(like: Path, kind: str, extent: int | None) -> tuple[tuple[float, ...], tuple[int, int]]:
    """Wavelengths and block (rows, columns) of the prior that a snapshot's camera needs."""
    for name, given in ((f"--{_OPTIONS.get(kind)}", kind in _OPTIONS), ("--spread", extent is not None)):
        if given:
            raise SettingError(name, "given beside --like", "one of them", "leave it out")
    camera = Snapshot.load(like).camera
    if camera.psf_window is None:
        raise SettingError("--like", f"a {camera.kind} snapshot", "one of the spectral-depth camera")
    return camera.wavelengths, needed_block(usual_window(camera), camera.psf_window)


def write_prior(
    names: Sequence[str],
    read: Read,
    out: Path,
    kind: str,
    settings: Mapping[str, Any],
    *,
    seed: int = 0,
    figure: Path | None = None,
    overwrite: bool = False,
    progress: Report | None = None,
) -> Prior:
    """Learn a prior of some scenes, and write it with its picture.

    Args:
        names: of the scenes.
        read: reads one.
        out: file to write.
        kind: of the prior.
        settings: arguments of ``learn_prior``; an ``extent`` that is None is one pixel per band, 54 for any bands.
        seed: of the blocks or patches that are drawn.
        figure: PNG to write.
        overwrite: replace files.
        progress: called with the share that is done and what is done.

    Raises:
        SettingError: no scenes.
        OutputError: a file exists.
    """
    if not names:
        raise SettingError("prior", "no scenes", "files, rendered scenes or --split")
    for file in (out, figure):
        if file is not None:
            check_target(file, overwrite)
    report, scenes = progress or (lambda share, step: None), []
    for index, name in enumerate(names):
        report(0.3 * index / len(names), f"reading {name}")
        scenes.append(read(name))
    report(0.3, f"learning the {kind} prior" if kind != "dictionary" else "learning the dictionary")
    how: dict[str, Any] = {"seed": seed, **settings}
    if "extent" in how and how["extent"] is None and kind != SubspacePrior.kind:
        how["extent"] = scenes[0].sizes["wavelength"] - 1
    if kind == "dictionary":
        how["progress"] = lambda share: report(0.3 + 0.7 * share, "learning the dictionary")
    prior = learn_prior(scenes, None, kind, **how)
    prior.save(out, overwrite=overwrite)
    if figure is not None:
        save_figure(prior.figure(), figure, overwrite=overwrite)
    return prior


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
