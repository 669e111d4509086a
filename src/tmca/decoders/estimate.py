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
        """The estimate in pictures: composites or views, depth if any, errors and predicted deviation, spectra.

        Args:
            truth: the scene, brought to the camera's bands and size, beside it; of a dataset the first variable, or
                ``radiance`` and ``depth``.

        Raises:
            DataError: a truth of another kind, or a smaller one.
        """
        draw = _draw_depth if self.depth is not None else _DRAWINGS.get(self.camera.kind, _draw_plain)
        return draw(self, truth)

    def __repr__(self) -> str:
        sides = "×".join(str(side) for side in self.values.shape)
        more = [name for name in ("deviation", "depth", "confidence", "planes") if getattr(self, name) is not None]
        with_more = f" with {' and '.join(more)}" if more else ""
        return f"<Estimate {sides} of a {self.camera.kind} camera by {self.decoder}{with_more}, {self.seconds:.2g} s>"

    def _repr_html_(self) -> str:
        picture = BytesIO()
        self.plot().savefig(picture, format="png", dpi=50)
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


def _first(truth: xr.DataArray | xr.Dataset) -> xr.DataArray:
    import xarray as xr

    return next(iter(truth.data_vars.values())) if isinstance(truth, xr.Dataset) else truth


def _draw_cube(estimate: Estimate, truth: Any) -> Figure:
    from tmca.data.fitting import fit_cube
    from tmca.plots.cube import reconstruction_figure

    camera, name, deviation = estimate.camera, estimate.decoder, estimate.deviation
    scene = None if truth is None else fit_cube(_first(truth), camera.wavelengths, camera.size, "truth").values
    deviations = {} if deviation is None else {name: deviation[0].numpy(force=True)}
    cube = estimate.values[0].numpy(force=True)
    shown = cube if cube.ndim == 3 else cube.mean(0)
    return reconstruction_figure({name: shown}, list(camera.wavelengths), scene, deviations)


def _draw_views(estimate: Estimate, truth: Any) -> Figure:
    from tmca.data.fitting import fit_views
    from tmca.plots.light_field import light_field_figure

    camera = estimate.camera
    scene = None if truth is None else fit_views(_first(truth), camera.views, camera.size, "truth").values
    return light_field_figure({estimate.decoder: _array(estimate.values)}, scene)


def _draw_depth(estimate: Estimate, truth: Any) -> Figure:
    from tmca.data.fitting import fit_depth_scene
    from tmca.plots.depth import depth_figure

    assert estimate.depth is not None
    assert estimate.confidence is not None
    camera, near, far = estimate.camera, estimate.camera.planes.near, estimate.camera.planes.far
    pair = estimate.values[0].numpy(force=True), estimate.depth[0, 0].numpy(force=True)
    scene = None if truth is None else fit_depth_scene(truth, camera.wavelengths, camera.size, near, far, "truth")
    real = None if scene is None else (scene["radiance"].values, scene["depth"].values)
    confidence = estimate.confidence[0, 0].numpy(force=True)
    return depth_figure(estimate.decoder, pair, confidence, list(camera.wavelengths), (near, far), real)


def _draw_plain(estimate: Estimate, truth: Any) -> Figure:
    from tmca.plots.style import image_figure

    values = estimate.values[0].numpy(force=True)
    return image_figure(values.reshape(-1, *values.shape[-2:]).mean(0), estimate.decoder)


_DRAWINGS = {"spectral": _draw_cube, "light-field": _draw_views}
_LABELS = {"spectral": _cube, "light-field": _light_field}
