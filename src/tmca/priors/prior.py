"""Priors of scene blocks: what all have in common, their files, and how one is found for a camera or learned."""

from __future__ import annotations

import hashlib
import inspect
import json
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
import torch
from torch import Tensor

from tmca.errors import DataError, SettingError, ShapeError, check_choice
from tmca.priors.learning import common_channels, cubes_of, fitting_block, source_of, usual_block, values_of
from tmca.priors.spectral_depth import WINDOW, needed_block

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

FORMAT = "tmca prior 1"
Progress = Callable[[float, str], None]
"""Takes the share that is done, and what is done next."""
_SIZE, _RANGE = (256, 256), (400e-9, 700e-9)
_VIEWS_SIZE, _VIEWS_SEEDS = (128, 160), (0, 1)
_RENDERING = 1
"""Raised when the rendering changes: priors cached by earlier versions are then learned anew."""
_MIXTURE_OF_VIEWS: dict[str, Any] = {"kinds": 8, "rank": 150, "gains": 4, "samples": 16_000}
"""Light fields have fewer directions worth their time than cubes."""


@dataclass(frozen=True)
class Prior(ABC):
    """What scene blocks (L, h, w) look like.

    A subclass says what kind it is, and is then learned, found and read from files too; the room's ``__init__`` has to
    import it. Its class attributes: ``kind``; ``called``, with its article; ``learned_by``, the command that writes its
    file; ``dimensions`` of the arrays in its file; ``in_files``, its kind as files spell it, where that differs;
    ``argument``, by which decoders take it.
    """

    kind: ClassVar[str]
    called: ClassVar[str]
    learned_by: ClassVar[str]
    dimensions: ClassVar[Mapping[str, tuple[str, ...]]]
    in_files: ClassVar[str] = ""
    argument: ClassVar[str] = "prior"
    kinds: ClassVar[dict[str, type[Prior]]] = {}

    def __init_subclass__(cls, **settings: Any) -> None:
        super().__init_subclass__(**settings)
        if "kind" in vars(cls):  # a subclass without one is of its parent's
            Prior.kinds[cls.kind] = cls

    @property
    @abstractmethod
    def block(self) -> tuple[int, int, int]:
        """(L, h, w)."""

    @property
    @abstractmethod
    def wavelengths(self) -> tuple[float, ...] | None:
        """Of the L channels, in metres; None where they are views or not known."""

    @property
    @abstractmethod
    def sources(self) -> tuple[str, ...]:
        """Names (and checksums) of the scenes it was learned from."""

    @classmethod
    @abstractmethod
    def learn(cls, *examples: Any, **settings: Any) -> Self:
        """The prior of blocks (h, w) cut from example cubes (L, H, W).

        Raises:
            ShapeError: no cube, different band counts or views, or a block larger than a cube.
            DataError: values that are not finite.
        """

    @abstractmethod
    def sample(self, count: int, seed: int) -> Tensor:
        """(count, L, h, w) random blocks of this prior."""

    @abstractmethod
    def figure(self) -> Figure:
        """A picture of it."""

    @abstractmethod
    def arrays(self) -> dict[str, Tensor]:
        """What its file holds, by name."""

    def attributes(self) -> dict[str, Any]:
        """What else its file says."""
        return {}

    @classmethod
    @abstractmethod
    def from_arrays(cls, arrays: Mapping[str, Tensor], about: Mapping[str, Any]) -> Self:
        """The prior of a file that says this about it; KeyError or ValueError where it is damaged."""

    def check(self, camera: Any) -> None:
        """Whether it is one of the scenes that a camera sees.

        Raises:
            ShapeError: another number of bands or views.
            SettingError: bands that are more than a nanometre away.
        """
        if camera.kind == "light-field":
            v, u = camera.views
            if self.block[0] != v * u:
                found, wanted = f"{self.block[0]} {'bands' if self.wavelengths else 'views'}", f"the camera's {v}×{u}"
                raise ShapeError(self.argument, found, wanted, "learn one for them")
            return
        if self.block[0] != len(camera.wavelengths):
            found, wanted = f"{self.block[0]} channels", f"the camera's {len(camera.wavelengths)}"
            raise ShapeError(self.argument, found, wanted, "learn it on the same bands")
        pairs = zip(self.wavelengths or camera.wavelengths, camera.wavelengths, strict=True)
        for band, (length, seen) in enumerate(pairs, start=1):
            if abs(length - seen) > 1e-9:
                found, wanted = f"band {band} at {length * 1e9:.4g} nm", f"the camera's {seen * 1e9:.4g} nm"
                raise SettingError(self.argument, found, wanted, "learn one at the camera's bands")

    def to(self, device: torch.device | str) -> Self:
        """The prior on a device; itself if it is there."""
        parts = {part.name: getattr(self, part.name) for part in fields(self)}
        moved = {name: part.to(device) for name, part in parts.items() if isinstance(part, (Tensor, Prior))}
        return self if all(part is parts[name] for name, part in moved.items()) else replace(self, **moved)

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the prior as labelled NetCDF4, whole or not at all.

        Raises:
            OutputError: the file exists, or cannot be written.
        """
        import xarray as xr

        from tmca.data import write_dataset

        variables = {name: (self.dimensions[name], values.cpu().numpy()) for name, values in self.arrays().items()}
        about = {"format": FORMAT, "kind": self.in_files or self.kind, "sources": "\n".join(self.sources)}
        data = xr.Dataset(variables, attrs={**about, "block": list(self.block), **self.attributes()})
        if self.wavelengths is not None:
            data = data.assign_coords(wavelength=("channel", np.array(self.wavelengths), {"units": "m"}))
        return write_dataset(data, path, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a prior of this kind that ``save`` wrote.

        Raises:
            DataError: no such file, no prior of this kind in it, or damaged content.
        """
        prior = load_prior(path, cls.kind)
        if not isinstance(prior, cls):
            raise DataError(path, prior.called, cls.called, f"name one that {cls.learned_by} wrote")
        return prior


def load_prior(path: str | Path, kind: str = "gaussian") -> Prior:
    """Read a prior file of any kind.

    Args:
        path: of the file.
        kind: that is wanted, for the error.

    Raises:
        DataError: no such file, no prior in it, or damaged content.
    """
    from tmca.data import read_dataset

    data = read_dataset(path)
    cls = {one.in_files or one.kind: one for one in Prior.kinds.values()}.get(str(data.attrs.get("kind")))
    if data.attrs.get("format") != FORMAT or cls is None:
        raise DataError(path, "no prior in it", f"a file written by {Prior.kinds[kind].learned_by}", "learn one")
    arrays = {name: torch.from_numpy(data[name].values.astype(np.float64)) for name in cls.dimensions if name in data}
    if not all(values.isfinite().all() for values in arrays.values()):
        raise DataError(path, "values that are not finite", "numbers", "learn the prior again")
    sources = tuple(line for line in str(data.attrs.get("sources", "")).split("\n") if line)
    lengths = tuple(data["wavelength"].values.tolist()) if "wavelength" in data.coords else None
    try:
        return cls.from_arrays(arrays, {**data.attrs, "wavelengths": lengths, "sources": sources})
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(path, f"a damaged prior ({error})", "every part of it", "copy the file again") from error


def check_kind(prior: Prior, kind: str) -> None:
    """Raises SettingError unless a prior is of this kind."""
    check_choice("prior_kind", kind, Prior.kinds)
    wanted = Prior.kinds[kind]
    if not isinstance(prior, wanted):
        found, remedy = getattr(prior, "called", f"a {type(prior).__name__}"), f"learn one with {wanted.learned_by}"
        raise SettingError(wanted.argument, found, wanted.called, remedy)


def find_prior(
    camera: Any,
    given: str | Path | Prior | None = None,
    kind: str = "gaussian",
    progress: Progress | None = None,
    *,
    block: tuple[int, int] | None = None,
) -> Any:
    """The prior of a camera's scenes.

    That of the rendered scenes is learned on first use and cached in the folder ``TMCA_CACHE``, or ``tmca`` in the
    user's cache folder.

    Args:
        camera: whose bands or views the prior has to have.
        given: it, its file, or None for that of the rendered scenes.
        kind: ``"gaussian"``, ``"mixture"`` or ``"dictionary"``.
        progress: called where it has to be learned.
        block: (rows, columns) of the rendered scenes' prior instead of the camera's.

    Raises:
        DataError: no such file, or no prior in it.
        SettingError: a prior of another kind or at other bands, or a camera for which nothing is rendered.
        ShapeError: another number of bands or views.
    """
    if given is None:
        return _of_rendered(camera, kind, block, progress or (lambda share, step: None))
    prior = load_prior(given, kind) if isinstance(given, (str, Path)) else given
    check_kind(prior, kind)
    prior.check(camera)
    return prior


def _of_rendered(camera: Any, kind: str, block: tuple[int, int] | None, progress: Progress) -> Prior:
    """The prior of the rendered training scenes: cached, or learned now."""
    from tmca.data import make_folder

    if kind == "dictionary":
        wanted = Prior.kinds[kind]
        raise SettingError(wanted.argument, "none", wanted.called, f"learn one with {wanted.learned_by}")
    if camera.kind == "spectral-depth" and block is None:
        block = block_of(camera, kind)
    label, identity, scenes = _rendered_scenes(camera, kind)
    identity += [] if block is None else [list(block)]
    digest = hashlib.sha256(json.dumps(identity).encode()).hexdigest()[:16]
    folder = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "tmca"
    file = Path(os.environ.get("TMCA_CACHE", folder)) / f"rendered-{label}-{digest}.nc"
    if file.exists():
        try:
            return load_prior(file)
        except DataError:
            pass  # a damaged file of ours: learned anew below, and replaced
    examples = []
    for index, (name, render) in enumerate(scenes):
        progress(0.5 * index / len(scenes), f"first use: rendering {name} for the prior, which is then cached")
        examples.append(values_of(render()).assign_attrs(name=name))
    progress(0.5, f"first use: learning the {kind} prior, which is then cached")
    prior = learn_prior(examples, camera, kind, block=block)
    make_folder(file.parent)
    prior.save(file, overwrite=True)
    return prior


def _rendered_scenes(camera: Any, kind: str) -> tuple[str, list[Any], list[tuple[str, partial[xr.Dataset]]]]:
    """What the file is called, what it depends on, and the training scenes by name, each rendered when called."""
    from tmca import __version__, data

    if camera.kind == "light-field":
        side, names = camera.views[0], sorted(data.split_rendered_light_fields()["train"])
        if camera.views != (side, side):
            found, wanted = f"none for {side}×{camera.views[1]} views", "one: the rendered light fields are square"
            raise SettingError("prior", found, wanted, "learn one")
        size, render = _VIEWS_SIZE, data.rendered_light_field
        calls = [(n, partial(render, n, views=side, size=size, seed=seed)) for n in names for seed in _VIEWS_SEEDS]
        label = "light-field" if kind == "gaussian" else f"light-field-{kind}"
        return label, [_RENDERING, __version__, side, names, size, _VIEWS_SEEDS], calls
    lengths, names = list(camera.wavelengths), sorted(data.split_rendered()["train"])
    if min(lengths) < _RANGE[0] - 1e-12 or max(lengths) > _RANGE[1] + 1e-12:
        raise SettingError(
            "prior",
            f"bands from {min(lengths) * 1e9:.4g} to {max(lengths) * 1e9:.4g} nm",
            "400 to 700 nm, where the rendered scenes are given",
            "pass --prior with one from `tmca prior learn --all-bands`, or use admm-tv",
        )
    picometres, spread = (
        [round(w * 1e12) for w in lengths],
        camera.dispersion.spread if camera.kind == "spectral" else 0,
    )
    identity = [_RENDERING, __version__, picometres, spread, kind == "mixture", names, _SIZE]
    return kind, identity, [(n, partial(data.rendered_scene, n, wavelengths=lengths, size=_SIZE)) for n in names]


def block_of(camera: Any, kind: str = "gaussian", window: int | None = None) -> tuple[int, int]:
    """(rows, columns) of the blocks of a camera's prior.

    Args:
        camera: spectral, light-field or spectral-depth.
        kind: of the prior.
        window: side of the windows that depth is decoded from; the usual one, or a tile of the codes, if None. Smaller
            windows share the blocks of usual ones.

    Raises:
        SettingError: no window is given for a spectral-depth camera whose shutter patterns do not repeat.
    """
    if camera.kind == "spectral-depth":
        side = camera.tile_size if window is None else window
        return needed_block(max(WINDOW, side), camera.bench.window)
    if camera.kind == "light-field":
        return usual_block(kind, views=camera.views)
    return usual_block(kind, len(camera.wavelengths), camera.dispersion.spread)


def learn_prior(
    scenes: Sequence[xr.DataArray | xr.Dataset],
    camera: Any = None,
    kind: str = "gaussian",
    *,
    spread: int = 0,
    block: tuple[int, int] | None = None,
    seed: int = 0,
    **settings: Any,
) -> Prior:
    """Learn a prior from example scenes.

    Args:
        scenes: cubes (wavelength, y, x), all with the same wavelengths, or light fields (view_v, view_u, y, x), or with
            colours first, which count as light fields of their own, all of the same views; relative irradiance, or
            datasets that hold them.
        camera: whose ``block_of`` the prior gets; that of most cameras shrinks to the smallest scene.
        kind: ``"gaussian"``, ``"mixture"`` or, of light fields, ``"dictionary"``.
        spread: columns by which dispersion widens the snapshot, for cubes without a camera.
        block: (rows, columns) instead of the camera's.
        seed: of random blocks.
        settings: further ones of the ``learn`` of that kind.

    Raises:
        SettingError: no scenes, or a kind that there is not.
        DataError: scenes of different wavelengths or views, or smaller than a block that is needed.
    """
    if not scenes:
        raise SettingError("prior", "no example scenes", "at least one")
    examples = [values_of(scene) for scene in scenes]
    about = common_channels(examples)
    views = about.get("views")
    if kind not in Prior.kinds or (kind == "dictionary" and views is None):
        raise SettingError("kind", repr(kind), f"{', '.join(Prior.kinds)} (a dictionary: of light fields)")
    if camera is not None and (views is None) == (camera.kind == "light-field"):
        found, wanted = ("light fields", "cubes") if views else ("cubes", "light fields")
        raise SettingError("scenes", found, f"{wanted}, of which the {camera.kind} camera takes snapshots")
    _check_settings(kind, settings, block)
    needed = block is not None or (camera is not None and camera.kind == "spectral-depth")
    if block is None and camera is not None:
        block = block_of(camera, kind)
    elif block is None:
        block = usual_block(kind, len(about.get("wavelengths", ())), spread, views)
    about |= {} if kind == "gaussian" else {"seed": seed}
    about |= _MIXTURE_OF_VIEWS if kind == "mixture" and views is not None else {}
    about |= {"sources": [source_of(example) for example in examples], **settings}
    cubes = [cube for example in examples for cube in cubes_of(example)]
    return Prior.kinds[kind].learn(cubes, fitting_block(examples, block, needed), **about)


def _check_settings(kind: str, settings: dict[str, Any], block: Any) -> None:
    """Raises SettingError for a setting that this kind's ``learn`` does not have, or a block that is no pair."""
    taken = inspect.signature(Prior.kinds[kind].learn).parameters.values()
    names = [one.name for one in taken if one.kind is one.KEYWORD_ONLY]
    for name, value in settings.items():
        if name not in names and not any(one.kind is one.VAR_KEYWORD for one in taken):
            raise SettingError(name, repr(value), f"one of {', '.join(names)}", "leave it out")
    if block is not None and (not isinstance(block, Sequence) or len(block) != 2):
        raise SettingError("block", repr(block), "(rows, columns)")
