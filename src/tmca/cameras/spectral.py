"""The spectral camera: CASSI whose aperture and shutter change K times within one exposure (thesis chapter 4)."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
import torch
from pydantic import Field, Json
from torch import Tensor, nn
from torch.nn.functional import pad

from tmca.arguments import Count, Float, Floats, Int, IntPair, Size, checked, described
from tmca.attributes import attributes_of
from tmca.cameras.attributes import CodedAttributes
from tmca.cameras.coded import BandCamera, CodedCamera
from tmca.codes import Codes, check_shares
from tmca.codes.arrays import Array
from tmca.codes.files import tensors
from tmca.errors import DataError, SettingError, check_choice, check_range, check_shape
from tmca.operators import (
    Buckets,
    LinearOperator,
    SensorColumns,
    SlotwiseDisperser,
    TapOperator,
    Taps,
    coloured_code,
    dual_disperser,
    of_buckets,
    single_disperser,
    sum_by_channel,
)
from tmca.optics import Dispersion, gaussian_psf
from tmca.specs import SpectralSpec

if TYPE_CHECKING:
    import xarray as xr

DISPERSERS = ("single", "dual")
_DISPLACED = "columns by which the disperser displaces a band"
PRESETS: dict[str, dict[str, Any]] = {
    # thesis 4.1, 4.2: 12 bands, 256×256, K = 8, one pixel per band. Assumed, as the thesis does not say: bands from
    # 400 to 700 nm, flat sensor response, codes of transmittance and duty one half, no noise.
    "thesis": {"bands": 12, "size": (256, 256), "slots": 8, "aperture": "random", "shutter": "random"},
    "cassi": {"bands": 12, "size": (256, 256), "slots": 1, "aperture": "static", "shutter": "open"},
    "one-hot": {"bands": 12, "size": (256, 256), "slots": 4, "aperture": "random", "shutter": "one-hot"},
    "two-bucket": {"bands": 12, "size": (256, 256), "slots": 4, "shutter": "balanced", "buckets": 2},
    # its rival of the same sensor: two frames one after the other
    "burst": {"bands": 12, "size": (256, 256), "slots": 2, "shutter": "burst", "buckets": 2},
}


_Blur = Annotated[float, Field(ge=0, le=1000)]


class SpectralAttributes(CodedAttributes):
    """What a file says of the spectral camera."""

    disperser: str
    dispersion_axis: Literal["x"] = "x"
    origin: float
    relay_blur: Json[_Blur | tuple[_Blur, ...]] = 0.0
    beside: Json[tuple[int, int]] = (0, 0)


class SpectralCamera(BandCamera, CodedCamera):
    """A snapshot spectral camera with a time-multiplexed coded aperture.

    ``e_{m,n} = (1/K) Σ_k S^k_{m,n} Σ_ℓ κ_ℓ T^k_{m,n-d_ℓ} f_{m,n-d_ℓ,ℓ}`` (thesis eqs 18–21, errata), then noise.
    With ``slots=1, shutter="open"`` it is CASSI.

    >>> camera = SpectralCamera(bands=12, size=(64, 80), slots=4, shutter="one-hot", sensor=Sensor(read_noise=0.01))
    >>> camera(torch.rand(1, 12, 64, 80), generator=0).shape
    torch.Size([1, 1, 64, 91])

    Args:
        bands: number of bands L, or their wavelengths in metres. A number means even spacing from 400 to 700 nm; left
            out, 12 until the camera is bound to a scene.
        size: (H, W) of the scene, pixels; left out, 256×256 until the camera is bound to a scene.
        slots: number of time slots K within the exposure.
        codes: aperture (K, H, W) and shutter (K, H, W'): their description, or a module that gives both.
        exposure: ``"equal"``: the slots share one exposure time (mean); ``"per-slot"``: each has its own (sum).
        dispersion: pixels per band, or the displacement of every band in pixels (negative, fractional, any order).
        disperser: ``"single"`` (mask, prism, sensor) or ``"dual"`` (prism, mask, opposite prism: nothing is displaced).
        response: (L,) sensor response κ; ones if None. A ``Parameter`` is learned.
        relay_blur: standard deviation of the relay's blur, pixels, one or one per band; 0 for none.
        sensor: noise, full well, bits; an ideal sensor if None.
        coloured: (L, H, W) transmittance of a static coloured aperture, which takes the place of the codes: an open
            shutter, one slot, a single disperser, no relay blur.
        beside: columns of the dispersed light that fall left and right of the sensor.
        buckets: R of a pixel: with one, the light of closed slots is lost; with two, it is in the second.
        coding: parts of the description of the codes, see ``Codes``: ``aperture``, ``shutter``, ``period``, ….

    Raises:
        SettingError, ShapeError: an impossible value or codes that do not fit, naming both sizes.
    """

    kind = "spectral"
    Spec = SpectralSpec
    presets = PRESETS
    needed = ("aperture", "shutter", "displacement", "response", "wavelength")
    attributes = SpectralAttributes
    coloured: Tensor | None

    @checked
    def __init__(
        self,
        bands: Int | Floats | None = None,
        size: Size | None = None,
        slots: Count = 8,
        *,
        codes: Codes | nn.Module | None = None,
        exposure: str = "equal",
        dispersion: Float | Floats | Dispersion = 1.0,
        disperser: str = "single",
        response: Array | Floats | None = None,
        relay_blur: Float | Floats = 0.0,
        sensor: Annotated[nn.Module | None, "a Sensor"] = None,
        coloured: Array | None = None,
        beside: IntPair = (0, 0),
        buckets: Count = 1,
        **coding: Any,
    ) -> None:
        if coloured is not None:
            slots, buckets, codes, coding = 1, 1, Codes(aperture="open", shutter="open"), {}
        super().__init__((256, 256) if size is None else size, slots, exposure, sensor, buckets)
        self._hold_bands(12 if bands is None else bands)
        check_choice("disperser", disperser, DISPERSERS)
        self.disperser, self.beside = disperser, beside
        self.dispersion = Dispersion.of(dispersion, self.bands)
        self.dispersion_extent = self.dispersion.extent
        self.relay_blur = relay_blur
        gaussian_psf(relay_blur, self.bands)  # refuses a wrong one before anything is imaged
        if self.blurred and disperser == "dual":
            raise SettingError("disperser", "'dual' with relay blur", "'single', or no blur")
        self._hold_response(torch.ones(self.bands) if response is None else response, "response", (self.bands,))
        if coloured is not None:
            self._check_coloured(coloured)
        self.register_buffer("coloured", coloured)
        self._check_beside()
        wide = (self.size[0], self.size[1] + self.dispersion.extent - sum(beside))
        self._hold_codes(codes, *((self.size, wide) if disperser == "single" else (wide, self.size)), **coding)

    def _shared(self, parts: set[str]) -> dict[str, Any]:
        coloured = {} if self.coloured is None else {"coloured": self.coloured}
        return {**super()._shared(parts), **({} if "bands" in parts else {"response": self.response}), **coloured}

    def code_cube(self) -> Tensor:
        """(L, H, W) the time-multiplexed code T̂ of eq. (20), without the sensor response; for a fractional
        displacement, the sum over its two taps. With several buckets (R, L, H, W)."""
        if self.coloured is not None:
            return self.coloured
        taps = self._coded(None).taps
        channels = taps.of_bucket(taps.channels)
        cubes = [sum_by_channel(code, channels, self.bands) for code in taps.bucket_code]
        return cubes[0] if self.buckets == 1 else torch.stack(cubes)

    @property
    def snapshot_shape(self) -> tuple[int, int, int]:
        """(R, H, W') of R buckets: wider than the scene behind a single disperser."""
        wider = self.dispersion.extent - sum(self.beside) if self.disperser == "single" else 0
        return (self.buckets, self.size[0], self.size[1] + wider)

    @property
    def blurred(self) -> bool:
        """Whether the relay optics blur, which keeps the slots apart and makes the operator slower."""
        return bool(torch.as_tensor(self.relay_blur).gt(0).any())

    def build_operator(self, depth: Tensor | None = None) -> LinearOperator:
        self._check_no_depth(depth)
        return self._slotwise(moving=False) if self.blurred else self._on_sensor(self._collapsed())

    def taps(self) -> Taps:
        """See ``CodedCamera``; SettingError for columns beside the sensor too."""
        if any(self.beside):
            raise SettingError("beside", f"{self.beside}", "(0, 0) where one code stands for all light")
        return super().taps()

    def exact(
        self, scene: Tensor, depth: Tensor | None = None, progress: Callable[[float], None] | None = None
    ) -> Tensor:
        """Exact snapshot of (B, L, H, W), or of (B, K, L, H, W) for a scene that changes from slot to slot."""
        return self._slotwise(moving=True).A(scene) if scene.ndim == 5 else super().exact(scene, depth)

    def window(self, top: int, left: int, height: int, width: int) -> LinearOperator:
        """See ``CodedCamera``; light that a relay throws beyond the part is lost."""
        part = (top, left, height, width)
        if self.blurred:
            return self._slotwise(part, moving=False)
        taps = self._collapsed().taps if any(self.beside) else self.taps()
        return self._on_sensor(TapOperator(taps.window(*part)))

    def moving_window(self, top: int, left: int, height: int, width: int) -> LinearOperator:
        """The operator of scenes (B, K, L, height, width) that move, behind a part of the codes."""
        return self._slotwise((top, left, height, width), moving=True)

    def snapshot_axes(self, snapshots: Tensor) -> tuple[str, ...]:
        bucket, row = super().snapshot_axes(snapshots)[:-2], "x_sensor" if self.disperser == "single" else "x"
        return (*bucket, "y", row)

    def _variables(self, tiled: bool) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
        """``aperture`` (slot, y, x), ``shutter`` (slot, y, x_sensor), ``displacement`` and ``response`` (wavelength),
        for a coloured aperture ``coloured_aperture`` (wavelength, y, x); behind a dual disperser the aperture is the
        wider plane (x_mask). Attributes: exposure, direction and origin of the dispersion, sensor."""
        single, origin = self.disperser == "single", self._origin
        axes = (("y", "x"), ("y", "x_sensor")) if single else (("y", "x_mask"), ("y", "x"))
        parts, attributes = self._planes(tiled, *axes)
        displaced = {"units": "pixel", "direction": "along x, towards larger x", "long_name": _DISPLACED}
        parts["displacement"] = ("wavelength", np.array(self.dispersion.displacement), displaced)
        weights = {"units": "1", "long_name": "sensor response"}
        parts["response"] = ("wavelength", self.response.numpy(force=True), weights)
        if self.coloured is not None:
            meaning = {"long_name": "transmittance of the coloured aperture", "units": "1"}
            parts["coloured_aperture"] = (("wavelength", "y", "x"), self.coloured.numpy(force=True), meaning)
        coordinates = self._band_coordinates()
        if single and not tiled:
            columns = origin + np.arange(self.snapshot_shape[2])
            coordinates["x_sensor"] = ("x_sensor", columns, {"units": "pixel", "long_name": "scene column"})
        optics = {"disperser": self.disperser, "dispersion_axis": "x", "origin": origin}
        optics |= {"relay_blur": json.dumps(self.relay_blur)}
        optics |= {"beside": json.dumps(self.beside)} if any(self.beside) else {}
        return parts, coordinates, {**attributes, **optics}

    @classmethod
    def _settings(cls, dataset: xr.Dataset, where: str) -> dict[str, Any]:
        settings, stated = super()._settings(dataset, where), attributes_of(SpectralAttributes, dataset.attrs, where)
        if "coloured_aperture" in dataset:
            transposed = dataset[["coloured_aperture"]].transpose("wavelength", "y", "x", ...)
            settings["coloured"] = tensors(transposed, where, "coloured_aperture")["coloured_aperture"]
        plane = settings["shutter" if stated.disperser == "dual" else "aperture"]
        return {
            **settings,
            "size": tuple(plane.shape[-2:]),
            "bands": dataset["wavelength"].values.tolist(),
            "dispersion": dataset["displacement"].values.tolist(),
            "disperser": stated.disperser,
            "response": tensors(dataset, where, "response")["response"],
            "relay_blur": stated.relay_blur,
            "beside": stated.beside,
        }

    @classmethod
    def from_variables(cls, dataset: xr.Dataset, where: str, **changes: Any) -> Self:
        """What a file says of its origin must be what its displacement says."""
        camera = super().from_variables(dataset, where, **changes)
        stated = attributes_of(SpectralAttributes, dataset.attrs, where).origin
        columns = dataset["x_sensor"].values.ravel()[:1].tolist() if "x_sensor" in dataset.coords else []
        for value in (stated, *columns):
            if value != camera._origin:
                remedy = "correct the displacement or the origin (and x_sensor)"
                raise DataError(where, f"origin {described(value)}", f"{camera._origin} from the displacement", remedy)
        return camera

    @property
    def _origin(self) -> int:
        """Scene column on which sensor column 0 lies; a dual disperser displaces nothing on the sensor."""
        return self.dispersion.origin + self.beside[0] if self.disperser == "single" else 0

    def _collapsed(self) -> TapOperator:
        if self.coloured is not None:
            return coloured_code(self.coloured, self.dispersion, self.response)
        return self._coded(self.response)

    def _coded(self, response: Tensor | None) -> TapOperator:
        build = single_disperser if self.disperser == "single" else dual_disperser
        aperture, shutters = self._wide_codes()
        return of_buckets([build(aperture, shown, self.dispersion, response, self.exposure) for shown in shutters])

    def _wide_codes(self) -> tuple[Tensor, Tensor]:
        """Aperture (K, H, W) and shutters (R, K, H, W') of the buckets, dark beside the sensor."""
        aperture, shutters = self.bucket_codes()
        return aperture, pad(shutters, self.beside) if any(self.beside) else shutters

    def _on_sensor(self, operator: LinearOperator) -> LinearOperator:
        return SensorColumns(operator, self.beside) if any(self.beside) else operator

    def _slotwise(self, part: tuple[int, int, int, int] | None = None, *, moving: bool) -> LinearOperator:
        if self.disperser == "dual" or self.coloured is not None:
            other = "'dual'" if self.disperser == "dual" else "a coloured aperture"
            raise SettingError("disperser", other, "'single' and binary codes for relay blur or a moving scene")
        top, left, height, width = part or (0, 0, *self.size)
        aperture, shutters = (plane[..., top : top + height, left:] for plane in self._wide_codes())
        aperture, shutters = aperture[..., :width], shutters[..., : width + self.dispersion.extent]
        blur = gaussian_psf(self.relay_blur, self.bands).to(self.response) if self.blurred else None
        how = (self.dispersion, self.response, self.exposure, blur, moving)
        return self._on_sensor(Buckets.of([SlotwiseDisperser(aperture, shown, *how) for shown in shutters]))

    def _check_beside(self) -> None:
        wide = self.dispersion.extent + self.size[1] - 1 if self.disperser == "single" else 0
        for columns in (min(self.beside), sum(self.beside)):
            check_range("beside", columns, 0, wide, unit="columns")

    def _check_coloured(self, code: Tensor) -> None:
        check_shape("coloured", code, (self.bands, *self.size))
        check_shares("coloured", code, "transmittances", "scale the patterns")
        if self.disperser == "dual" or self.blurred:
            raise SettingError("coloured", "a dual disperser or relay blur beside it", "a single disperser, no blur")
