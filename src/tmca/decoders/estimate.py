"""What every decoder returns: the scene with its coordinates, as tensors, as xarray, as a file and as a picture."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from html import escape
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torch import Tensor

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

_COLOURS = 3
PLANES = "depth_planes"
"""Attribute of an estimate with depth, JSON: nearest and farthest plane in metres, and their number."""


@dataclass(eq=False, repr=False)
class Estimate:
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

    @property
    def estimate(self) -> Tensor:
        """The values, by their name in version 0.1."""
        return self.values

    def to_xarray(self) -> xr.Dataset:
        """Labelled arrays: ``estimate`` and ``deviation``, or ``radiance``, ``depth`` and ``confidence``.

        A batch of one has no axis of its own; colours of a light field have.
        """
        import xarray as xr

        attrs = {**self.notes, "camera": self.camera.kind, "decoder": self.decoder, "seconds": self.seconds}
        by = f"estimated by {self.decoder}"
        parts = {"estimate" if self.depth is None else "radiance": self._label(self.values, f"scene {by}")}
        if self.deviation is not None:
            parts["deviation"] = self._label(self.deviation, "predicted standard deviation")
        if self.depth is not None:
            attrs[PLANES] = json.dumps(asdict(self.camera.planes))
        for name, plane, unit in (("depth", self.depth, "m"), ("confidence", self.confidence, "1")):
            if plane is not None:
                maps, about = plane[:, 0].numpy(force=True), {"long_name": by, "units": unit}
                several = len(maps) > 1
                dims = ("snapshot", "y", "x") if several else ("y", "x")
                parts[name] = xr.DataArray(maps if several else maps[0], dims=dims, attrs=about)
        return xr.Dataset(parts, attrs=attrs)

    def _label(self, values: Tensor, meaning: str) -> xr.DataArray:
        """Values (B, *scene_shape), or (B, K, *scene_shape), as the camera labels them."""
        import xarray as xr

        def stacked(parts: Iterable[xr.DataArray], axis: str) -> xr.DataArray:
            return xr.concat(parts, axis, coords="minimal", compat="override", join="override")

        colours = len(values) == _COLOURS and "colour" in self.camera.snapshot_axes(values)
        if len(values) > 1 and not colours:
            return stacked((self._label(one, meaning) for one in values.split(1)), "snapshot")
        if values.ndim > 1 + len(self.camera.scene_shape):
            return stacked((self.camera.label(slot, meaning) for slot in values.unbind(1)), "slot")
        labelled: xr.DataArray = self.camera.label(values, meaning)
        return labelled

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write `to_xarray` as NetCDF, whole or not at all.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        from tmca.data import write_dataset

        return write_dataset(self.to_xarray(), path, overwrite=overwrite)

    def plot(self, truth: xr.DataArray | xr.Dataset | None = None) -> Figure:
        """The estimate in pictures: composites or views, depth if any, errors and predicted deviation, spectra.

        Args:
            truth: the scene, brought to the camera's bands and size, beside it; of a dataset the first variable, or
                ``radiance`` and ``depth``.

        Raises:
            DataError: a truth of another kind, or a smaller one.
        """
        from tmca.plots.estimates import estimate_figure

        limits = None if self.depth is None else (self.camera.planes.near, self.camera.planes.far)
        return estimate_figure(self.to_xarray(), truth, limits)

    def __repr__(self) -> str:
        sides = "×".join(str(side) for side in self.values.shape)
        more = [name for name in ("deviation", "depth", "confidence", "planes") if getattr(self, name) is not None]
        with_more = f" with {' and '.join(more)}" if more else ""
        return f"<Estimate {sides} of a {self.camera.kind} camera by {self.decoder}{with_more}, {self.seconds:.2g} s>"

    def _repr_html_(self) -> str:
        picture = BytesIO()
        self.plot().savefig(picture, format="png", dpi=50)
        return f'{escape(repr(self))}<br><img src="data:image/png;base64,{b64encode(picture.getvalue()).decode()}"/>'
