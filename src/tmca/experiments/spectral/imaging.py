"""The spectral camera's main job: scene → snapshot → reconstruction, with files, metrics and pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from tmca.cameras import Hardware, Snapshot, SpectralCamera, imperfect, moving_scene
from tmca.data.scenes import centre_crop, load_scene
from tmca.errors import DataError, SettingError
from tmca.experiments.reconstructions import Reconstruction, decoded
from tmca.experiments.snapshots import NOISE_STREAM
from tmca.plots.cube import reconstruction_figure
from tmca.plots.style import save_figure

if TYPE_CHECKING:
    import xarray as xr


def take_snapshot(
    cube: xr.DataArray | Sequence[xr.DataArray],
    camera: SpectralCamera,
    seed: int = 0,
    motion: tuple[float, float] = (0.0, 0.0),
    hardware: Hardware | None = None,
) -> Snapshot[SpectralCamera]:
    """Image a scene.

    Args:
        cube: (wavelength, y, x), or one such cube per slot.
        camera: of its bands and size.
        seed: of the sensor's noise, whose stream no code shares.
        motion: rows and columns by which the scene moves from the beginning to the end of the exposure, pixels; the
            cube is its place in the middle.
        hardware: faults of the bench that takes it; the snapshot's camera is the one that is known.

    Raises:
        SettingError: faults that this camera cannot have, or another number of cubes than slots, or several that move.
    """
    cubes = list(cube) if isinstance(cube, Sequence) else [cube]
    scenes = [torch.from_numpy(np.ascontiguousarray(one.values, dtype=np.float32)) for one in cubes]
    if len(scenes) > 1 and len(scenes) != camera.slots:
        raise SettingError("scenes", f"{len(scenes)}", f"one, or one for each of {camera.slots} slots")
    scene = torch.stack(scenes) if len(scenes) > 1 else scenes[0]
    notes = {"scene": str(cubes[0].attrs.get("name", "")), "noise_seed": seed}
    faults = hardware or Hardware()
    motion = motion if any(motion) else faults.movement
    if any(motion) and len(scenes) > 1:
        found = f"{motion[0]:g},{motion[1]:g} of {len(scenes)} scenes"
        raise SettingError("motion", found, "one scene that moves, or one for each slot, at rest in it")
    if any(motion):
        scene, notes["motion_pixels"] = moving_scene(scene, motion, camera.slots), list(motion)
    with torch.no_grad():
        values = imperfect(camera, faults, seed)(scene[None], generator=NOISE_STREAM + seed)
    if faults.faults():
        notes["hardware"] = faults.described()
    return Snapshot(values, camera, notes)


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
    return centre_crop(cube, (height, width), source)


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
    return cube, centre_crop(reference, (cube.shape[1], cube.shape[2]), truth)


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
