"""Cameras of bands, and cameras of one code for every channel of the scene."""

from __future__ import annotations

import dataclasses
import json
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import torch
from torch import Tensor, nn

from tmca.attributes import attributes_of
from tmca.cameras.attributes import CodedAttributes
from tmca.cameras.camera import Camera
from tmca.codes import Codes, MultiplexedCodes, bucket_shutters, fitted_codes
from tmca.codes.files import TILE, Axes, by_bucket, code_variables, tensors
from tmca.errors import SettingError
from tmca.operators import LinearOperator, TapOperator, Taps
from tmca.sensor import band_wavelengths, channel_weights

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from tmca.plots.thumbnails import Panel

CORNER = 48
"""Pixels of codes that are drawn along each side."""
CODING = tuple(Codes.__dataclass_fields__)
"""Parts of the description of codes, which constructors also take one by one."""


class BandCamera(Camera):
    """A camera of scenes (B, L, H, W) in L bands, given by their number or their ``wavelengths`` in metres."""

    channel = "band"
    from_scene = ("bands", "size")

    def _hold_bands(self, bands: int | Sequence[float]) -> None:
        self.wavelengths = band_wavelengths(bands)
        self.bands = len(self.wavelengths)

    @property
    def scene_shape(self) -> tuple[int, int, int]:
        """(L, H, W)."""
        return (self.bands, *self.size)

    @property
    def channel_names(self) -> list[str]:
        """Wavelengths of the bands."""
        return [f"{w * 1e9:.0f} nm" for w in self.wavelengths]

    def fitted(self, scene: Any) -> Any:
        """See ``Camera``; the nearest band for every wavelength."""
        from tmca.data.fitting import fit_cube

        return fit_cube(scene, self.wavelengths, self.size)

    def label(self, scenes: Tensor, name: str = "", unit: str = "relative irradiance") -> xr.DataArray:
        """The first scene as (wavelength, y, x)."""
        import xarray as xr

        attrs = {"quantity": unit, "units": "1", "long_name": name}
        return xr.DataArray(
            scenes[0].numpy(force=True), self._band_coordinates(), ("wavelength", "y", "x"), attrs=attrs
        )

    def _band_coordinates(self) -> dict[str, Any]:
        metres = np.array(self.wavelengths)
        return {
            "wavelength": ("wavelength", metres, {"units": "m", "long_name": "wavelength"}),
            "wavelength_nm": ("wavelength", metres * 1e9, {"units": "nm", "long_name": "wavelength"}),
        }


class CodedCamera(Camera):
    """A camera of one code per channel of the scene (thesis eqs 12, 20), whose weights are the ``response``."""

    response: Tensor
    codes: MultiplexedCodes
    drawn: ClassVar = {"transmittance": ("aperture",), "duty": ("shutter",), "seed": ("aperture", "shutter")}

    def _hold_codes(
        self, codes: Codes | nn.Module | None, aperture: tuple[int, int], shutter: tuple[int, int], /, **coding: Any
    ) -> None:
        for name in coding:
            if name not in CODING:
                expected = f"one of {', '.join(self._arguments())}"
                raise SettingError(name, "an unknown name", expected, "leave it out")
        self.codes = fitted_codes(codes, self.slots, aperture, shutter, self.buckets, **coding)  # type: ignore[assignment]
        described = codes if isinstance(codes, nn.Module) else dataclasses.replace(codes or Codes(), **coding)
        self._given = {n: part for n, part in self._given.items() if n not in CODING} | {"codes": described}

    @classmethod
    def _arguments(cls) -> tuple[str, ...]:
        return *(name for name in super()._arguments() if name != "coding"), *CODING

    def _described(self, parts: Mapping[str, Any]) -> dict[str, Any]:
        coding = parts.get("codes", self._given["codes"])
        planes = vars(coding) if isinstance(coding, Codes) else {"aperture": coding, "shutter": coding}
        return {**planes, **super()._described(parts)}

    def _shared(self, parts: set[str]) -> dict[str, Any]:
        """Codes of a named family are drawn anew where their description or their size changes."""
        coding = self._given["codes"]
        if not isinstance(coding, nn.Module):
            families = isinstance(coding.aperture, str) and isinstance(coding.shutter, str)
            whole_frame = families and coding.period is None
            if self.unbound or parts & {*CODING, "slots", *(("size",) if whole_frame else ())}:
                return super()._shared(parts)
        return {**super()._shared(parts), "codes": self.codes}

    def _hold_response(self, values: Any, where: str, shape: tuple[int, ...]) -> None:
        values = channel_weights(where, values, shape)
        if isinstance(values, nn.Parameter) and values.ndim == 1:
            self.response = values
        else:
            self.register_buffer("response", values.flatten())

    def bucket_codes(self) -> tuple[Tensor, Tensor]:
        """Aperture (K, H, Wa), and the shutters (R, K, H, W') of every bucket of the pixels."""
        aperture, shutter = self.codes()
        return aperture, bucket_shutters(shutter, self.slots, self.buckets)

    @property
    def channels(self) -> int:
        """Number of bands or views of the scene."""
        return len(self.response)

    @property
    def white(self) -> float:
        """The summed response."""
        return float(self.response.detach().sum())

    @abstractmethod
    def code_cube(self) -> Tensor:
        """The time-multiplexed code T̂ of every channel; with several buckets that of each of them, (R, …)."""

    def _panels(self) -> list[Panel]:
        return self._plane_panels(self.codes())

    def plot(self, corner: int = CORNER) -> Figure:
        """Aperture T, shutter S and the code T̂ (thesis figure 19), a corner of ``corner`` pixels of each."""
        from tmca.plots.codes import codes_figure

        cube, (shown, shutters) = self.code_cube(), self.bucket_codes()
        cubes = cube.reshape(self.buckets, -1, *cube.shape[-2:])
        parts = (shown, shutters, cubes) if self.buckets > 1 else (shown, shutters[0], cubes[0])
        aperture, shutter, code = (plane.numpy(force=True) for plane in parts)
        size = f"{self.size[0]} × {self.size[1]}"
        if max(self.size) > corner:
            size = f"first {min(corner, self.size[0])} × {min(corner, self.size[1])} of {size}"
        buckets = f", {self.buckets} buckets" if self.buckets > 1 else ""
        title = f"{size} pixels, K = {self.slots}{buckets}, light throughput {self.throughput():.1%}"
        return codes_figure(aperture, shutter, code, self.channel_names, title, corner)

    def throughput(self) -> float:
        """Mean of T̂ under equal exposure, summed over the buckets."""
        with torch.no_grad():
            return float(self.code_cube().mean()) * self.buckets / self.exposures

    def _check_no_depth(self, depth: Tensor | None) -> None:
        if depth is not None:
            raise SettingError("depth", "a depth map", f"none for a {self.kind} camera")

    def taps(self) -> Taps:
        """The collapsed code with the response folded in; SettingError for optics that keep the slots apart."""
        operator = self.operator()
        if not isinstance(operator, TapOperator):
            wanted = "none where one code stands for all slots"
            raise SettingError("relay_blur", "some", wanted, "admm-tv and pnp-subspace decode it")
        return operator.taps

    def window(self, top: int, left: int, height: int, width: int) -> LinearOperator:
        """The operator of scenes (B, channels, height, width), dark around, behind a part of the codes."""
        return TapOperator(self.taps().window(top, left, height, width))

    def moving_window(self, top: int, left: int, height: int, width: int) -> LinearOperator:
        """The operator of scenes (B, K, channels, height, width) that move, where the camera has it for a part."""
        raise SettingError("motion", "some", f"none behind a part of a {self.kind} camera")

    def _planes(self, tiled: bool, aperture: Axes, shutter: Axes) -> tuple[dict[str, Any], dict[str, Any]]:
        """Variables of both planes on these axes, and the attribute of their period."""
        planes, period = self.codes(), getattr(getattr(self.codes, "aperture", None), "period", None)
        if tiled and period is not None:
            planes, aperture, shutter = (self.codes.aperture.tile(), self.codes.shutter.tile()), TILE, TILE
        shown, shutter = by_bucket(planes[1], self.slots, shutter)
        return code_variables((planes[0], shown), aperture, shutter), {"period": json.dumps(period)}

    @classmethod
    def _settings(cls, dataset: xr.Dataset, where: str) -> dict[str, Any]:
        planes = tensors(dataset, where, "aperture", "shutter")
        stated = attributes_of(CodedAttributes, dataset.attrs, where)
        return {**planes, "slots": len(planes["aperture"]), "period": stated.period}
