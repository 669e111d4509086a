"""What every camera is: K slots of one exposure, an operator, a sensor that records, and variables for files."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar

import torch
from torch import Tensor, nn

from tmca.arguments import Count, FromArguments, Size, checked
from tmca.attributes import attributes_of
from tmca.cameras.attributes import CameraAttributes
from tmca.errors import DataError, SettingError, check_choice, check_shape
from tmca.operators import EXPOSURES, LinearOperator, exposure_weight
from tmca.plugins import take
from tmca.sensor import Noise, Sensor
from tmca.specs import CameraSpec
from tmca.summaries import Summary, range_nm, sizes

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from tmca.plots.thumbnails import Panel

T = TypeVar("T")
CAMERAS: dict[str, type[Camera]] = {}
"""Cameras by their kind."""

_VIEW_AXES = "rows and columns of views, rows, columns"
_CORNER = 64
"""Pixels along each side of codes that are shown."""


def _register(camera: type[Camera]) -> None:
    """Raises SettingError for a kind that a camera of another module has."""
    before = CAMERAS.get(camera.kind)
    if before is not None and before.__module__ != camera.__module__:
        raise SettingError(
            f"{camera.__name__}.kind", f"{camera.kind!r}, which {before.__module__} has", "one of its own"
        )
    CAMERAS[camera.kind] = camera


class Camera(Summary, FromArguments, nn.Module, ABC):
    """Scene → optics of slot k → shutter of slot k → mean over slots → sensor (thesis eqs 4, 5).

    A new camera is one subclass: it names its ``kind``, says what its scene and its snapshot look like, builds its
    operator, and writes and reads its variables. Its parts are not assigned from outside: ``replace`` gives a camera
    with others.
    """

    kind: ClassVar[str]  # in files and on the command line
    channel: ClassVar[str]  # what a channel of the scene is, in a word: band, view, …
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
            take(cls, _register, "camera")

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

    def _facts(self) -> dict[str, str]:
        axes = _VIEW_AXES if self.views else f"{self.channel}s, rows, columns"
        known = {} if "size" in self.unbound else {"size": sizes(self.size)}
        return {
            **(known if self.unbound else {"scene": f"{sizes(self.scene_shape)} ({axes})"}),
            "bands": "" if "bands" in self.unbound else range_nm(self.wavelengths),
            "slots": f"K = {self.slots}, {self.exposure} exposure",
            "buckets": str(self.buckets),
            "noise": self.noise.in_words(),
            "not given": f"{' and '.join(sorted(self.unbound))}: those of the first scene" if self.unbound else "",
            "learned": "codes or response" if self.learnable else "",
        }

    def to_xarray(self) -> xr.Dataset:
        """Codes, optics and sensor, labelled: `variables`."""
        return self.variables()

    def plot(self) -> Figure:
        """What the camera shows; of one that does not say more the exact snapshot of a white scene."""
        return self._picture()

    def _picture(self) -> Figure:
        from tmca.plots.thumbnails import row_figure

        return row_figure(self._panels())

    def _panels(self) -> list[Panel]:
        """Small pictures of what it shows."""
        from tmca.plots.thumbnails import Panel

        with torch.no_grad():
            white = self.A(torch.ones(1, *self.scene_shape)).mean((0, 1)).numpy(force=True)
        return [Panel("a white scene", white, bar="snapshot units")]

    def _plane_panels(self, codes: tuple[Tensor, Tensor]) -> list[Panel]:
        """A part of what the aperture and the shutter show in the first slot."""
        from tmca.plots.thumbnails import Panel

        aperture, shutter = codes
        planes = zip(self.plane_names, (aperture, shutter.reshape(-1, *shutter.shape[-2:])), strict=True)
        shown = ((name, plane[0, :_CORNER, :_CORNER].numpy(force=True)) for name, plane in planes)
        return [Panel(f"{name}, slot 1 of {self.slots}", values, low=None) for name, values in shown]

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

    @property
    def tensor_versions(self) -> tuple[Any, ...]:
        """What differs as soon as a tensor of the camera is replaced or written over, or the exposure changes; tensors
        of `torch.inference_mode`, of which nobody counts the versions, only where they are replaced."""
        parts = (*self.buffers(), *self.parameters())
        return self.exposure, *((part.data_ptr(), 0 if part.is_inference() else part._version) for part in parts)

    def cached(self, name: str, build: Callable[[], T]) -> T:
        """What depends on the camera alone, built once until a tensor of it changes; anew while it is learned."""
        if self.learnable:
            return build()
        state = self.tensor_versions
        if name not in self._cache or self._cache[name][0] != state:
            self._cache[name] = (state, build())
        value: T = self._cache[name][1]
        return value

    def fitted(self, scene: Any) -> Any:
        """A labelled scene (xarray) at the camera's bands or views, the middle of it in the camera's size.

        Raises:
            DataError, SettingError: a scene that is smaller, or of another kind.
        """
        return scene

    def imaged(self, scene: Any, depth: Any = None) -> tuple[Tensor, Tensor | None]:
        """A scene of any form, and its depth, as tensors of the camera's type and device, with a batch.

        Args:
            scene: a tensor, a NumPy array or what becomes one, (B, *scene_shape) or *scene_shape; or a labelled scene,
                as `tmca.read` gives it, which is ``fitted``, with its depth if it has one.
            depth: (B, 1, H, W) or (H, W), of the same forms.
        """
        if isinstance(scene, Tensor) and scene.ndim > len(self.scene_shape) and isinstance(depth, Tensor | None):
            return scene, depth
        from tmca.data.in_memory import as_tensors

        tensor, *with_it = as_tensors(self.fitted(scene) if hasattr(scene, "dims") else scene)
        tensor = tensor[None] if tensor.ndim == len(self.scene_shape) else tensor
        if depth is not None:
            with_it = [as_tensors(depth, "depth")[0]]
        return self._alike(scene, tensor), self._alike(depth, with_it[0]) if with_it else None

    def _alike(self, given: Any, tensor: Tensor) -> Tensor:
        """A tensor as it was given, or on the camera's device and of its type."""
        own = next((one for one in self.buffers() if one.is_floating_point()), tensor)
        while tensor.ndim < 4:
            tensor = tensor[None]
        return tensor if isinstance(given, Tensor) else tensor.to(own.device, own.dtype)

    def A(self, scene: Any, depth: Any = None) -> Tensor:
        """Scene (B, *scene_shape), at depth (B, 1, H, W) if the camera images it → exact snapshot (B, C, H, W').

        Both may be what ``imaged`` takes: tensors, NumPy arrays, labelled scenes.
        """
        scene, depth = self.imaged(scene, depth)
        check_shape("scene", scene, ("batch", *self.scene_shape), "give the camera its size, or crop it")
        snapshot = self.operator(depth).A(scene.flatten(1, -3))
        if snapshot.shape[1:] != self.snapshot_shape:
            where, remedy = f"A of the operator of {type(self).__name__}", "mend either"
            check_shape(where, snapshot, (len(scene), *self.snapshot_shape), remedy)
        return snapshot

    def A_adjoint(self, snapshot: Any, depth: Any = None) -> Tensor:
        """Snapshot (B, C, H, W'), a tensor, an array or a `Snapshot` → scene, the transpose of ``A``."""
        snapshot, depth = self._recorded(snapshot, depth)
        remedy = "give the camera as many buckets and channels, or take those of this camera"
        check_shape("snapshot", snapshot, ("batch", *self.snapshot_shape), remedy)
        return self.operator(depth).A_adjoint(snapshot).unflatten(1, self.scene_shape[:-2])

    def A_dagger(self, snapshot: Any, depth: Any = None) -> Tensor:
        """Snapshot → least-norm scene that explains it."""
        snapshot, depth = self._recorded(snapshot, depth)
        return self.operator(depth).A_dagger(snapshot).unflatten(1, self.scene_shape[:-2])

    def _recorded(self, snapshot: Any, depth: Any) -> tuple[Tensor, Tensor | None]:
        """A snapshot of any form and the depth of its scene, as tensors of the camera's type and device."""
        if isinstance(snapshot, Tensor) and snapshot.ndim == 4 and isinstance(depth, Tensor | None):
            return snapshot, depth
        from tmca.data.in_memory import as_tensors

        tensors = (
            None if one is None else self._alike(one, as_tensors(one, name)[0])
            for one, name in ((snapshot, "snapshot"), (depth, "depth"))
        )
        first, second = tensors
        assert first is not None
        return first, second

    def exact(
        self, scene: Tensor, depth: Tensor | None = None, progress: Callable[[float], None] | None = None
    ) -> Tensor:
        """Exact snapshot (B, C, H, W') of a scene that stands still or moves; arguments as ``forward``."""
        return self.A(scene, depth)

    def forward(
        self,
        scene: Any,
        depth: Any = None,
        *,
        generator: torch.Generator | int | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Tensor:
        """Take a snapshot: the exact one, then the sensor.

        Args:
            scene: (B, *scene_shape) relative irradiance, or (B, K, *scene_shape) where it changes from slot to slot;
                tensors, NumPy arrays, or a labelled scene as `tmca.read` gives it, see ``imaged``.
            depth: (B, 1, H, W) metres where the camera images depth, (B, K, 1, H, W) beside a scene that changes.
            generator: source of the sensor's randomness, or a seed.
            progress: called with the share that is done, where that takes long.

        Returns:
            (B, C, H, W') snapshot.
        """
        return self.record(self.exact(*self.imaged(scene, depth), progress), generator)

    def _shared(self, parts: set[str]) -> dict[str, Any]:
        """Arguments that a camera with other parts takes over as they are now, not as they were given."""
        return {**super()._shared(parts), "sensor": self.sensor}

    def _apply(self, fn: Any, recurse: bool = True) -> Self:
        self._cache.clear()

        def keep_complex(tensor: Tensor) -> Tensor:  # .to(torch.float64) would drop the imaginary part of fields
            return tensor.to(fn(tensor.real.new_empty(0)).device) if tensor.is_complex() else fn(tensor)

        return super()._apply(keep_complex, recurse)


def in_a_line(camera: Any) -> str:
    """Kind, slots and bands of a camera in a few words."""
    views = "" if camera.views is None else f", {sizes(camera.views)} views"
    bands = f", {len(camera.wavelengths)} bands, {range_nm(camera.wavelengths)}" if camera.wavelengths else ""
    buckets = f", {camera.buckets} buckets" if camera.buckets > 1 else ""
    return f"{camera.kind}, {sizes(camera.size)} pixels{bands}{views}, K = {camera.slots}{buckets}"
