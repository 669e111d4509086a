"""The spectral camera's main job: scene → snapshot → reconstruction, with files, metrics and pictures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tmca.cameras import Snapshot, SpectralCamera
from tmca.data.fitting import middle_of
from tmca.data.scenes import load_scene
from tmca.errors import DataError, SettingError
from tmca.experiments.reconstructions import Reconstruction, decoded
from tmca.plots.cube import reconstruction_figure
from tmca.plots.style import save_figure

if TYPE_CHECKING:
    import xarray as xr


def reconstruct_snapshot(
    snapshot: Snapshot[SpectralCamera],
    decoder: str = "lmmse",
    *,
    truth: xr.DataArray | None = None,
    progress: Callable[..., None] | None = None,
    **how: Any,
) -> Reconstruction:
    """Recover the scene of a snapshot.

    Args:
        snapshot: with its camera.
        decoder: one of ``tmca.decoders.decoders_for("spectral")``.
        truth: (wavelength, y, x) for metrics.
        progress: called with the share that is done and, while a prior is learned, what is done next.
        how: ``prior`` (a prior, its file, or None for the rendered scenes') and settings of the decoder.
    """
    from tmca.metrics import all_metrics

    estimate = decoded(snapshot, decoder, progress=progress, **how)
    metrics = {} if truth is None else all_metrics(estimate.values[0].numpy(), truth.values)
    return Reconstruction.of(estimate, metrics)


def true_scene(source: str, snapshot: Snapshot[SpectralCamera], **reading: Any) -> xr.DataArray:
    """The scene of a snapshot, brought to the camera's bands and size; ``reading`` goes to ``load_scene``.

    Raises:
        DataError: it is smaller than the snapshot's scene.
    """
    from tmca.data import nearest_bands

    cube = load_scene(source, bands=None, **reading)
    cube = nearest_bands(cube, snapshot.camera.wavelengths)
    height, width = snapshot.camera.size
    if cube.shape[1] < height or cube.shape[2] < width:
        raise DataError(source, f"{cube.shape[1]}×{cube.shape[2]} pixels", f"at least the snapshot's {height}×{width}")
    return middle_of(cube, (height, width), source)


def reconstruction_files(path: Path, figures: bool) -> list[Path]:
    """What `reconstruction_pictures` and the reconstruction itself will be called."""
    return [path, path.with_suffix(".png")] if figures else [path]


def reconstruction_pictures(
    result: Reconstruction, path: Path, *, truth: xr.DataArray | None = None, overwrite: bool = False
) -> list[Path]:
    """Composite, error and uncertainty maps and spectra as PNG beside a reconstruction file."""
    deviations = {} if result.deviation is None else {result.decoder: result.deviation.values}
    figure = reconstruction_figure(
        {result.decoder: result.cube.values},
        result.cube["wavelength"].values.tolist(),
        None if truth is None else truth.values,
        deviations,
    )
    return [save_figure(figure, reconstruction_files(path, figures=True)[1], overwrite=overwrite)]


def evaluate_files(
    estimate: str | Path,
    truth: str,
    *,
    figure: Path | None = None,
    overwrite: bool = False,
    told: Callable[[xr.DataArray], None] | None = None,
    **reading: Any,
) -> dict[str, float]:
    """Metrics of one cube file against another; bands matched by wavelength, a larger truth cropped to its middle.

    ``reading`` goes to ``load_scene`` for the truth, which ``told`` is then shown. The estimate is taken as it is
    stored, floats never rescaled.

    Raises:
        DataError: the truth is smaller than the estimate, or has fewer bands.
    """
    from tmca.metrics import all_metrics

    if figure is not None and Path(estimate).resolve() == figure.resolve():
        raise SettingError("--figure", str(figure), "another file than the estimate")
    cube, reference = _pair_of(estimate, truth, reading, told)
    found = all_metrics(cube.values, reference.values)
    if figure is not None:
        drawing = reconstruction_figure(
            {Path(estimate).stem: cube.values}, cube["wavelength"].values.tolist(), reference.values
        )
        save_figure(drawing, figure, overwrite=overwrite)
    return found


def _pair_of(
    estimate: str | Path, truth: str, reading: dict[str, Any], told: Callable[[xr.DataArray], None] | None
) -> tuple[xr.DataArray, xr.DataArray]:
    """Estimate and truth at the estimate's bands and size."""
    from tmca.data import nearest_bands

    cube = _estimate(estimate, reading)
    if "scale_from" in cube.attrs and cube.attrs["scale_from"] == "maximum":
        cube = cube * cube.attrs["scale"]
    whole = load_scene(truth, bands=None, **reading)
    if cube.sizes["wavelength"] > whole.sizes["wavelength"]:
        found = f"{whole.sizes['wavelength']} bands"
        raise DataError(truth, found, f"at least the {cube.sizes['wavelength']} of {estimate}", "swap the two files?")
    if cube.sizes["y"] > whole.sizes["y"] or cube.sizes["x"] > whole.sizes["x"]:
        found = f"{whole.sizes['y']}×{whole.sizes['x']} pixels"
        wanted = f"at least the {cube.sizes['y']}×{cube.sizes['x']} of {estimate}"
        raise DataError(truth, found, wanted, "swap the two files, or crop the estimate")
    if told:
        told(whole)
    reference = nearest_bands(whole, cube["wavelength"].values)
    return cube, middle_of(reference, (cube.shape[1], cube.shape[2]), truth)


def _estimate(path: str | Path, reading: dict[str, Any]) -> xr.DataArray:
    """An estimate's file; wavelengths of the command line where it has none itself."""
    from tmca.data import Negative, read

    negative: Negative = "clip" if reading.get("negative") == "clip" else "keep"
    try:
        return read(path, negative=negative)
    except DataError:
        if reading.get("wavelengths") is None:
            raise
        return read(path, wavelengths=reading["wavelengths"], negative=negative)
