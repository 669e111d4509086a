"""What every decoder returns: the scene with its coordinates, as tensors, as xarray, as a file and as a picture."""

from __future__ import annotations

import json
from base64 import b64encode
from dataclasses import asdict, dataclass, field
from html import escape
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from torch import Tensor

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

PLANES = "depth_planes"
"""Attribute of an estimate with depth, JSON: nearest and farthest plane in metres, and their number."""


@dataclass
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

        attrs = {**self.notes, "decoder": self.decoder, "seconds": self.seconds}
        if self.depth is not None:
            attrs[PLANES] = json.dumps(asdict(self.camera.planes))
        parts = _with_depth(self) if self.depth is not None else _LABELS.get(self.camera.kind, _plain)(self)
        return xr.Dataset({name: part for name, part in parts.items() if part is not None}, attrs=attrs)

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write `to_xarray` as NetCDF, whole or not at all.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        from tmca.data import write_dataset

        return write_dataset(self.to_xarray(), path, overwrite=overwrite)

    def plot(self, truth: xr.DataArray | xr.Dataset | None = None) -> Figure:
        """The first estimate as pictures: means over the bands or the centre view, depth if any, the truth."""
        from matplotlib.figure import Figure

        shown: dict[str, Any] = {self.decoder: self.to_xarray()}
        if truth is not None:
            shown["truth"] = truth.to_dataset(name="estimate") if hasattr(truth, "to_dataset") else truth
        panels = [(f"{name}: {part}", image) for name, data in shown.items() for part, image in _images(data).items()]
        figure = Figure(figsize=(3.2 * len(panels), 3), layout="constrained")
        for axis, (title, image) in zip(np.atleast_1d(figure.subplots(1, len(panels))), panels, strict=True):
            axis.imshow(image, cmap="gray" if title.endswith("scene") else "viridis")
            axis.set(title=title, xticks=[], yticks=[])
        return figure

    def __repr__(self) -> str:
        sides = "×".join(str(side) for side in self.values.shape)
        more = [name for name in ("deviation", "depth", "confidence", "planes") if getattr(self, name) is not None]
        with_more = f" with {' and '.join(more)}" if more else ""
        return f"<Estimate {sides} of a {self.camera.kind} camera by {self.decoder}{with_more}, {self.seconds:.2g} s>"

    def _repr_html_(self) -> str:
        picture = BytesIO()
        self.plot().savefig(picture, format="png", dpi=60)
        return f'{escape(repr(self))}<br><img src="data:image/png;base64,{b64encode(picture.getvalue()).decode()}"/>'


def _array(values: Tensor) -> np.ndarray:
    """As NumPy, without the axis of a batch of one."""
    array = values.detach().cpu().numpy()
    return array[0] if len(array) == 1 else array


def _cube(estimate: Estimate) -> dict[str, xr.DataArray | None]:
    import xarray as xr

    waves = np.array(estimate.camera.wavelengths)
    coords = {
        "wavelength": ("wavelength", waves, {"units": "m"}),
        "wavelength_nm": ("wavelength", waves * 1e9, {"units": "nm"}),
    }
    leading = (*(("snapshot",) if len(estimate.values) > 1 else ()), *(("slot",) if estimate.values.ndim == 5 else ()))

    def labelled(values: Tensor, meaning: str) -> xr.DataArray:
        attrs = {"quantity": "relative irradiance", "units": "1", "long_name": meaning}
        return xr.DataArray(_array(values), dims=(*leading, "wavelength", "y", "x"), coords=coords, attrs=attrs)

    return _both(estimate, "scene", labelled)


def _light_field(estimate: Estimate) -> dict[str, xr.DataArray | None]:
    from tmca.data import label_light_field

    def labelled(values: Tensor, meaning: str) -> xr.DataArray:
        return label_light_field(_array(values), {"long_name": meaning})

    return _both(estimate, "light field", labelled)


def _plain(estimate: Estimate) -> dict[str, xr.DataArray | None]:
    """Of a camera that this file does not know."""
    import xarray as xr

    def labelled(values: Tensor, meaning: str) -> xr.DataArray:
        return xr.DataArray(_array(values), attrs={"long_name": meaning})

    return _both(estimate, "scene", labelled)


def _both(estimate: Estimate, scene: str, labelled: Any) -> dict[str, xr.DataArray | None]:
    deviation = estimate.deviation
    return {
        "estimate": labelled(estimate.values, f"{scene} estimated by {estimate.decoder}"),
        "deviation": None if deviation is None else labelled(deviation, "predicted standard deviation"),
    }


def _with_depth(estimate: Estimate) -> dict[str, xr.DataArray | None]:
    import xarray as xr

    assert estimate.depth is not None
    assert estimate.confidence is not None
    leading = ("snapshot",) if len(estimate.values) > 1 else ()
    waves = ("wavelength", np.array(estimate.camera.wavelengths), {"units": "m"})
    name = {"long_name": f"estimated by {estimate.decoder}"}
    plane = (*leading, "y", "x")
    return {
        "radiance": xr.DataArray(
            _array(estimate.values), dims=(*leading, "wavelength", "y", "x"), coords={"wavelength": waves}, attrs=name
        ),
        "depth": xr.DataArray(_array(estimate.depth[:, 0]), dims=plane, attrs={**name, "units": "m"}),
        "confidence": xr.DataArray(_array(estimate.confidence[:, 0]), dims=plane, attrs={**name, "units": "1"}),
    }


def _images(data: xr.Dataset) -> dict[str, np.ndarray]:
    """(H, W) pictures of a labelled scene by what they show."""
    scene = data[next(iter(data.data_vars))]
    scene = scene.isel({dim: size // 2 for dim, size in scene.sizes.items() if str(dim).startswith("view")})
    first = scene.mean([dim for dim in scene.dims if dim not in ("y", "x")]) if "y" in scene.dims else scene
    return {"scene": first.values} | ({"depth": data["depth"].values} if "depth" in data else {})


_LABELS = {"spectral": _cube, "light-field": _light_field}
