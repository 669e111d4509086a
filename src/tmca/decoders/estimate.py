"""What a decoder returns: scenes with what is known of their errors, labelled, drawn and saved."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torch import Tensor

from tmca.cameras.camera import in_a_line
from tmca.decoders.view_maps import focal_length, view_maps
from tmca.summaries import Summary, as_numpy, sizes

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr
    from matplotlib.figure import Figure

PLANES = "depth_planes"
"""Attribute of an estimate with depth, JSON: nearest and farthest plane in metres, and their number."""
PRIOR = "prior"
"""Note of an estimate: the prior that it was made with, in a few words."""


@dataclass(eq=False, repr=False)
class Estimate(Summary):
    """The scenes that a decoder finds behind snapshots.

    Args:
        values: (B, *camera.scene_shape) relative irradiance: cubes (B, L, H, W), light fields (B, V, U, H, W), or
            (B, K, L, H, W) of scenes that change from slot to slot.
        camera: that took the snapshots.
        decoder: name of the decoder.
        deviation: predicted standard deviation of every entry, shaped as the values.
        depth: (B, 1, H, W) metres.
        confidence: (B, 1, H, W) probability of the bin of the depth and its two neighbours.
        planes: (B, D, H, W) log-probability of every plane, from far to near, up to a constant.
        depth_deviation: (B, 1, H, W) predicted standard deviation of the depth, metres.
        seconds: wall time.
        notes: of the snapshot (scene, seed, …) and of the decoder (iterations, weight, …); attributes of the file.
    """

    values: Tensor
    camera: Any
    decoder: str
    deviation: Tensor | None = None
    depth: Tensor | None = None
    confidence: Tensor | None = None
    planes: Tensor | None = None
    seconds: float = 0.0
    notes: dict[str, Any] = field(default_factory=dict)
    depth_deviation: Tensor | None = None

    @property
    def estimate(self) -> Tensor:
        """The values, by their name in version 0.1."""
        return self.values

    def to_xarray(self) -> xr.Dataset:
        """Arrays: ``estimate`` and ``deviation``, or ``radiance``, ``depth``, ``depth_deviation``, ``confidence``.

        A batch of one has no axis of its own; colours of a light field have. What the views of a light field show
        together takes a while and is in `maps`; `save` writes both.
        """
        import xarray as xr

        attrs = {**self.notes, "camera": self.camera.kind, "decoder": self.decoder, "seconds": self.seconds}
        by = f"estimated by {self.decoder}"
        parts = {"estimate" if self.depth is None else "radiance": self._label(self.values, f"scene {by}")}
        if self.deviation is not None:
            parts["deviation"] = self._label(self.deviation, "predicted standard deviation")
        if self.depth is not None:
            attrs = {**focal_length(self.camera), **attrs, PLANES: json.dumps(asdict(self.camera.planes))}
        sure = "probability of the plane of the depth and its two neighbours"
        apart = "predicted standard deviation of the depth"
        maps_of = (
            ("depth", self.depth, "m", f"depth {by}"),
            ("depth_deviation", self.depth_deviation, "m", apart),
            ("confidence", self.confidence, "1", sure),
        )
        for name, planes, unit, meaning in maps_of:
            if planes is not None:
                parts[name] = self._map(planes, unit, meaning)
        return xr.Dataset(parts, attrs=attrs)

    @staticmethod
    def _map(planes: Tensor, unit: str, meaning: str) -> xr.DataArray:
        """Planes (B, 1, H, W), labelled."""
        import xarray as xr

        maps, several = planes[:, 0].numpy(force=True), len(planes) > 1
        dims = ("snapshot", "y", "x") if several else ("y", "x")
        return xr.DataArray(maps if several else maps[0], dims=dims, attrs={"long_name": meaning, "units": unit})

    def _label(self, values: Tensor, meaning: str) -> xr.DataArray:
        """Values (B, *scene_shape), or (B, K, *scene_shape), as the camera labels them."""
        import xarray as xr

        def stacked(parts: Iterable[xr.DataArray], axis: str) -> xr.DataArray:
            return xr.concat(parts, axis, coords="minimal", compat="override", join="override")

        colours = len(values) == 3 and "colour" in self.camera.snapshot_axes(values)
        if len(values) > 1 and not colours:
            return stacked((self._label(one, meaning) for one in values.split(1)), "snapshot")
        if values.ndim > 1 + len(self.camera.scene_shape):
            return stacked((self.camera.label(slot, meaning) for slot in values.unbind(1)), "slot")
        labelled: xr.DataArray = self.camera.label(values, meaning)
        return labelled

    @cached_property
    def maps(self) -> xr.Dataset:
        """``disparity``, ``confidence`` and ``all_in_focus`` of a light field's views, see `tmca.metrics.Geometry`;
        none of other scenes."""
        import xarray as xr

        return xr.Dataset(view_maps(self.to_xarray()))

    @property
    def _has_maps(self) -> bool:
        """Whether `maps` has any, which takes a while to compute."""
        views = getattr(self.camera, "views", ())
        still = self.values.ndim == 1 + len(self.camera.scene_shape) and len(self.values) in (1, 3)
        return still and self.camera.kind == "light-field" and max(views) > 1

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write `to_xarray` and, of a light field, its `maps` as NetCDF, whole or not at all.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        from tmca.data import write_dataset

        return write_dataset(self.to_xarray().assign(self.maps), path, overwrite=overwrite)

    def plot(self, truth: Any = None, at: Sequence[tuple[int, int]] | None = None) -> Figure:
        """The estimate in pictures: composites or views, depth if any, errors and predicted deviation, spectra.

        The disparity of a light field is drawn by ``estimate.maps["disparity"].plot()``, and beside the truth by
        `tmca reconstruct`.

        Args:
            truth: the scene, its name or file, or an array as large as the estimate, brought to the camera's bands and
                size beside it; of a dataset the first variable, or ``radiance`` and ``depth``.
            at: pixels (row, column), such as ``[(20, 30)]``, of the spectra; some of different spectra without.

        Raises:
            DataError, ShapeError: a truth of another kind, or a smaller one.
            SettingError: pixels outside the estimate, too many, or of an estimate without spectra.
        """
        from tmca.plots.estimates import estimate_figure

        limits = None if self.depth is None else (self.camera.planes.near, self.camera.planes.far)
        return estimate_figure(self.to_xarray(), truth, limits, at)

    def view(self, truth: Any = None, **how: Any) -> Any:
        """Look at the estimate in a browser; arguments, result and errors as of `tmca.view`."""
        import tmca

        return tmca.view(self, truth=truth, **how)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray[Any, Any]:
        """The values (B, *scene_shape) for NumPy."""
        return as_numpy(self.values, dtype, copy)

    def _facts(self) -> dict[str, str]:
        more = [name for name in ("deviation", "depth", "confidence") if getattr(self, name) is not None]
        seen = ("psnr", "ssim", "sam", "depth_mae", "disparity_mae", "disparity_agreement_mae")
        merit = {name: float(self.notes[f"metric_{name}"]) for name in seen if f"metric_{name}" in self.notes}
        return {
            "camera": in_a_line(self.camera),
            "values": sizes(self.values.shape) + (f", with {' and '.join(more)}" if more else ""),
            "decoder": f"{self.decoder}, {self.seconds:.2g} s",
            "prior": str(self.notes.get(PRIOR, "")),
            "maps": "disparity, confidence and all_in_focus in .maps, and in the file" if self._has_maps else "",
            "scene": str(self.notes.get("scene", "")),
            "metrics": ", ".join(f"{name} {value:.4g}" for name, value in merit.items()),
        }

    def _picture(self) -> Figure:
        from tmca.plots.estimates import estimate_thumbnail

        return estimate_thumbnail(self.to_xarray())
