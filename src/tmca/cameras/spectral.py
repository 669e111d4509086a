"""The spectral camera: CASSI whose aperture and shutter change K times within one exposure (thesis chapter 4)."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor, nn

from tmca.cameras.checks import band_wavelengths
from tmca.cameras.coded import CodedCamera
from tmca.cameras.presets import SPECTRAL
from tmca.cameras.specs import SpectralSpec
from tmca.cameras.stored import (
    check_complete,
    code_planes,
    code_settings,
    common_attributes,
    json_attribute,
    made_from,
    tensors,
    wavelength_coordinates,
)
from tmca.codes import Codes
from tmca.errors import DataError, SettingError, ShapeError, check_choice
from tmca.operators import (
    LinearOperator,
    SensorColumns,
    SlotwiseDisperser,
    TapOperator,
    coloured_code,
    dual_disperser,
    single_disperser,
    sum_by_channel,
)
from tmca.optics import Dispersion, gaussian_spread

if TYPE_CHECKING:
    import xarray as xr

DISPERSERS = ("single", "dual")


class SpectralCamera(CodedCamera):
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
        coding: parts of the description of the codes, see ``Codes``: ``aperture``, ``shutter``, ``period``, ….

    Raises:
        SettingError, ShapeError: an impossible value or codes that do not fit, naming both sizes.
    """

    kind = "spectral"
    channel = "band"
    presets = SPECTRAL
    Spec = SpectralSpec
    needed = ("aperture", "shutter", "displacement", "response", "wavelength")
    stated = ("exposure", "disperser", "origin", "full_scale", "sensor")
    page = "docs/spectral.md"
    coloured: Tensor | None

    def __init__(
        self,
        bands: int | Sequence[float] | None = None,
        size: tuple[int, int] | None = None,
        slots: int = 8,
        *,
        codes: Codes | nn.Module | None = None,
        exposure: str = "equal",
        dispersion: float | Sequence[float] | Dispersion = 1.0,
        disperser: str = "single",
        response: Tensor | Sequence[float] | None = None,
        relay_blur: float | list[float] = 0.0,
        sensor: nn.Module | None = None,
        coloured: Tensor | None = None,
        beside: tuple[int, int] = (0, 0),
        **coding: Any,
    ) -> None:
        if coloured is not None:
            slots, codes, coding = 1, Codes(aperture="open", shutter="open"), {}
        super().__init__((256, 256) if size is None else size, slots, exposure, sensor)
        self.unbound = frozenset(name for name, value in (("bands", bands), ("size", size)) if value is None)
        self.wavelengths = band_wavelengths(12 if bands is None else bands)
        self.bands = len(self.wavelengths)
        check_choice("disperser", disperser, DISPERSERS)
        self.disperser, self.beside = disperser, beside
        self._per_band = dispersion
        self.dispersion = Dispersion.of(dispersion, self.bands)
        self.relay_blur = relay_blur
        gaussian_spread(relay_blur, self.bands)  # refuses a wrong one before anything is imaged
        if self.blurred and disperser == "dual":
            raise SettingError("disperser", "'dual' with relay blur", "'single', or no blur")
        self._hold_response(response)
        if coloured is not None:
            self._check_coloured(coloured)
        self.register_buffer("coloured", coloured)
        wide = (self.size[0], self.size[1] + self.dispersion.spread - sum(beside))
        self._hold_codes(codes, *((self.size, wide) if disperser == "single" else (wide, self.size)), **coding)

    def arguments(self) -> dict[str, Any]:
        """See ``Camera``."""
        bound = "bands" not in self.unbound
        return {
            "bands": self.wavelengths if bound else None, "size": None if "size" in self.unbound else self.size,
            "slots": self.slots, "codes": self._codes_argument(), "exposure": self.exposure,
            "dispersion": self.dispersion if bound else self._per_band, "disperser": self.disperser,
            "response": self.response if bound or self._responds else None, "relay_blur": self.relay_blur,
            "sensor": self.sensor, "coloured": self.coloured, "beside": self.beside,
        }  # fmt: skip

    @property
    def channel_names(self) -> list[str]:
        """Wavelengths of the bands."""
        return [f"{w * 1e9:.0f} nm" for w in self.wavelengths]

    def code_cube(self) -> Tensor:
        """(L, H, W) the time-multiplexed code T̂ of eq. (20), without the sensor response; for a fractional
        displacement, the sum over its two taps."""
        if self.coloured is not None:
            return self.coloured
        build = single_disperser if self.disperser == "single" else dual_disperser
        taps = build(*self._wide_codes(), self.dispersion, None, self.exposure).taps
        return sum_by_channel(taps.code, taps.channels, self.bands)

    @property
    def scene_shape(self) -> tuple[int, int, int]:
        """(L, H, W)."""
        return (self.bands, *self.size)

    @property
    def snapshot_shape(self) -> tuple[int, int, int]:
        """(1, H, W'): wider than the scene behind a single disperser."""
        wider = self.dispersion.spread - sum(self.beside) if self.disperser == "single" else 0
        return (1, self.size[0], self.size[1] + wider)

    @property
    def blurred(self) -> bool:
        """Whether the relay optics blur, which keeps the slots apart and makes the operator slower."""
        return bool(torch.as_tensor(self.relay_blur).gt(0).any())

    def build_operator(self, depth: Tensor | None = None) -> LinearOperator:
        """See ``Camera``."""
        if depth is not None:
            raise SettingError("depth", "a depth map", "none for a spectral camera")
        return self._slotwise(moving=False) if self.blurred else self._on_sensor(self._collapsed())

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

    def label(self, scenes: Tensor, name: str = "", unit: str = "relative irradiance") -> xr.DataArray:
        """See ``Camera``: (wavelength, y, x)."""
        import xarray as xr

        attrs = {"quantity": unit, "units": "1", "long_name": name}
        coordinates = wavelength_coordinates(self.wavelengths)
        return xr.DataArray(scenes[0].numpy(force=True), coordinates, ("wavelength", "y", "x"), attrs=attrs)

    def snapshot_axes(self, snapshots: Tensor) -> tuple[str, ...]:
        """See ``Camera``."""
        return ("y", "x_sensor" if self.disperser == "single" else "x")

    def variables(self) -> xr.Dataset:
        """``aperture`` (slot, y, x), ``shutter`` (slot, y, x_sensor), ``displacement`` and ``response`` (wavelength),
        for a coloured aperture ``coloured_aperture`` (wavelength, y, x); behind a dual disperser the aperture is the
        wider plane (x_mask). Attributes: exposure, direction and origin of the dispersion, sensor."""
        import xarray as xr

        x_aperture, x_sensor = ("x", "x_sensor") if self.disperser == "single" else ("x_mask", "x")
        displaced = {"units": "pixel", "direction": "along x, towards larger x"}
        parts: dict[str, Any] = {
            **code_planes(self, ("y", x_aperture), ("y", x_sensor)),
            "displacement": ("wavelength", np.array(self.dispersion.displacement), displaced),
            "response": ("wavelength", self.response.numpy(force=True), {"long_name": "sensor response"}),
        }
        if self.coloured is not None:
            meaning = {"long_name": "transmittance", "units": "1"}
            parts["coloured_aperture"] = (("wavelength", "y", "x"), self.coloured.numpy(force=True), meaning)
        coordinates = wavelength_coordinates(self.wavelengths)
        if self.disperser == "single":
            columns = self.dispersion.origin + np.arange(self.snapshot_shape[2])
            coordinates["x_sensor"] = ("x_sensor", columns, {"units": "pixel", "long_name": "scene column"})
        optics = {"disperser": self.disperser, "dispersion_axis": "x", "origin": self._origin}
        attrs = {**common_attributes(self), **optics, "relay_blur": json.dumps(self.relay_blur)}
        return xr.Dataset(parts, coordinates, attrs)

    @classmethod
    def from_variables(cls, dataset: xr.Dataset, where: str) -> SpectralCamera:
        """See ``Camera``."""
        check_complete(dataset, where, cls)
        for name, choices in (("disperser", DISPERSERS), ("dispersion_axis", ("x",))):
            if dataset.attrs.get(name, choices[0]) not in choices:
                stated = f"{name} = {dataset.attrs[name]!r}"
                raise DataError(where, stated, f"one of {', '.join(choices)}", "correct the attribute")
        settings, dual = code_settings(dataset, where), dataset.attrs["disperser"] == "dual"
        coloured = dataset.get("coloured_aperture")
        camera = made_from(
            cls, dataset, where, "aperture, shutter and displacement that fit",
            bands=dataset["wavelength"].values.tolist(),
            size=tuple(settings["shutter" if dual else "aperture"].shape[-2:]),
            dispersion=dataset["displacement"].values.tolist(),
            disperser=dataset.attrs["disperser"],
            response=tensors(dataset, "response")["response"],
            relay_blur=json_attribute(dataset.attrs, "relay_blur", 0.0, where),
            coloured=None if coloured is None else torch.tensor(
                coloured.transpose("wavelength", "y", "x").values, dtype=torch.float32
            ),
            **settings,
        )  # fmt: skip
        camera._check_origin(dataset, where)
        return camera

    @property
    def _origin(self) -> int:
        """Scene column on which sensor column 0 lies; a dual disperser displaces nothing on the sensor."""
        return self.dispersion.origin if self.disperser == "single" else 0

    def _check_origin(self, dataset: xr.Dataset, where: str) -> None:
        """What a file says of its origin must be what its displacement says."""
        stated = [dataset.attrs["origin"]]
        if "x_sensor" in dataset.coords:
            stated.append(dataset["x_sensor"].values[0])
        for value in stated:
            if value != self._origin:
                remedy = "correct the displacement or the origin (and x_sensor)"
                raise DataError(where, f"origin {value}", f"{self._origin} from the displacement", remedy)

    def _geometry(self) -> tuple[object, ...]:
        return (self.dispersion, str(self.relay_blur))

    def _collapsed(self) -> TapOperator:
        if self.coloured is not None:
            return coloured_code(self.coloured, self.dispersion, self.response)
        build = single_disperser if self.disperser == "single" else dual_disperser
        return build(*self._wide_codes(), self.dispersion, self.response, self.exposure)

    def _wide_codes(self) -> tuple[Tensor, Tensor]:
        """Aperture and shutter, dark beside the sensor."""
        aperture, shutter = self.codes()
        return aperture, torch.nn.functional.pad(shutter, self.beside) if any(self.beside) else shutter

    def _on_sensor(self, operator: LinearOperator) -> LinearOperator:
        return SensorColumns(operator, self.beside) if any(self.beside) else operator

    def _slotwise(self, part: tuple[int, int, int, int] | None = None, *, moving: bool) -> LinearOperator:
        if self.disperser == "dual" or self.coloured is not None:
            other = "'dual'" if self.disperser == "dual" else "a coloured aperture"
            raise SettingError("disperser", other, "'single' and binary codes for relay blur or a moving scene")
        top, left, height, width = part or (0, 0, *self.size)
        aperture, shutter = (plane[:, top : top + height, left:] for plane in self._wide_codes())
        planes = aperture[..., :width], shutter[..., : width + self.dispersion.spread]
        blur = gaussian_spread(self.relay_blur, self.bands).to(self.response) if self.blurred else None
        slotwise = SlotwiseDisperser(*planes, self.dispersion, self.response, self.exposure, blur, moving)
        return self._on_sensor(slotwise)

    def _check_coloured(self, code: Tensor) -> None:
        expected = (self.bands, *self.size)
        if tuple(code.shape) != expected:
            raise ShapeError("coloured", f"shape {tuple(code.shape)}", f"{expected}: bands and size of the scene")
        if not bool(torch.isfinite(code).all()) or code.min() < 0 or code.max() > 1:
            raise SettingError("coloured", "values outside [0, 1]", "transmittances", "scale the patterns")
        if self.disperser == "dual" or self.blurred:
            raise SettingError("coloured", "a dual disperser or relay blur beside it", "a single disperser, no blur")

    def _hold_response(self, response: Tensor | Sequence[float] | None) -> None:
        self._responds = response is not None
        values = torch.ones(self.bands) if response is None else response
        values = values if isinstance(values, Tensor) else torch.tensor(list(values), dtype=torch.get_default_dtype())
        if values.shape != (self.bands,):
            raise ShapeError("response", f"shape {tuple(values.shape)}", f"({self.bands},), one value per band")
        numbers = values.detach()
        if not bool(torch.isfinite(numbers).all()) or numbers.min() < 0 or numbers.max() <= 0:
            raise SettingError("response", str(numbers.tolist()), "finite numbers ≥ 0, not all zero")
        if isinstance(values, nn.Parameter):
            self.response = values
        else:
            self.register_buffer("response", values)
