"""The light-field camera's application: views."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from tmca.applications.base import Application, has_deviation, noted_reading
from tmca.applications.camera_figures import rays_figure
from tmca.applications.demo import Demo, Taken, Trial, shipped_trial
from tmca.applications.moving import MOTION, check_axes, in_frames
from tmca.applications.spectral import METRICS
from tmca.cameras import LightFieldCamera
from tmca.data import label_light_field, light_fields
from tmca.data.fitting import fit_views
from tmca.data.in_memory import as_tensors, as_views, of_shape
from tmca.data.light_field_scenes import load_light_field, true_disparity
from tmca.data.light_fields import VIEW_DIMS
from tmca.data.scene_names import READING, compare_source
from tmca.errors import DataError, SettingError, TmcaError
from tmca.metrics import disparity_error, estimate_disparity, light_field_metrics
from tmca.metrics.refocusing import has_parallax
from tmca.plots.estimates import predicted_deviations
from tmca.plots.light_field import geometry_figure, light_field_figure
from tmca.plots.views import focus_steps, refocus_strip
from tmca.sensor import Sensor

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from tmca.cameras import Snapshot


class LightFieldDemo(Demo):
    """Views of staged surfaces in colour, through one pattern, through eight of which every pixel sees one, and through
    the designed ones that come with tmca, decoded by their network."""

    key, title = "light_field", "A light field: coffee"
    share = Fraction(2, 3)
    scenes = ("coffee:1",)
    columns = (*METRICS[:2], ("disparity_mae", "disparity MAE (px per view)", ".3f"))
    read_noise, views, period = 1e-3, 5, 16
    codes: Mapping[str, tuple[str, dict[str, Any]]] = {
        "static mask (CLFP)": ("static", {"slots": 1, "shutter": "open"}),
        "one-hot shutter, K = 8": ("onehot8", {"slots": 8, "shutter": "one-hot"}),
    }
    designed = "K = 8, designed"
    focus = (-1.0, 0.0, 1.0)

    def scene(self, name: str, size: tuple[int, int]) -> xr.DataArray:
        return load_light_field(name, views=self.views, size=size, colour=True)

    def trials(self, scene: xr.DataArray) -> list[Trial]:
        size, sensor = (scene.sizes["y"], scene.sizes["x"]), Sensor(read_noise=self.read_noise)
        same: dict[str, Any] = {"views": self.views, "size": size, "period": self.period, "sensor": sensor}
        return [
            *(
                Trial(code, f"light_field_{stem}", LightFieldCamera(**same, **settings))
                for code, (stem, settings) in self.codes.items()
            ),
            shipped_trial(self.designed, "light_field_designed8", "light-field", size, sensor),
        ]

    def text(self, rows: Sequence[Mapping[str, Any]]) -> Sequence[str]:
        static, multiplexed, designed = (row["psnr"] for row in rows)
        return (
            f"{self.views}×{self.views} views of staged surfaces went through a coded mask before the sensor, in "
            f"colour, at equal exposure time and with read noise σ = {self.read_noise:g}: one pattern (compressive "
            "light-field photography), and eight patterns, of which every pixel sees one. The views come back in "
            "closed form under a Gaussian prior of other rendered light fields; time multiplexing changed the PSNR by "
            f"{multiplexed - static:+.2f} dB. Designed patterns and the network that learned behind them, which come "
            f"with tmca, changed it by {designed - static:+.2f} dB.",
        )

    def figures(self, name: str, scene: xr.DataArray, taken: Mapping[str, Taken]) -> dict[str, tuple[str, Any]]:
        views = {code: one.estimate.values.numpy() for code, one in taken.items()}
        best = taken[self.designed]
        snapshot, values = best.snapshot.values[:, 0].numpy(), best.estimate.values.numpy()
        about = (
            "Centre views, and the box in them enlarged with the epipolar slices of its marked row and column: true "
            "and reconstructed. At the right the time-multiplexed snapshot and the errors."
        )
        return {
            "light_field_views.png": (about, light_field_figure(views, scene.values, snapshot)),
            "light_field_refocus.png": (
                "Refocused after the exposure: far, middle, near.",
                refocus_strip(values, self.focus),
            ),
            "light_field_views.gif": ("A walk over the reconstructed views (K = 8, designed).", values),
        }


class LightFieldApplication(Application):
    """Light fields (view_v, view_u, y, x), or with colours first, each a snapshot of its own."""

    kind = "light-field"
    columns = METRICS[:2]
    codes = ("codes", "rays")
    pictures = (".png", "_disparity.png", "_refocus.png", ".gif")
    demo = LightFieldDemo()

    def labelled(self, scene: Any, where: str) -> xr.DataArray:
        return as_views(scene, where)

    def of_array(self, values: np.ndarray, camera: Any, where: str) -> xr.DataArray:
        """See ``Application``; (V, U, H, W), or with three colours first."""
        views = ("V", "U") if "views" in getattr(camera, "unbound", ()) else camera.views
        colours = (3,) if values.ndim == 5 and len(values) == 3 else ()
        return label_light_field(of_shape(values, (*colours, *views, "H", "W"), where))

    def parts(self, scene: xr.DataArray) -> dict[str, Any]:
        views = (scene.sizes["view_v"], scene.sizes["view_u"])
        return {"views": views, "size": (scene.sizes["y"], scene.sizes["x"])}

    def fitted(self, scene: xr.DataArray, camera: Any, where: str) -> xr.DataArray:
        """See ``Application``; the views in the middle of the grid."""
        return fit_views(scene, camera.views, camera.size, where)

    def tensors(self, scene: xr.DataArray) -> tuple[Tensor, ...]:
        return as_tensors(scene)

    def check(self, scene: xr.DataArray, camera: Any) -> dict[str, Any]:
        """See ``Application``: how the scene was read."""
        return {READING: scene.attrs[READING]} if READING in scene.attrs else {}

    def truth(
        self, source: str, camera: Any, notes: Mapping[str, Any], colours: bool = False, **reading: Any
    ) -> xr.DataArray:
        """See ``Application``; other files than the snapshot's scene are read at its scale: their pixels are as large.

        Raises:
            SettingError: the snapshot's scene read otherwise than it was.
            DataError: fewer views, or smaller ones.
        """
        how = _reading(source, notes, {name: value for name, value in reading.items() if value is not None})
        try:
            return self.read(source, views=camera.views[0], size=camera.size, colour=colours, **how)  # type: ignore[return-value]
        except SettingError as error:
            if error.where not in ("views", "crop") or not Path(source).exists():
                raise
            raise DataError(source, error.found, error.expected, "name the scene of the snapshot") from error

    def metrics(self, estimate: Mapping[str, np.ndarray], truth: xr.DataArray, camera: Any) -> dict[str, float]:
        """See ``Application``: PSNR and SSIM of all views and of the worst."""
        values = estimate["values"]
        return light_field_metrics(values if len(values) > 1 else values[0], truth.values)

    def geometry(self, estimate: xr.Dataset, truth: xr.DataArray) -> dict[str, float]:
        """See ``Application``: error of the disparity that the views show; where the true one is not known, its
        difference from the disparity of the true views. Beside it that of a constant."""
        views = estimate["estimate"]
        still = set(views.dims) <= {"colour", *VIEW_DIMS} and has_parallax(views.values)
        name, real = _reference(truth, _true_disparity(truth, views)) if still else ("", None)
        if real is None:
            return {}
        error = disparity_error(estimate_disparity(views.values), real)
        return {f"{name}_{key}": error[key] for key in ("mae", "badpix", "mae_of_constant")}

    def holds(self, about: Mapping[str, Any]) -> bool:
        """See ``Application``; any light field is one."""
        return bool(about["kind"] == "light field")

    def stored(self, path: str, **reading: Any) -> xr.Dataset:
        """See ``Application``: all views in their colours, and as attributes how its scene was read and moved."""
        with light_fields.open_light_field(path) as contents:
            if in_frames(contents):
                return _with_views(super().stored(path), path)
            stored = light_fields.find_light_field(contents)
            if stored is None:
                raise light_fields.no_light_field(contents)
            divisor, colour = 1.0 if stored.dtype.kind == "f" else None, light_fields.has_colour(stored)
            views = light_fields.load_views(contents, stored, colour=colour, divide_by=divisor)
            dataset = views.to_dataset(name="estimate")
            if has_deviation(contents):
                spread = contents.arrays["deviation"]
                dataset["deviation"] = light_fields.load_views(contents, spread, colour=colour, divide_by=1.0)
            noted = {name: contents.attrs[name] for name in (READING, MOTION) if name in contents.attrs}
        return dataset.assign_attrs(noted)

    def camera_of(self, stored: xr.Dataset, where: str) -> Any:
        camera, sizes = super().camera_of(stored, where), stored["estimate"].sizes
        camera.views = (sizes["view_v"], sizes["view_u"])
        return camera

    def code_figures(self, camera: Any) -> dict[str, Figure]:
        """See ``Application``; also what each mask point does to the rays that cross it."""
        return {**super().code_figures(camera), "rays": rays_figure(camera)}

    def figure(
        self, estimate: xr.Dataset, camera: Any, truth: Any = None, snapshot: Snapshot[Any] | None = None
    ) -> Figure:
        """See ``Application``: centre views with epipolar slices."""
        # buckets beside each other, the first at the left
        frames = None if snapshot is None else torch.cat(snapshot.values.unbind(1), -1).numpy(force=True)
        shown = frames if frames is None or len(frames) > 1 else frames[0]
        name, real = str(estimate.attrs["decoder"]), None if truth is None else truth.values
        spread = predicted_deviations(estimate)
        buckets = 1 if snapshot is None else snapshot.camera.buckets
        return light_field_figure({name: estimate["estimate"].values}, real, shown, buckets, spread)

    def figures(
        self,
        estimate: xr.Dataset,
        camera: Any,
        truth: Any = None,
        snapshot: Snapshot[Any] | None = None,
        title: str = "",
    ) -> dict[str, Figure | np.ndarray]:
        """See ``Application``; also disparity, refocused photographs, and a walk over the views."""
        views = estimate["estimate"]
        known = estimate["disparity"].values if "disparity" in estimate else None
        drawn = super().figures(estimate, camera, truth, snapshot, title)
        if known is not None:
            sharp, sure = estimate["all_in_focus"].values, estimate["confidence"].values
            above = f"{title}: {estimate.attrs['decoder']}"
            name, real = ("", None) if truth is None else _reference(truth, usable_disparity(truth, views))
            matched = name == AGREEMENT
            drawn["_disparity.png"] = geometry_figure(sharp, known, sure, real, above, matched)
        above = f"{title}: refocused, disparity in px per view"
        strip = refocus_strip(views.values, focus_steps(views, known), above)
        return {**drawn, "_refocus.png": strip, ".gif": views.values}


def _with_views(stored: xr.Dataset, path: str) -> xr.Dataset:
    """An estimate in frames; DataError unless every frame is a light field."""
    colour = ("colour",) if "colour" in stored["estimate"].dims else ()
    check_axes(stored, path, *colour, *VIEW_DIMS)
    return stored


AGREEMENT = "disparity_agreement"
"""Name of what a disparity is compared with where the true one is not known: that of the true views."""


def _reference(truth: xr.DataArray, real: np.ndarray | None) -> tuple[str, np.ndarray | None]:
    """What a disparity is compared with, and by which name: the true one, or that of the true views."""
    if real is not None:
        return "disparity", real
    return AGREEMENT, estimate_disparity(truth.values) if has_parallax(truth.values) else None


def usable_disparity(truth: xr.DataArray, like: xr.DataArray) -> np.ndarray | None:
    """The true disparity for a picture, which does without a damaged one."""
    try:
        return _true_disparity(truth, like)
    except TmcaError:
        return None


def _true_disparity(truth: xr.DataArray, like: xr.DataArray) -> np.ndarray | None:
    """Disparity that a truth came with, in the pixels of ``like``."""
    how = noted_reading(truth.attrs)
    real = true_disparity(how["source"], like, how["scale"], how["pattern"]) if how else None
    return None if real is None else real.values


def _reading(source: str, notes: Mapping[str, Any], given: dict[str, Any]) -> dict[str, Any]:
    """``scale``, ``pattern`` and ``lens`` of a truth: those of the snapshot's scene, of another one from files its
    scale.

    Raises:
        SettingError: one that is given otherwise for the snapshot's scene.
    """
    noted = noted_reading(notes)
    if not noted:
        return given
    compare_source(noted["source"], source)
    same = Path(noted["source"]).stem == Path(source).stem
    if not (same or Path(source).exists()):
        return given
    files = ("scale", "pattern", "lens") if same else ("scale",)
    snapshot_reading = {name: noted[name] for name in files if noted.get(name) is not None}
    snapshot_reading |= {"lens": tuple(snapshot_reading["lens"])} if "lens" in snapshot_reading else {}
    for name, value in given.items():
        if same and snapshot_reading.get(name, value) != value:
            raise SettingError(
                name, str(value), f"{snapshot_reading[name]}, as the snapshot's scene was read", "leave it out"
            )
    return {**snapshot_reading, **given}
