"""What every camera is: K slots of one exposure, an operator, a sensor that records, and a description on disk."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar

import torch
from torch import Tensor, nn

from tmca.cameras.checks import checked_size
from tmca.errors import SettingError, ShapeError, check_choice
from tmca.operators import EXPOSURES, LinearOperator
from tmca.sensor import Noise, Sensor

if TYPE_CHECKING:
    import xarray as xr
    from pydantic import BaseModel

T = TypeVar("T")
CAMERAS: dict[str, type[Camera]] = {}
"""Cameras by their kind."""


class Camera(nn.Module, ABC):
    """Scene → optics of slot k → shutter of slot k → mean over slots → sensor (thesis eqs 4, 5).

    A new camera is one subclass: it names its ``kind``, says what its scene and its snapshot look like, builds its
    operator, and writes and reads its variables. Its parts are not assigned from outside: ``replace`` gives a camera
    with others.

    Args:
        size: (H, W) of the scene, pixels.
        slots: number of time slots K.
        exposure: ``"equal"`` or ``"per-slot"``.
        sensor: ideal if None.

    Raises:
        SettingError: an impossible size, number of slots or exposure.
    """

    kind: ClassVar[str]
    """Name of the camera in files and on the command line."""
    channel: ClassVar[str]
    """What a channel of the scene is: band or view."""
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    """Named cameras: arguments of the constructor."""
    Spec: ClassVar[type[BaseModel]]
    """The settings that can be written down: those of files, sweeps and the command line."""
    needed: ClassVar[tuple[str, ...]]
    """Variables of a file without which it makes no camera."""
    stated: ClassVar[tuple[str, ...]]
    """Attributes without which nobody knows what the variables mean."""
    page: ClassVar[str] = "docs/"

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        if "kind" in cls.__dict__:
            CAMERAS[cls.kind] = cls

    def __init__(self, size: tuple[int, int], slots: int, exposure: str, sensor: nn.Module | None) -> None:
        super().__init__()
        self.size, self.slots = checked_size(size), slots
        check_choice("exposure", exposure, EXPOSURES)
        self.exposure = exposure
        self.sensor: Sensor = sensor or Sensor()  # type: ignore[assignment]
        self.unbound: frozenset[str] = frozenset()
        self._cache: dict[str, tuple[tuple[object, ...], Any]] = {}

    @classmethod
    def from_preset(cls, name: str, **changes: Any) -> Self:
        """A named camera of ``presets``.

        Args:
            name: of the preset.
            changes: arguments that replace the preset's.

        Raises:
            SettingError: unknown preset.
        """
        return cls(**{**cls.preset(name), **changes})

    @classmethod
    def preset(cls, name: str) -> dict[str, Any]:
        """Arguments of a named camera of ``presets``.

        Raises:
            SettingError: unknown preset.
        """
        check_choice("preset", name, cls.presets)
        return dict(cls.presets[name])

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
        """Light throughput: share of a white scene's light that is recorded under equal exposure."""

    @abstractmethod
    def build_operator(self, depth: Tensor | None = None) -> LinearOperator:
        """The linear part with the present codes; ``depth`` (B, 1, H, W) in metres where the camera has one."""

    @abstractmethod
    def arguments(self) -> dict[str, Any]:
        """Arguments of the constructor that make this camera; its modules are shared."""

    @abstractmethod
    def label(self, scenes: Tensor, name: str = "", unit: str = "relative irradiance") -> xr.DataArray:
        """Scenes (B, *scene_shape) of this camera as a labelled array: the first of the batch, or all its colours."""

    @abstractmethod
    def variables(self) -> xr.Dataset:
        """Codes, optics and sensor: everything but a snapshot, for files."""

    @classmethod
    @abstractmethod
    def from_variables(cls, dataset: xr.Dataset, where: str) -> Self:
        """The camera of ``variables``; ``where`` names the file in errors.

        Raises:
            DataError: a variable is missing or does not fit the others.
        """

    def snapshot_axes(self, snapshots: Tensor) -> tuple[str, ...]:
        """Names of the axes of snapshots (B, C, H, W') in a file, those of length one left out."""
        return ("y", "x")

    @property
    def learnable(self) -> bool:
        """Whether anything of the camera is learned."""
        return any(True for _ in self.parameters())

    @property
    def exposures(self) -> int:
        """Exposure times that are accumulated: K per slot."""
        return self.slots if self.exposure == "per-slot" else 1

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
        """The linear part with the present codes; cached until a tensor of the camera changes, unless it is learned.

        Args:
            depth: (B, 1, H, W) metres, of a camera that images depth.
        """
        if depth is not None:
            return self.build_operator(depth)
        return self.cached("operator", self.build_operator)

    def cached(self, name: str, build: Callable[[], T]) -> T:
        """What depends on the camera alone, built once until a tensor of it changes; anew while it is learned."""
        if self.learnable:
            return build()
        state = (self.exposure, *self._geometry(), *((t.data_ptr(), t._version) for t in self.buffers()))
        if name not in self._cache or self._cache[name][0] != state:
            self._cache[name] = (state, build())
        value: T = self._cache[name][1]
        return value

    def replace(self, **parts: Any) -> Self:
        """The camera with other parts: arguments of its constructor, modules among them. The first stays as it is.

        Args:
            parts: such as ``sensor``, ``codes``, ``size``.

        Raises:
            SettingError, ShapeError: an unknown part, or parts that do not fit.
        """
        arguments = self.arguments()
        for name in parts:
            if name not in arguments and name not in self._more_arguments():
                raise SettingError(name, "a part", f"one of {', '.join(arguments)}, for a {self.kind} camera")
        return type(self)(**{**arguments, **parts})

    def bound_to(self, **parts: Any) -> Self:
        """The camera with what its constructor left out (``unbound``: size, bands, views) taken from ``parts``."""
        missing = {name: value for name, value in parts.items() if name in self.unbound}
        return self.replace(**missing) if missing else self

    def A(self, scene: Tensor, depth: Tensor | None = None) -> Tensor:
        """Scene (B, *scene_shape), at depth (B, 1, H, W) if the camera images it → exact snapshot (B, C, H, W')."""
        return self.operator(depth).A(scene)

    def A_adjoint(self, snapshot: Tensor, depth: Tensor | None = None) -> Tensor:
        """Snapshot (B, C, H, W') → scene, the transpose of ``A``."""
        return self.operator(depth).A_adjoint(snapshot)

    def A_dagger(self, snapshot: Tensor, depth: Tensor | None = None) -> Tensor:
        """Snapshot → least-norm scene that explains it."""
        return self.operator(depth).A_dagger(snapshot)

    def exact(
        self, scene: Tensor, depth: Tensor | None = None, progress: Callable[[float], None] | None = None
    ) -> Tensor:
        """Exact snapshot (B, C, H, W') of a scene that stands still or moves; arguments as ``forward``."""
        if depth is not None:
            raise SettingError("depth", "a depth map", f"none for a {self.kind} camera")
        return self.A(scene)

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

        Raises:
            ShapeError: other shapes.
        """
        return self.record(self.exact(scene, depth, progress), generator)

    def _geometry(self) -> tuple[object, ...]:
        """What else than tensors the operator depends on."""
        return ()

    def _more_arguments(self) -> tuple[str, ...]:
        """Arguments of the constructor that ``arguments`` does not list, as they are part of one that it does."""
        return ()

    def _check_scene(self, scene: Tensor, name: str = "scene") -> None:
        if tuple(scene.shape[1:]) != self.scene_shape:
            expected = f"(batch, {', '.join(map(str, self.scene_shape))})"
            raise ShapeError(name, f"shape {tuple(scene.shape)}", expected, "give the camera its size, or crop it")

    def _apply(self, fn: Any, recurse: bool = True) -> Self:
        self._cache.clear()
        return super()._apply(fn, recurse)
