"""One object per camera that tells every face of the package what it needs of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from torch import Tensor

from tmca.errors import check_choice

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from tmca.cameras import Camera

    Scene = xr.DataArray | xr.Dataset

APPLICATIONS: dict[str, Application] = {}
"""The application of every kind of camera."""


class Application(ABC):
    """How scenes of one kind of camera are read, imaged and measured.

    A new camera has one: it names the camera's ``kind`` and says what follows. It is registered as it is defined.
    """

    kind: ClassVar[str]

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        if "kind" in cls.__dict__:
            APPLICATIONS[cls.kind] = cls()

    def read(self, source: str, **reading: Any) -> Scene:
        """A scene from a file, or a rendered one by name, labelled; see `tmca.data.read_scene`."""
        from tmca.data import read_scene

        return read_scene(source, self.kind, **reading)  # type: ignore[arg-type]

    @abstractmethod
    def parts(self, scene: Any) -> dict[str, Any]:
        """What a camera takes from a scene where it was left out: size, and bands or views."""

    @abstractmethod
    def fitted(self, scene: Any, camera: Any, where: str) -> Scene:
        """The scene at the bands or views of a camera, the middle of it in the camera's size.

        Raises:
            DataError, SettingError: a scene that is smaller, or has other bands.
        """

    @abstractmethod
    def tensors(self, scene: Any) -> tuple[Tensor, ...]:
        """What the camera images: the scene (B, *scene_shape) and, where there is one, its depth (B, 1, H, W)."""

    def check(self, scene: Any, camera: Any) -> dict[str, Any]:
        """Notes on a scene in front of a camera for its snapshot.

        Raises:
            DataError, SettingError: a scene or camera that cannot make a snapshot.
        """
        return {}

    @abstractmethod
    def metrics(self, estimate: Mapping[str, np.ndarray], truth: Any, camera: Any) -> dict[str, float]:
        """Figures of merit of an estimate (``values``, and ``depth`` where there is one) of a fitted scene."""


def application_of(camera: Camera | str) -> Application:
    """The application of a camera, or of a kind of camera.

    Raises:
        SettingError: a kind that has none.
    """
    kind = camera if isinstance(camera, str) else camera.kind
    check_choice("camera", kind, APPLICATIONS)
    return APPLICATIONS[kind]
