"""What every camera is: K slots of one exposure, an operator, a sensor that records, and variables for files."""

from __future__ import annotations

import dataclasses
import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar

import numpy as np
import torch
from torch import Tensor, nn

from tmca.arguments import Count, FromArguments, Size, checked
from tmca.attributes import attributes_of
from tmca.cameras.attributes import CameraAttributes, CodedAttributes
from tmca.codes import Codes, MultiplexedCodes, bucket_shutters, fitted_codes
from tmca.codes.files import TILE, Axes, by_bucket, code_variables, tensors
from tmca.errors import DataError, SettingError, check_choice, check_shape
from tmca.operators import EXPOSURES, LinearOperator, TapOperator, Taps, exposure_weight
from tmca.sensor import Noise, Sensor, band_wavelengths, channel_weights
from tmca.specs import CameraSpec

if TYPE_CHECKING:
    import xarray as xr

T = TypeVar("T")
CAMERAS: dict[str, type[Camera]] = {}
"""Cameras by their kind."""

CODING = tuple(Codes.__dataclass_fields__)
"""Parts of the description of codes, which constructors also take one by one."""


class Camera(FromArguments, nn.Module, ABC):
    """Scene → optics of slot k → shutter of slot k → mean over slots → sensor (thesis eqs 4, 5).

    A new camera is one subclass: it names its ``kind``, says what its scene and its snapshot look like, builds its
    operator, and writes and reads its variables. Its parts are not assigned from outside: ``replace`` gives a camera
    with others.
    """

    kind: ClassVar[str]  # in files and on the command line
    channel: ClassVar[str]  # what a channel of the scene is: band or view
    Spec: ClassVar[type[CameraSpec]] = CameraSpec  # what describes one in text: options, YAML, axes of sweeps
    decoders: ClassVar[frozenset[str]] = frozenset()  # names of those that decode it without naming its kind
    from_scene: ClassVar[tuple[str, ...]] = ("size",)  # arguments that a scene gives where they are left out
    plane_names: ClassVar[tuple[str, str]] = ("aperture", "shutter")  # what its codes are patterns of
    needed: ClassVar[tuple[str, ...]]  # variables of a file without which it makes no camera
    attributes: ClassVar[type[CameraAttributes]] = CameraAttributes  # without which nobody knows what those mean
    views: tuple[int, int] | None = None  # (V, U), where the channels of a scene are views
    wavelengths: tuple[float, ...] = ()  # metres, where they are bands
    dispersion_extent: int = 0  # columns from where the first band lies to where the last one does
    psf_window: tuple[int, int] | None = None  # of a camera of depth, which has the tile_size of its codes too

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        if "kind" in cls.__dict__:
            CAMERAS[cls.kind] = cls

    @checked
    def __init__(self, size: Size, slots: Count, exposure: str, sensor: nn.Module | None, buckets: Count = 1) -> None:
        super().__init__()
        self.size, self.slots, self.buckets = size, slots, buckets
        check_choice("exposure", exposure, EXPOSURES)
        self.exposure = exposure
        self.sensor: Sensor = sensor or Sensor()  # type: ignore[assignment]
        self.unbound = frozenset(name for name in self.from_scene if self._given.get(name) is None)
        self._cache: dict[str, tuple[tuple[object, ...], Any]] = {}

    def __getattr__(self, name: str) -> Tensor | nn.Module:
        """What torch holds; of a property that failed, which torch would say is not there, what it lacks."""
        part = getattr(type(self), name, None)
        if not isinstance(part, property):
            return super().__getattr__(name)
        assert part.fget is not None
        try:
            return part.fget(self)
        except AttributeError as error:
            where = f"{type(self).__name__}.{name}"
            raise SettingError(
                where, str(error), "all that it uses", "set it in __init__, before it is used"
            ) from error

    @property
    @abstractmethod
    def scene_shape(self) -> tuple[int, ...]:
        """Of a scene, without the batch."""

    @property
    @abstractmethod
    def snapshot_shape(self) -> tuple[int, int, int]:
        """(C, H, W')."""

    @property
    @abstractmethod
    def white(self) -> float:
        """Level of a white scene with everything open in one exposure time, snapshot units."""

    @property
    @abstractmethod
    def channel_names(self) -> list[str]:
        """What each channel of the scene is, in a few words."""

    @abstractmethod
    def throughput(self) -> float:
        """Share of a white scene's light that is recorded under equal exposure."""

    @abstractmethod
    def build_operator(self, depth: Tensor | None = None) -> LinearOperator:
        """The linear part of the present codes, on scenes (B, channels, H, W); ``depth`` (B, 1, H, W) in metres."""

    @abstractmethod
    def label(self, scenes: Tensor, name: str = "", unit: str = "relative irradiance") -> xr.DataArray:
        """Scenes (B, *scene_shape) of this camera as a labelled array: the first of the batch, or all its colours."""

    @abstractmethod
    def _variables(self, tiled: bool) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
        """Variables, coordinates and attributes of codes and optics; codes that repeat as one tile if ``tiled``."""

    @classmethod
    @abstractmethod
    def _settings(cls, dataset: xr.Dataset, where: str) -> dict[str, Any]:
        """Arguments of the constructor of ``variables``, without exposure and sensor."""

    def variables(self, tiled: bool = False) -> xr.Dataset:
        """Codes, optics and sensor, labelled, for files; ``tiled``: codes that repeat as one tile, for any size."""
        import xarray as xr

        from tmca import __version__

        parts, coordinates, attributes = self._variables(tiled)
        common = {
            "camera": self.kind, "exposure": self.exposure, "full_scale": self.full_scale,
            "sensor": json.dumps(self.sensor.settings()), "tmca_version": __version__,
        }  # fmt: skip
        size = {"size": json.dumps(self.size)} if tiled else {}
        buckets = {"buckets": self.buckets} if self.buckets > 1 else {}
        return xr.Dataset(parts, coordinates, {**common, **attributes, **size, **buckets})

    @classmethod
    def from_variables(cls, dataset: xr.Dataset, where: str, **changes: Any) -> Self:
        """The camera of ``variables``; ``changes`` replace its arguments, such as ``size`` where codes repeat.

        Raises:
            DataError: variables that make no camera; ``where`` names their file.
        """
        stated = attributes_of(cls.attributes, dataset.attrs, where)
        try:
            settings: dict[str, Any] = {"exposure": stated.exposure, **cls._settings(dataset, where)}
            settings |= {} if stated.size is None else {"size": stated.size}
            settings |= {} if stated.buckets == 1 else {"buckets": stated.buckets}
            settings["sensor"] = Sensor(**stated.sensor)
            return cls(**{**settings, **changes})
        except (ValueError, TypeError, IndexError, RuntimeError, KeyError) as error:
            expected = f"{', '.join(cls.needed)} and sensor that fit"
            raise DataError(where, f"codes that make no camera ({error})", expected) from error

    def snapshot_axes(self, snapshots: Tensor) -> tuple[str, ...]:
        """Names of the axes of snapshots (B, C, H, W') in a file, those of length one left out."""
        return (*(("bucket",) if self.buckets > 1 else ()), "y", "x")

    def extra_repr(self) -> str:
        """What the text of the camera begins with."""
        return f"slots={self.slots}, buckets={self.buckets}"

    @property
    def learnable(self) -> bool:
        """Whether anything of the camera is learned."""
        return any(True for _ in self.parameters())

    @property
    def exposures(self) -> int:
        """Exposure times that are accumulated: K per slot."""
        return round(self.slots * exposure_weight(self.exposure, self.slots))

    @property
    def full_scale(self) -> float:
        """Level of a white scene with everything open, snapshot units: ``white``, K times that per slot."""
        return self.white * self.exposures

    @property
    def noise(self) -> Noise:
        """Read and shot noise in snapshot units."""
        return self.sensor.noise(self.white, self.exposures)

    def record(self, irradiance: Tensor, generator: torch.Generator | int | None = None) -> Tensor:
        """What the sensor makes of exact irradiance of any shape: noise, saturation, converter."""
        recorded: Tensor = self.sensor(irradiance, self.white, generator, self.exposures)
        return recorded

    def operator(self, depth: Tensor | None = None) -> LinearOperator:
        """``build_operator``; without depth cached until a tensor of the camera changes, unless it is learned."""
        if depth is not None:
            return self.build_operator(depth)
        return self.cached("operator", self.build_operator)

    def cached(self, name: str, build: Callable[[], T]) -> T:
        """What depends on the camera alone, built once until a tensor of it changes; anew while it is learned."""
        if self.learnable:
            return build()
        state = (self.exposure, *((t.data_ptr(), t._version) for t in self.buffers()))
        if name not in self._cache or self._cache[name][0] != state:
            self._cache[name] = (state, build())
        value: T = self._cache[name][1]
        return value

    def A(self, scene: Tensor, depth: Tensor | None = None) -> Tensor:
        """Scene (B, *scene_shape), at depth (B, 1, H, W) if the camera images it → exact snapshot (B, C, H, W')."""
        check_shape("scene", scene, ("batch", *self.scene_shape), "give the camera its size, or crop it")
        return self.operator(depth).A(scene.flatten(1, -3))

    def A_adjoint(self, snapshot: Tensor, depth: Tensor | None = None) -> Tensor:
        """Snapshot (B, C, H, W') → scene, the transpose of ``A``."""
        remedy = "give the camera as many buckets and channels, or take those of this camera"
        check_shape("snapshot", snapshot, ("batch", *self.snapshot_shape), remedy)
        return self.operator(depth).A_adjoint(snapshot).unflatten(1, self.scene_shape[:-2])

    def A_dagger(self, snapshot: Tensor, depth: Tensor | None = None) -> Tensor:
        """Snapshot → least-norm scene that explains it."""
        return self.operator(depth).A_dagger(snapshot).unflatten(1, self.scene_shape[:-2])

    def exact(
        self, scene: Tensor, depth: Tensor | None = None, progress: Callable[[float], None] | None = None
    ) -> Tensor:
        """Exact snapshot (B, C, H, W') of a scene that stands still or moves; arguments as ``forward``."""
        return self.A(scene, depth)

    def forward(
        self,
        scene: Tensor,
        depth: Tensor | None = None,
        *,
        generator: torch.Generator | int | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Tensor:
        """Take a snapshot: the exact one, then the sensor.

        Args:
            scene: (B, *scene_shape) relative irradiance, or (B, K, *scene_shape) where it changes from slot to slot.
            depth: (B, 1, H, W) metres where the camera images depth, (B, K, 1, H, W) beside a scene that changes.
            generator: source of the sensor's randomness, or a seed.
            progress: called with the share that is done, where that takes long.

        Returns:
            (B, C, H, W') snapshot.
        """
        return self.record(self.exact(scene, depth, progress), generator)

    def _shared(self, parts: set[str]) -> dict[str, Any]:
        """Arguments that a camera with other parts takes over as they are now, not as they were given."""
        return {**super()._shared(parts), "sensor": self.sensor}

    def _apply(self, fn: Any, recurse: bool = True) -> Self:
        self._cache.clear()

        def keep_complex(tensor: Tensor) -> Tensor:  # .to(torch.float64) would drop the imaginary part of fields
            return tensor.to(fn(tensor.real.new_empty(0)).device) if tensor.is_complex() else fn(tensor)

        return super()._apply(keep_complex, recurse)


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
            "wavelength": ("wavelength", metres, {"units": "m"}),
            "wavelength_nm": ("wavelength", metres * 1e9, {"units": "nm"}),
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
            raise SettingError("relay_blur", "some", "none where one code stands for all slots")
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
