"""PyTorch data sets of scenes, and of snapshots with the scenes they are of: for training with one's own loop."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from tmca import __version__
from tmca.arguments import Count, Float, Names, Seed, checked
from tmca.cameras import Camera
from tmca.data import read_scene
from tmca.data.folders import cache_folder
from tmca.data.in_memory import as_tensors
from tmca.errors import check_choice
from tmca.training.patches import CubeStore, PatchSource

_KINDS = ("spectral", "light-field")


class SceneDataset(Dataset[Tensor]):
    """Square parts of scenes, drawn at random: (L, crop, crop) of cubes, (V, U, crop, crop) of light fields.

    An entry depends on seed, epoch and index alone: workers, shuffling and restarts change none. Scenes are read once
    into arrays on disk, of which a part reads its own bytes.

    >>> scenes = SceneDataset(["coffee", "chelsea"], crop=32, length=100, bands=8)
    >>> len(scenes), scenes[3].shape
    (100, torch.Size([8, 32, 32]))

    Args:
        scenes: files, or rendered scenes by name.
        kind: ``"spectral"`` or ``"light-field"``.
        crop: side, pixels.
        length: entries of an epoch.
        seed: of places, turns and light.
        brightness: stops by which a part is made darker at most, or brighter by one; never above 1.
        tint: standard deviation of a random smooth change of the spectrum, natural logarithm.
        folder: of the arrays; in the user's cache if None.
        reading: how scenes are read, such as ``bands`` or ``views``; see `tmca.read`.

    Raises:
        SettingError: an unknown kind, or an impossible number.
        DataError, when an entry is asked for: a scene that cannot be read, or is smaller than a part.
    """

    @checked
    def __init__(
        self,
        scenes: Names,
        *,
        kind: str = "spectral",
        crop: Count = 64,
        length: Count = 1000,
        seed: Seed = 0,
        brightness: Float = 0.0,
        tint: Float = 0.0,
        folder: str | Path | None = None,
        **reading: Any,
    ) -> None:
        check_choice("kind", kind, _KINDS)
        self.scenes, self.kind, self.reading = tuple(scenes), kind, {**({} if kind == "spectral" else _GREY), **reading}
        self.crop, self.length, self.seed, self.epoch = crop, length, seed, 0
        self.light = (brightness, tint)
        self.folder = cache_folder() / "scenes" if folder is None else Path(folder)
        self._source: PatchSource | None = None
        self._views: tuple[int, int] | None = None

    @property
    def wavelengths(self) -> tuple[float, ...]:
        """Of the bands, metres; none of a light field."""
        return () if self.kind == "light-field" else tuple(self._read(self.scenes[0])["wavelength"].values.tolist())

    def set_epoch(self, epoch: int) -> None:
        """Other parts, before the next loader is made or iterated."""
        self.epoch = epoch

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, index: int) -> Tensor:
        if not -self.length <= index < self.length:
            raise IndexError(index)
        source = self._opened()
        scene = source(self.epoch, index % self.length).scene
        return scene if self._views is None else scene.unflatten(0, self._views)

    def __getstate__(self) -> dict[str, Any]:
        """Without open arrays: every worker opens its own."""
        return {**vars(self), "_source": None}

    def _opened(self) -> PatchSource:
        if self._source is None:
            said = json.dumps([__version__, self.kind, sorted(self.reading.items())], default=str)
            place = self.folder / hashlib.sha256(said.encode()).hexdigest()[:16]
            if self.kind == "light-field":
                first = as_tensors(self._read(self.scenes[0]))[0]
                self._views = (first.shape[1], first.shape[2])
            store = CubeStore(self.scenes, self._channels, place)
            self._source = PatchSource(
                store, self.crop, self.seed, views=self._views, brightness=self.light[0], tint=self.light[1]
            )
        return self._source

    def _read(self, name: str) -> Any:
        return read_scene(name, self.kind, **self.reading)  # type: ignore[arg-type]

    def _channels(self, name: str) -> np.ndarray[Any, np.dtype[np.float32]]:
        return as_tensors(self._read(name))[0][0].flatten(0, -3).numpy()


class SnapshotDataset(Dataset[tuple[Tensor, Tensor]]):
    """Snapshots (C, H, W') and the scenes they are of, with noise that depends on seed, epoch and index alone.

    >>> import tmca
    >>> camera = tmca.SpectralCamera(bands=8, slots=2, sensor=tmca.Sensor(read_noise=0.01))
    >>> pairs = SnapshotDataset(SceneDataset(["coffee"], crop=32, bands=8), camera)
    >>> [part.shape for part in pairs[0]]
    [torch.Size([1, 32, 39]), torch.Size([8, 32, 32])]

    Args:
        scenes: a `SceneDataset`, or any data set of scenes as the camera's.
        camera: that takes the snapshots; what its constructor left out comes from the first scene.
        seed: of the noise.

    Raises:
        ShapeError, when an entry is asked for: scenes of another size than the camera's.
    """

    @checked
    def __init__(self, scenes: Dataset, camera: Camera, *, seed: Seed = 0) -> None:  # type: ignore[type-arg]
        self.scenes: Any = scenes
        self.seed, self._given = seed, camera
        self._bound: Camera | None = None

    @property
    def camera(self) -> Camera:
        """That takes the snapshots, bound to the scenes."""
        if self._bound is None:
            first = self.scenes[0]
            parts: dict[str, Any] = {"size": tuple(first.shape[-2:])}
            bands = getattr(self.scenes, "wavelengths", ()) or len(first)
            parts |= {"bands": bands} if first.ndim == 3 else {"views": tuple(first.shape[:2])}
            self._bound = self._given.bound_to(**parts)
        return self._bound

    def __len__(self) -> int:
        return len(self.scenes)

    def __getitem__(self, index: int) -> tuple[Tensor, Tensor]:
        scene = self.scenes[index]
        entropy = (self.seed, getattr(self.scenes, "epoch", 0), index % len(self))
        noise = int(np.random.SeedSequence(entropy).generate_state(1)[0])
        with torch.no_grad():
            return self.camera(scene, generator=noise)[0], scene


_GREY = {"colour": False}
"""Light fields of one colour, where nothing else is asked for."""
