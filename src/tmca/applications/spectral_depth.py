"""The spectral-depth camera's application: cubes with a depth for every pixel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from pydantic import Json
from torch import Tensor

from tmca.applications.base import Application, noted_reading
from tmca.applications.camera_figures import psf_figure
from tmca.applications.demo import Demo, Taken, Trial, shipped_trial
from tmca.applications.spectral import METRICS
from tmca.attributes import REMEDY, Attributes, attributes_of
from tmca.cameras import SpectralDepthCamera
from tmca.cameras.sensor_tiles import check_holds
from tmca.data import read_dataset
from tmca.data.depth_maps import UNKNOWN_KINDS, unknown_kinds
from tmca.data.depth_scenes import load_spectral_depth
from tmca.data.fitting import FITTED, METRES, fit_depth_scene, middle_of, said_mapped
from tmca.data.in_memory import as_depth_scene, as_tensors
from tmca.data.point_cloud import FOCAL, FOCAL_OF
from tmca.data.scene_names import READING, compare_source
from tmca.errors import DataError
from tmca.metrics import all_metrics, certainty, depth_mae, depth_rmse, within_bin
from tmca.optics import DepthPlanes, check_mask
from tmca.plots.estimates import estimate_figure
from tmca.sensor import Sensor

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from tmca.cameras import Snapshot

DEPTH_METRICS = (
    ("depth_mae", "depth MAE (m)", ".3f"),
    ("depth_rmse", "depth RMSE (m)", ".3f"),
    ("within_bin", "within a bin", ".0%"),
)
_PARTS = ("radiance", "depth", "confidence")
UNKNOWN = (*UNKNOWN_KINDS, "outside")
"""Why depth is unknown; counted in the attributes ``unknown_zero`` and so on of a snapshot."""
TOTAL = "unknown_depth_pixels"
"""Attribute of a snapshot: all of them."""


class SpectralDepthDemo(Demo):
    """A scene with depth through one phase mask, through four of which every pixel sees one, and through the learned
    ones that come with tmca, decoded by their network."""

    key, title = "spectral_depth", "Spectrum and depth: motorcycle"
    share = Fraction(2, 3)
    scenes = ("motorcycle",)
    columns = (*DEPTH_METRICS, ("psnr", "PSNR (dB)", ".2f"), ("sam", "SAM (°)", ".2f"))
    read_noise, reduce, window = 2e-3, 3, 12
    learned = "K = 4, learned, RGB pixels"
    codes: Mapping[str, tuple[str, dict[str, Any]]] = {
        "phase mask alone": ("static", {"slots": 1, "shutter": "open"}),
        "one-hot shutter, K = 4": ("onehot4", {"slots": 4, "shutter": "one-hot"}),
    }

    def scene(self, name: str, size: tuple[int, int]) -> xr.Dataset:
        seen = reading_range(self._camera(size, {}))
        return middle_of(load_spectral_depth(name, **seen, reduce=self.reduce), size, name)

    def trials(self, scene: xr.Dataset) -> list[Trial]:
        size, how = (scene.sizes["y"], scene.sizes["x"]), {"window": self.window}
        sensor = Sensor(read_noise=self.read_noise)
        return [
            *(
                Trial(code, f"spectral_depth_{stem}", self._camera(size, settings), settings=how)
                for code, (stem, settings) in self.codes.items()
            ),
            shipped_trial(self.learned, "spectral_depth_learned4", "spectral-depth", size, sensor),
        ]

    def _camera(self, size: tuple[int, int], settings: dict[str, Any]) -> SpectralDepthCamera:
        sensor = Sensor(read_noise=self.read_noise)
        return SpectralDepthCamera.from_preset("quick", size=size, filters="clear", sensor=sensor, **settings)

    def text(self, rows: Sequence[Mapping[str, Any]]) -> Sequence[str]:
        static, multiplexed, learned = (row["depth_mae"] for row in rows)
        return (
            "A random phase mask in the aperture blurs every depth and wavelength in its own way. It was still during "
            "the exposure, or showed four masks, of which every pixel saw one, at equal exposure time and with read "
            f"noise σ = {self.read_noise:g} of one band. Depth is the median over planes, each as probable as it "
            "explains the windows around a pixel under a Gaussian prior of other rendered scenes; the spectrum is the "
            "mean of the linear estimates at likely planes. Time multiplexing changed the mean depth error from "
            f"{static:.2f} to {multiplexed:.2f} m. Learned masks, RGB pixels and a network that corrects the colours, "
            f"all of which come with tmca, have {learned:.2f} m. tmca design spectral-depth searches masks for a bench "
            "and a sensor.",
        )

    def figures(self, name: str, scene: xr.Dataset, taken: Mapping[str, Taken]) -> dict[str, tuple[str, Any]]:
        about = "Colours, depth in metres, probability within a bin, spectra, error of the depth: {}; the truth above."
        drawn = {f"{one.trial.stem}.png": (about.format(code), one.figure(scene)) for code, one in taken.items()}
        psf = "Point spread functions of the four slots over depth, and what points leave behind the shutter."
        last = [*taken.values()][-1]
        return {**drawn, "spectral_depth_psf.png": (psf, psf_figure(last.snapshot.camera))}


class _Planes(Attributes):
    """What an estimate says of the depth that its camera tells apart, see ``tmca.decoders.decoder.PLANES``."""

    depth_planes: Json[DepthPlanes]


class SpectralDepthApplication(Application):
    """Data sets of ``radiance`` (wavelength, y, x) and ``depth`` (y, x) in metres."""

    kind = "spectral-depth"
    columns = (*DEPTH_METRICS, *METRICS)
    codes = ("codes", "psf")
    demo = SpectralDepthDemo()

    def labelled(self, scene: Any, where: str) -> xr.Dataset:
        return as_depth_scene(scene, where)

    def parts(self, scene: xr.Dataset) -> dict[str, Any]:
        waves = scene["wavelength"].values.tolist()
        return {"bands": waves, "size": (scene.sizes["y"], scene.sizes["x"])}

    def fitted(self, scene: xr.Dataset, camera: Any, where: str) -> xr.Dataset:
        """See ``Application``; depth that reaches beyond the camera's range is mapped onto it, evenly in inverse depth,
        unless the scene says that it was mapped or placed, or to stay as it is (``fitted=False``, `in_metres`)."""
        planes, how = camera.planes, noted_reading(getattr(scene, "attrs", {}))
        mapped = how.get("placed") is None and how.get("fitted", True)
        return fit_depth_scene(scene, camera.wavelengths, camera.size, planes.near, planes.far, where, mapped=mapped)

    def in_metres(self, scene: xr.Dataset) -> xr.Dataset:
        return scene.assign_attrs({METRES: 1})

    def tensors(self, scene: xr.Dataset) -> tuple[Tensor, ...]:
        return as_tensors(scene[["radiance", "depth"]])

    def check(self, scene: xr.Dataset, camera: Any) -> dict[str, Any]:
        """See ``Application``: pixels whose depth the camera does not know, how the scene was read and mapped.

        Warns:
            StrayLight, Undersampled: point spread functions that do not fit their window, masks steeper than their
                pixels.
        """
        unknown = unknown_depth(scene["depth"], camera.planes)
        check_depth_known(unknown, scene["depth"].values, camera.planes, str(scene.attrs.get("name", "scene")))
        check_holds(camera.size, camera.bench.window)
        check_mask(camera.point_spread)
        of_scene = {FOCAL_OF: "scene"} if FOCAL in scene.attrs else {}
        names = (READING, METRES, FOCAL, *FITTED)
        return {**unknown, **of_scene, **{name: scene.attrs[name] for name in names if name in scene.attrs}}

    def truth(
        self, source: str, camera: Any, notes: Mapping[str, Any], colours: bool = False, **reading: Any
    ) -> xr.Dataset:
        """See ``Application``; depth is mapped as it was for the snapshot.

        Raises:
            DataError: a smaller one.
        """
        how = noted_reading(notes)
        compare_source(how.pop("source", source), source)
        how |= {"fitted": False} if METRES in notes else {}
        how |= reading
        scene: Any = self.read(source, **reading_range(camera), **how)
        _check_as_large(scene, camera.size, source, how.get("reduce", 1))
        return middle_of(scene, camera.size, source)

    def metrics(self, estimate: Mapping[str, np.ndarray], truth: xr.Dataset, camera: Any) -> dict[str, float]:
        """See ``Application``: those of the cube, and of the depth and its deviation where it is known."""
        metrics = spectral_depth_metrics(estimate["values"][0], estimate["depth"], truth, camera.planes)
        apart, real = estimate.get("depth_deviation"), truth["depth"].values
        if apart is None or apart.shape != real.shape:
            return metrics
        known = np.isfinite(estimate["depth"]) & camera.planes.within(torch.from_numpy(np.array(real))).numpy()
        sure = certainty(estimate["depth"][known], real[known], apart[known]) if known.any() else {}
        return metrics | {f"depth_{name}": value for name, value in sure.items()}

    def remarks(self, estimate: xr.Dataset) -> list[str]:
        """See ``Application``: that metres are those of a mapped scene."""
        planes = attributes_of(_Planes, estimate.attrs, "estimate").depth_planes
        said = said_mapped(estimate.attrs, planes.near, planes.far)
        return [f"metres are those of the mapped scene: {said}"] if said else []

    def holds(self, about: Mapping[str, Any]) -> bool:
        return bool("confidence" in about["variables"] and about.get("depth"))

    def stored(self, path: str, **reading: Any) -> xr.Dataset:
        stored = read_dataset(path, _PARTS)
        if stored["depth"].dtype.kind not in "fiu" or stored["depth"].isnull().any():
            raise DataError(path, "a depth that is not a number", "the distance of every pixel", REMEDY)
        return stored

    def camera_of(self, stored: xr.Dataset, where: str) -> Any:
        camera, radiance = super().camera_of(stored, where), stored["radiance"]
        if "wavelength" not in radiance.dims or "wavelength" not in radiance.coords:
            raise DataError(where, "radiance without wavelengths", "one along a coordinate wavelength", REMEDY)
        camera.wavelengths = tuple(radiance["wavelength"].values.tolist())
        camera.planes = attributes_of(_Planes, stored.attrs, where).depth_planes
        if np.isfinite(camera.planes.far) and np.isinf(stored["depth"].values).any():
            raise DataError(where, "an infinite depth", f"at most {camera.planes.far:g} m", REMEDY)
        return camera

    def code_figures(self, camera: Any) -> dict[str, Figure]:
        """See ``Application``: masks with shutter and filters, and the point spread functions."""
        return {"codes": camera.plot(), "psf": psf_figure(camera)}

    def figure(
        self, estimate: xr.Dataset, camera: Any, truth: Any = None, snapshot: Snapshot[Any] | None = None
    ) -> Figure:
        """See ``Application``: colours, depth with confidence and errors, spectra; the truth in a row of its own."""
        return estimate_figure(estimate, truth, (camera.planes.near, camera.planes.far))


def _check_as_large(truth: xr.Dataset, size: tuple[int, int], where: str, reduce: int) -> None:
    """Raises DataError for a truth that is smaller than its estimate."""
    rows, columns = truth.sizes["y"], truth.sizes["x"]
    if rows < size[0] or columns < size[1]:
        read = f" (each the mean of {reduce}×{reduce}, as the estimate's scene was read)" if reduce > 1 else ""
        expected = f"at least the {size[0]}×{size[1]} of the estimate"
        raise DataError(where, f"{rows}×{columns} pixels{read}", expected, "name the scene of the estimate")


def reading_range(camera: Any) -> dict[str, Any]:
    """Bands and depth range of a camera, as `tmca.data.load_spectral_depth` takes them."""
    return {"wavelengths": camera.wavelengths, "near": camera.planes.near, "far": camera.planes.far}


def spectral_depth_metrics(
    cube: np.ndarray, depth: np.ndarray, truth: xr.Dataset, planes: DepthPlanes
) -> dict[str, float]:
    """PSNR, SSIM, UIQI, SAM, … of the cube; MAE, RMSE and share within a bin of the depth where it is known, and the
    MAE of the best constant.

    ``known_depth`` is the share of pixels where it is, within the range of the planes. One plane has no bins.
    """
    within = planes.within(torch.from_numpy(np.array(truth["depth"].values)))
    real = np.where(within.numpy(), truth["depth"].values, np.nan)
    figures = {"depth_mae": depth_mae(depth, real), "depth_mae_of_constant": np.nan}
    if within.any():
        figures["depth_mae_of_constant"] = depth_mae(np.full_like(real, np.nanmedian(real)), real)
    figures["depth_rmse"] = depth_rmse(depth, real)
    if planes.count > 1:
        figures["within_bin"] = within_bin(depth, real, planes.metres)
    return {**all_metrics(cube, truth["radiance"].values), **figures, "known_depth": float(within.double().mean())}


def unknown_depth(depth: xr.DataArray, planes: DepthPlanes) -> dict[str, int]:
    """How many pixels (y, x) are unknown, in all and by kind: no depth, or outside the range of the planes."""
    kinds = unknown_kinds(depth)
    within = planes.within(torch.from_numpy(np.array(depth.values))).numpy()
    counts = [int(np.sum(kinds == place)) for place in range(1, len(UNKNOWN))] + [int(np.sum((kinds == 0) & ~within))]
    return {TOTAL: int(np.sum(~within)), **{f"unknown_{name}": n for name, n in zip(UNKNOWN, counts, strict=True)}}


def said_unknown(counts: Mapping[str, Any], pixels: int) -> str:
    """``7 of 90 pixels of unknown depth (4 zero, 3 outside)`` of the counts of ``unknown_depth``."""
    each = ((counts.get(f"unknown_{name}", 0), name.replace("_", " ")) for name in UNKNOWN)
    why = ", ".join(f"{count} {name}" for count, name in each if count)
    return f"{counts[TOTAL]} of {pixels} pixels of unknown depth" + (f" ({why})" if why else "")


def check_depth_known(counts: Mapping[str, int], depth: np.ndarray, planes: DepthPlanes, where: str) -> None:
    """Raises DataError where no pixel of a scene has a depth that the camera knows."""
    if counts[TOTAL] == depth.size:
        expected = f"some within {planes.near:g} to {planes.far:g} m, the camera's depth range"
        known = depth[np.isfinite(depth) & (depth > 0)]
        range_of_scene = f" {_outwards(known.min(), -1)},{_outwards(known.max(), 1)}" if known.size else ""
        remedy = f"choose another range (--depth{range_of_scene}), or map depth onto it (no --metric-depth)"
        raise DataError(where, said_unknown(counts, depth.size), expected, remedy)


def _outwards(metres: float, way: int) -> str:
    """Metres rounded down (``way`` -1) or up (1) to two digits."""
    step = 10.0 ** (np.floor(np.log10(metres)) - 1)
    return f"{way * np.ceil(way * metres / step) * step:.3g}"
