"""The spectral-depth part of the demonstration: a rendered scene with depth through two cameras and back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.cameras import SpectralDepthCamera
from tmca.data.depth_scenes import load_spectral_depth
from tmca.data.fitting import middle_of
from tmca.experiments.camera_figures import psf_figure
from tmca.experiments.reconstructions import Reconstruction
from tmca.experiments.report import Section
from tmca.experiments.results import DEPTH_METRICS
from tmca.experiments.spectral_depth.imaging import (
    reading_range,
    reconstruct_spectral_depth,
    reconstruction_picture,
    take_spectral_depth_snapshot,
)
from tmca.plots.style import save_figure
from tmca.priors import GaussianPrior, block_of, find_prior
from tmca.sensor import Sensor

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

SCENE, WINDOW = "motorcycle", 12
_STATIC, _MULTIPLEXED = "phase mask alone", "one-hot shutter, K = 4"
CODES: dict[str, dict[str, Any]] = {
    _STATIC: {"slots": 1, "shutter": "open"},
    _MULTIPLEXED: {"slots": 4, "shutter": "one-hot"},
}
READ_NOISE, _REDUCE = 2e-3, 3
COLUMNS = (
    ("code", "code", ""),
    *DEPTH_METRICS,
    ("psnr", "PSNR (dB)", ".2f"),
    ("sam", "SAM (°)", ".2f"),
    ("throughput", "light", ".1%"),
    ("seconds", "s", ".1f"),
)


def demo_spectral_depth(
    out: Path, size: tuple[int, int], overwrite: bool, told: Callable[[float, str], None]
) -> tuple[list[dict[str, Any]], Section]:
    """Take and reconstruct snapshots of a rendered scene with depth; files and pictures go to ``out``.

    Args:
        out: folder that exists.
        size: (H, W) of the scene, pixels.
        overwrite: replace earlier results.
        told: share of this part that is done, and what is next.

    Returns:
        Rows of the table, one for each code, and the report's section.
    """
    told(0.0, "a scene with depth")
    cameras = {
        code: SpectralDepthCamera.from_preset(
            "quick", size=size, filters="clear", sensor=Sensor(read_noise=READ_NOISE), **settings
        )
        for code, settings in CODES.items()
    }
    first = cameras[_STATIC]
    scene = load_spectral_depth(SCENE, **reading_range(first), reduce=_REDUCE)
    truth = middle_of(scene, size, SCENE)
    told(0.1, "the prior of rendered scenes at these bands")
    prior = find_prior(first, block=block_of(first, window=WINDOW))
    found: dict[str, Reconstruction] = {}
    for place, (code, camera) in enumerate(cameras.items()):
        told(0.4 + 0.25 * place, f"spectrum and depth, {code}")
        found[code] = _through(camera, truth, prior, out, overwrite)
    told(0.9, "pictures of spectrum and depth")
    rows = [
        {"code": code, **result.metrics, "throughput": cameras[code].throughput(), "seconds": result.seconds}
        for code, result in found.items()
    ]
    return rows, _section(rows, _figures(found, cameras, truth, out, overwrite))


def _through(
    camera: SpectralDepthCamera, truth: xr.Dataset, prior: GaussianPrior, out: Path, overwrite: bool
) -> Reconstruction:
    stem = f"spectral_depth_{'static' if camera.slots == 1 else 'onehot4'}"
    snapshot = take_spectral_depth_snapshot(truth, camera)
    snapshot.save(out / f"{stem}_snapshot.nc", overwrite=overwrite)
    found = reconstruct_spectral_depth(snapshot, prior=prior, window=WINDOW, truth=truth)
    found.save(out / f"{stem}_likelihood.nc", overwrite=overwrite)
    return found


def _figures(
    found: Mapping[str, Reconstruction],
    cameras: Mapping[str, SpectralDepthCamera],
    truth: xr.Dataset,
    out: Path,
    overwrite: bool,
) -> dict[str, Figure]:
    """Pictures by their captions, kept as files too."""
    caption = "Colours, depth in metres, probability within a bin, and spectra: {}; the truth above."
    figures = {
        caption.format(code): reconstruction_picture(result, cameras[code].planes, truth)
        for code, result in found.items()
    }
    figures["Point spread functions of the four slots over depth, and what points leave behind the shutter."] = (
        psf_figure(cameras[_MULTIPLEXED])
    )
    for figure, ending in zip(figures.values(), ("static", "onehot4", "psf"), strict=True):
        save_figure(figure, out / f"spectral_depth_{ending}.png", overwrite=overwrite)
    return figures


def _section(rows: list[dict[str, Any]], figures: dict[str, Figure]) -> Section:
    static, multiplexed = (row["depth_mae"] for row in rows)
    return Section(
        f"Spectrum and depth: {SCENE}",
        text=(
            "A random phase mask in the aperture blurs every depth and wavelength in its own way. It was still during "
            "the exposure, or showed four masks, of which every pixel saw one, at equal exposure time and with read "
            f"noise σ = {READ_NOISE:g} of one band. Depth is the median over planes, each as probable as it explains "
            "the windows around a pixel under a Gaussian prior of other rendered scenes; the spectrum is the mean of "
            f"the linear estimates at likely planes. Time multiplexing changed the mean depth error from {static:.2f} "
            f"to {multiplexed:.2f} m. tmca design spectral-depth searches masks for a bench and a sensor.",
        ),
        table=rows,
        columns=COLUMNS,
        figures=figures,
    )
