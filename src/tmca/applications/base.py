"""One object per camera that tells every face of the package what it needs of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from inspect import signature
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import ConfigDict
from torch import Tensor

from tmca.arguments import described
from tmca.attributes import REMEDY, Attributes, json_of
from tmca.cameras import CAMERAS, Camera, load_cameras
from tmca.data import read_dataset, read_scene
from tmca.data.in_memory import bare_cube
from tmca.data.scene_names import READING, compare_source
from tmca.data.scenes import SCENE_KINDS
from tmca.decoders import decoders_for, usual_decoder
from tmca.errors import DataError, SettingError, check_choice
from tmca.plots.estimates import estimate_figure
from tmca.plugins import check_whole

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from tmca.applications.demo import Demo
    from tmca.cameras import Snapshot
    from tmca.data.formats.stored import Contents

    Scene = xr.DataArray | xr.Dataset

Columns = Sequence[tuple[str, str, str]]
"""(key, heading, format) of the columns of a table."""
APPLICATIONS: dict[str, Application] = {}
"""The application of every kind of camera."""


class Application(ABC):
    """How scenes of one kind of camera are read, imaged, measured and drawn.

    A new camera has one: it names the camera's ``kind``, says what is abstract here, and overrides what is different
    for it. It is registered as it is defined. Where a method takes a ``camera``, that is one, or what the file of an
    estimate says of it, see ``camera_of``.
    """

    kind: ClassVar[str]
    columns: ClassVar[Columns] = (("psnr", "PSNR (dB)", ".2f"),)  # of its metrics in tables
    codes: ClassVar[tuple[str, ...]] = ("codes",)  # names of ``code_figures``
    pictures: ClassVar[tuple[str, ...]] = (".png",)  # endings of ``figures``
    demo: ClassVar[Demo | None] = None  # its part of `tmca demo`

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        if "kind" in cls.__dict__:
            APPLICATIONS[cls.kind] = cls()

    # Settings of the camera

    def settings(self) -> dict[str, int | float | str]:
        """Arguments of the camera's constructor that are numbers or words, with their defaults."""
        arguments = signature(CAMERAS[self.kind]).parameters.values()
        known = {one.name: one.default for one in arguments if isinstance(one.default, int | float | str)}
        return {name: value for name, value in known.items() if not isinstance(value, bool)}

    def settings_of(self, texts: Mapping[str, str]) -> dict[str, int | float | str]:
        """Values of ``settings`` from their texts.

        Raises:
            SettingError: a name that is none of them, or no value of its type.
        """
        known, found = self.settings(), {}
        for name, text in texts.items():
            check_choice("set", name, known)
            try:
                found[name] = type(known[name])(text)
            except ValueError:
                wanted = "a whole number" if isinstance(known[name], int) else "a number"
                raise SettingError("set", f"{name}={text}", wanted) from None
        return found

    # Decoders

    @property
    def default_decoder(self) -> str:
        """Name of the decoder where none is asked for."""
        return usual_decoder(self.kind)

    def decoder_labels(self) -> dict[str, str]:
        """Name → label of its decoders, those of plug-ins included; networks are named by what trains them."""
        return {name: cls.label for name, cls in decoders_for(self.kind).items() if name != "network"}

    # Scenes

    def read(self, source: str, **reading: Any) -> Scene:
        """A scene from a file, or a rendered one by name, labelled, see `tmca.data.read_scene`: as the cameras of this
        package take it, of which the application is one or extends one; else what the scene is."""
        kinds = (vars(base).get("kind") for base in type(self).__mro__)
        return read_scene(source, next((kind for kind in kinds if kind in SCENE_KINDS), None), **reading)

    def scene(self, given: Any, camera: Any, where: str = "scene") -> Scene:
        """A scene as `tmca.simulate` and `tmca.evaluate` take it, labelled.

        Args:
            given: what ``read`` reads, a labelled scene, or an array or a tensor as the camera's scenes are.
            camera: whose wavelengths, or views, those of an array are.
            where: for errors.

        Raises:
            DataError, ShapeError: no scene of this kind.
        """
        if isinstance(given, str | Path):
            return self.read(str(given))
        if hasattr(given, "dims"):
            bare = bare_cube(given)
            return self.labelled(given, where) if bare is None else self.of_array(bare, camera, where)
        if not isinstance(given, Tensor | np.ndarray):
            raise DataError(where, described(given), "a scene", "read it with tmca.read")
        return self.of_array(given.numpy(force=True) if isinstance(given, Tensor) else given, camera, where)

    def labelled(self, scene: Any, where: str) -> Scene:
        """A labelled scene with its axes in order.

        Raises:
            DataError: of another kind.
        """
        checked: Scene = scene
        return checked

    def of_array(self, values: np.ndarray, camera: Any, where: str) -> Scene:
        """A scene of an array without labels.

        Raises:
            DataError, ShapeError: one that does not say enough.
        """
        raise DataError(where, f"an array of shape {values.shape}", f"a labelled {self.kind} scene")

    @abstractmethod
    def parts(self, scene: Any) -> dict[str, Any]:
        """What a camera takes from a scene where it was left out: size, and bands or views."""

    @abstractmethod
    def fitted(self, scene: Any, camera: Any, where: str) -> Scene:
        """The scene at the bands or views of a camera, the middle of it in the camera's size.

        Raises:
            DataError, SettingError: a scene that is smaller, or has other bands.
        """

    def in_metres(self, scene: Any) -> Scene:
        """The scene, marked so that `fitted` keeps its depth in metres.

        Raises:
            SettingError: scenes of this kind have no depth.
        """
        raise SettingError("metric_depth", "True", f"none: a {self.kind} scene has no depth", "leave it out")

    @abstractmethod
    def tensors(self, scene: Any) -> tuple[Tensor, ...]:
        """What the camera images: the scene (B, *scene_shape) and, where there is one, its depth (B, 1, H, W)."""

    def check(self, scene: Any, camera: Any) -> dict[str, Any]:
        """Notes on a scene in front of a camera for its snapshot.

        Raises:
            DataError, SettingError: a scene or camera that cannot make a snapshot.
        """
        return {}

    # Truth and estimates

    def truth(self, source: str, camera: Any, notes: Mapping[str, Any], colours: bool = False, **reading: Any) -> Scene:
        """The scene of a snapshot or an estimate, read as it was for the snapshot and brought to the camera.

        Args:
            source: a file, or a rendered scene by name.
            camera: that took the snapshot.
            notes: of the snapshot or the estimate, which may say how its scene was read.
            colours: whether there is one snapshot for each of three colours.
            reading: more arguments of ``read``.

        Raises:
            DataError, SettingError: as ``read`` and ``fitted``.

        Warns:
            SceneWarning: another scene than the snapshot's.
        """
        scene = self.fitted(self.read(source, **reading), camera, source)
        if noted := noted_reading(notes):
            compare_source(noted.get("source", source), source)
        return scene

    @abstractmethod
    def metrics(self, estimate: Mapping[str, np.ndarray], truth: Any, camera: Any) -> dict[str, float]:
        """Figures of merit of an estimate (``values``, and ``depth`` where there is one) of a fitted scene."""

    def geometry(self, estimate: xr.Dataset, truth: Any) -> dict[str, float]:
        """Errors of the geometry that an estimate shows, where the truth's is known beside its scene."""
        return {}

    def remarks(self, estimate: xr.Dataset) -> list[str]:
        """What is said below the figures of merit of an estimate, in lines."""
        return []

    def holds(self, about: Mapping[str, Any]) -> bool:
        """Whether a file that does not name its camera, and of which `tmca.data.describe` says this, is an estimate of
        this camera's scene."""
        return False

    def stored(self, path: str, **reading: Any) -> xr.Dataset:
        """The estimate in a file, as `Estimate.to_xarray` labels it, values as they are.

        Raises:
            DataError: none in it.
        """
        return read_dataset(path, ("estimate",))

    def camera_of(self, stored: xr.Dataset, where: str) -> Any:
        """What an estimate says of its camera: ``kind``, ``size`` and what else a truth is fitted to.

        Raises:
            DataError: it does not say enough.
        """
        values = stored["radiance" if "radiance" in stored else "estimate"]
        if not {"y", "x"} <= set(values.dims):
            raise DataError(where, f"an estimate by {', '.join(map(str, values.dims))}", "one by y and x", REMEDY)
        return SimpleNamespace(kind=self.kind, size=(values.sizes["y"], values.sizes["x"]))

    # Pictures

    def code_figures(self, camera: Any) -> dict[str, Figure]:
        """What a camera shows, by the names in ``codes``."""
        return {"codes": camera.plot()}

    def figure(
        self, estimate: xr.Dataset, camera: Any, truth: Any = None, snapshot: Snapshot[Any] | None = None
    ) -> Figure:
        """An estimate as `Estimate.to_xarray` labels it, beside the truth and the snapshot where they are known."""
        return estimate_figure(estimate, truth)

    def figures(
        self,
        estimate: xr.Dataset,
        camera: Any,
        truth: Any = None,
        snapshot: Snapshot[Any] | None = None,
        title: str = "",
    ) -> dict[str, Figure | np.ndarray]:
        """Pictures of an estimate by the endings in ``pictures``; for ``.gif`` the views to walk over."""
        return {".png": self.figure(estimate, camera, truth, snapshot)}


def application_of(camera: Camera | str) -> Application:
    """The application of a camera, or of a kind of camera.

    Raises:
        SettingError: a kind that has none, or whose classes lack something.
    """
    kind = camera if isinstance(camera, str) else camera.kind
    if kind not in APPLICATIONS:
        load_cameras()
    for known, other, lacking in ((APPLICATIONS, CAMERAS, "application"), (CAMERAS, APPLICATIONS, "camera")):
        if kind in other and kind not in known:
            raise SettingError("camera", f"{kind!r}, which has no {lacking}", "both, as `tmca new camera` writes them")
    check_choice("camera", kind, APPLICATIONS)
    for cls, base in ((CAMERAS[kind], Camera), (type(APPLICATIONS[kind]), Application)):
        check_whole(cls, base, "camera", f"{cls.__name__} of {cls.__module__}")
    return APPLICATIONS[kind]


def has_deviation(contents: Contents) -> bool:
    """Whether an open file has the predicted deviation of each value of its estimate."""
    values, spread = (contents.arrays.get(name) for name in ("estimate", "deviation"))
    if values is None or spread is None or not spread.numeric:
        return False
    return contents.labelled and (spread.dims, spread.shape) == (values.dims, values.shape)


class _Reading(Attributes):
    """The note on how a scene was read: from where, and arguments of its reader."""

    model_config = ConfigDict(extra="allow")
    source: str


def noted_reading(notes: Mapping[str, Any], where: object = "notes") -> dict[str, Any]:
    """How the scene of a snapshot was read, as its notes say; {} where they do not.

    Args:
        notes: of a snapshot or an estimate.
        where: their file, for the message.

    Raises:
        DataError: a damaged note.
    """
    text = str(notes.get(READING, "{}"))
    if text == "{}":
        return {}
    noted: _Reading = json_of(text, f"{where}: attribute {READING}", _Reading)
    return noted.model_dump()
